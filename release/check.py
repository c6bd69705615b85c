"""Builds the wheel and checks it as a user gets it.

    python3 release/check.py -o DIR

The wheel is installed in an empty environment, and the program runs in a folder outside the
checkout, so that nothing of the checkout can help.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]


def build(folder: Path) -> Path:
    """The wheel of this checkout, built into the folder."""
    pip = [sys.executable, "-m", "pip", "wheel", "--quiet", "--no-deps"]
    subprocess.run([*pip, "--wheel-dir", str(folder), str(ROOT)], check=True)
    return max(folder.glob("adhesion_cli-*.whl"), key=lambda path: path.stat().st_mtime)


def install(wheel: Path, environment: Path) -> Path:
    """Installs the wheel in a new environment; the Python of it."""
    venv.create(environment, with_pip=True)
    python = environment / ("Scripts/python.exe" if sys.platform == "win32" else "bin/python")
    pip = [str(python), "-m", "pip", "install", "--quiet", "-c", str(ROOT / "constraints.txt")]
    subprocess.run([*pip, str(wheel)], check=True)
    return python


def check(python: Path, folder: Path, version: str) -> None:
    """Runs the main commands of an installed program in an empty folder.

    Raises:
        CalledProcessError: where a command fails.
        SystemExit: where the version or the result is not what it should be.
    """
    own = {name: x for name, x in os.environ.items() if not name.startswith("PYTHON")}

    def run(*arguments: str) -> str:
        command = [str(python), *arguments]
        done = subprocess.run(
            command, cwd=folder, env=own, check=True, stdout=subprocess.PIPE, text=True
        )
        return done.stdout

    def adhesion(*arguments: str) -> str:
        return run("-m", "adhesion_cli", *arguments)

    if version not in (shown := adhesion("--version")):
        sys.exit(f"the wheel is of version {version}, the program says {shown.strip()}")
    package = run("-c", "import adhesion_cli; print(adhesion_cli.__path__[0])")
    log = Path(package.strip()) / "sample_logs" / "service-brake.csv"
    result = json.loads(adhesion("analyze", str(log), "--json"))["results"][0]
    applications = result["axles"][0]["applications"]
    if not applications or applications[0]["force_n"] is None:
        sys.exit("analyze found no brake application in the bundled log")
    adhesion("inspect", result["outputs"]["mcap"])
    adhesion("report", result["outputs"]["mcap"], "-o", "report.html")
    print(f"{version}: {len(applications)} brake application, result and report written")


def main() -> None:
    """Builds, installs, runs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("-o", "--out", type=Path, required=True, help="folder for the wheel")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    wheel = build(folder)
    with tempfile.TemporaryDirectory() as place:
        python = install(wheel, Path(place) / "environment")
        (work := Path(place) / "work").mkdir()
        check(python, work, wheel.name.split("-")[1])
    print(f"{wheel}: checked")


if __name__ == "__main__":
    main()
