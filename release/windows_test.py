"""Runs the zip for Windows on Linux, under Wine, and compares its results with those of Linux.

    python3 release/windows_test.py ZIP

It needs Debian's packages wine64, wine and gcc-mingw-w64-x86-64, and a Python that has this
checkout and its dependencies. Wine 8 lacks some functions that Windows has. They are added to the
unpacked copy, never to the zip. Wine shows no consoles, no window of the viewer and no virus
scanner, so these are not tested.
"""

import argparse
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from check import ROOT

LOG, SLIDES = "sample_logs/service-brake.csv", "sample_logs/low-adhesion.mcap"
RESULT = "service-brake.adhesion.mcap"
# Both systems run each command, each in its own folder.
COMMANDS = [
    ["--help"],
    ["explain", "pressure-delay", "--json"],
    ["estimators", "--json"],
    ["inspect", LOG, "--json"],
    ["analyze", LOG, "--json"],
    ["analyze", LOG, "--force", "--json"],
    ["analyze", SLIDES, "-o", "Versuch 制动", "--json"],
    ["compare", LOG, "--json"],
    ["slip", SLIDES, "--axle", "1", "--json"],
    ["stops", LOG, SLIDES, "-o", "brake test", "--report", "--json"],
    ["vehicle", "coach"],
    ["report", RESULT, "-o", "brake.html", "--json"],
    ["simulate", "leaf-film", "-o", "leaf-film.mcap", "--json"],
    ["convert", "leaf-film.mcap", "leaf-film.csv", "--json"],
    ["convert", LOG, "brake.xlsx", "--json"],
    ["inspect", "brake.xlsx", "--json"],
    ["antiskid", "slippery-stop", "--json"],
    ["calibrate", LOG, "leaf-film.mcap", "-o", "train.toml", "--json"],
    ["tune", LOG, "leaf-film.mcap", "-a", "leso", "--json"],
    ["reproduce", "--json"],
    ["export-c", "kalman", "-o", "bcu", "--json"],
    ["fleet", "sample_logs", "-o", "fleet", "--workers", "2", "--json"],
    ["live", "-", "-o", "live", "--json"],  # the log on standard input
]
# Every package that another one needs on Windows is there.
DEPENDENCIES = """
from importlib.metadata import requires
from packaging.requirements import Requirement
import asammdf, can, cantools, nptdms
names, checked = [("adhesion-cli", ""), ("adhesion-cli", "formats")], set()
while names:
    name, extra = package = names.pop()
    checked.add(package)
    for needed in map(Requirement, requires(name) or []):
        if not needed.marker or needed.marker.evaluate({"extra": extra}):
            names += {(needed.name, x) for x in ("", *needed.extras)} - checked
"""
PRECISION = 1e-9  # to which both systems agree, relative or absolute
# The time of a run; the digest of a file that the system itself wrote, with other last digits.
VARIABLE = {"seconds", "sha256"}

MATH = "api-ms-win-crt-math-l1-1-0.dll"
OWN_MATH = MATH.replace("api", "own")
# MSVC passes complex numbers as structs, and its long double is a double.
COMPLEX_C = """
#include <complex.h>
typedef struct { double x, y; } D;
typedef struct { float x, y; } F;
static double complex d(D a) { return __builtin_complex(a.x, a.y); }
static float complex f(F a) { return __builtin_complex(a.x, a.y); }
static D from_d(double complex z) { D a = {creal(z), cimag(z)}; return a; }
static F from_f(float complex z) { F a = {crealf(z), cimagf(z)}; return a; }
F own__FCbuild(float x, float y) { F a = {x, y}; return a; }
#define ONE(name) \\
    D own_##name(D a) { return from_d(name(d(a))); } \\
    D own_##name##l(D a) { return from_d(name(d(a))); } \\
    F own_##name##f(F a) { return from_f(name##f(f(a))); }
#define REAL(name) \\
    double own_##name(D a) { return name(d(a)); } \\
    double own_##name##l(D a) { return name(d(a)); } \\
    float own_##name##f(F a) { return name##f(f(a)); }
D own_cpow(D a, D b) { return from_d(cpow(d(a), d(b))); }
D own_cpowl(D a, D b) { return from_d(cpow(d(a), d(b))); }
F own_cpowf(F a, F b) { return from_f(cpowf(f(a), f(b))); }
"""
ONE = "cacos cacosh casin casinh catan catanh ccos ccosh cexp clog csin csinh csqrt ctan ctanh"
REAL = "cabs carg cimag creal"
RANDOM_C = """
#include <windows.h>
BOOLEAN NTAPI SystemFunction036(void *, ULONG);
__declspec(dllexport) BOOL ProcessPrng(BYTE *x, SIZE_T n) { return SystemFunction036(x, n); }
"""


def fit_to_wine(python: Path, system: Path) -> None:
    """Adds to an unpacked Python what Wine 8 lacks; `system` is the folder of Wine's DLLs."""
    (python / "_wmi.pyd").unlink()  # `platform` works without it
    (python / "sitecustomize.py").write_text("import _winapi\ndel _winapi.CopyFile2\n")
    dump = ["x86_64-w64-mingw32-objdump", "-p", str(system / "ucrtbase.dll")]
    table = subprocess.run(dump, check=True, capture_output=True, text=True).stdout
    names = set(re.findall(r"^\s+\[\s*\d+\] (\w+)$", table, re.MULTILINE))
    own = {"_FCbuild", *(name + x for name in f"{ONE} {REAL} cpow".split() for x in ("", "f", "l"))}
    lines = [f"{x}=own_{x}" if x in own else f"{x}=ucrtbase.{x}" for x in sorted(names | own)]
    (python / "math.def").write_text("\n".join(["EXPORTS", *lines]))
    functions = [f"ONE({x})" for x in ONE.split()] + [f"REAL({x})" for x in REAL.split()]
    (python / "math.c").write_text(COMPLEX_C + "\n".join(functions))
    (python / "random.c").write_text(RANDOM_C)
    compiler = ["x86_64-w64-mingw32-gcc", "-O2", "-shared", "-static", "-o"]
    for command in (
        [OWN_MATH, "math.c", "math.def"],
        [str(system / "bcryptprimitives.dll"), "random.c", "-ladvapi32"],
    ):
        subprocess.run([*compiler, *command], cwd=python, check=True)
    for path in python.rglob("*"):
        if path.suffix in (".dll", ".pyd") and MATH.encode() in (data := path.read_bytes()):
            path.write_bytes(data.replace(MATH.encode(), OWN_MATH.encode()))


@contextmanager
def wine(folder: Path) -> Iterator[dict[str, str]]:
    """The environment of a Wine with its own files in the folder; it ends with the block."""
    env = {name: x for name, x in os.environ.items() if not name.startswith("PYTHON")}
    env |= {"WINEPREFIX": str(folder), "WINEDEBUG": "-all"}
    # Neither .NET nor a browser, and no C++ library of its own: Windows has none by itself.
    env["WINEDLLOVERRIDES"] = "mscoree,mshtml=;msvcp140,vcruntime140,vcruntime140_1=n"
    nowhere = subprocess.DEVNULL
    subprocess.run(["wineboot", "-i"], env=env, check=True, stdout=nowhere, stderr=nowhere)
    # Wine's services live as long as a program. So one waits, else each command starts them anew.
    waiting = subprocess.Popen(
        ["wine", "cmd"], env=env, stdin=subprocess.PIPE, stdout=nowhere, stderr=nowhere
    )
    try:
        yield env
    finally:  # also a server of `view`, whose caller ended without it
        subprocess.run(["wineserver", "-k"], env=env, check=True)
        waiting.wait()


def windows_path(path: Path) -> str:
    """The path as Wine's programs see it."""
    return "Z:" + str(path).replace("/", "\\")


def differences(windows: Any, linux: Any, place: str = "") -> Iterator[str]:
    """Places where two JSON documents differ: numbers by more than the precision, texts at all."""
    if isinstance(windows, dict) and isinstance(linux, dict):
        windows = {key.replace("\\", "/"): x for key, x in windows.items()}
        for key in sorted((windows.keys() | linux.keys()) - VARIABLE):
            yield from differences(windows.get(key), linux.get(key), f"{place}.{key}")
    elif isinstance(windows, list) and isinstance(linux, list) and len(windows) == len(linux):
        for number, pair in enumerate(zip(windows, linux, strict=True)):
            yield from differences(*pair, f"{place}[{number}]")
    elif isinstance(windows, float) and isinstance(linux, float):
        if not math.isclose(windows, linux, rel_tol=PRECISION, abs_tol=PRECISION):
            yield f"{place}: {windows!r}, not {linux!r}"
    elif isinstance(windows, str) and isinstance(linux, str):
        if windows.replace("\\", "/") != linux:
            yield f"{place}: {windows!r}, not {linux!r}"
    elif windows != linux:
        yield f"{place}: {windows!r}, not {linux!r}"


def json_documents(text: str, lines: bool) -> list[Any]:
    """The document on standard output, or one for each line."""
    return [json.loads(x) for x in (text.splitlines() if lines else [text])]


def written(folder: Path) -> dict[str, bool]:
    """The files below a folder, and whether each has content."""
    files = (path for path in folder.rglob("*") if path.is_file())
    return {path.relative_to(folder).as_posix(): path.stat().st_size > 0 for path in files}


class Test:
    """Both systems, and what they disagree in."""

    def __init__(self, program: Path, folder: Path, env: dict[str, str]) -> None:
        start = ["wine", "cmd", "/c", "call", windows_path(program / "adhesion.cmd")]
        self.windows, self.linux = folder / "windows", folder / "linux"
        own = {**os.environ, "PYTHONPATH": str(ROOT)}
        self.systems = {
            self.windows: (start, env),
            self.linux: ([sys.executable, "-m", "adhesion_cli"], own),
        }
        for place in self.systems:
            place.mkdir()
            shutil.copytree(program / "sample_logs", place / "sample_logs")
        self.failures = 0

    def run(self, place: Path, command: list[str]) -> tuple[int, str, str]:
        """Exit code, output and messages of a command on a system, whose streams are pipes."""
        start, env = self.systems[place]
        log = (ROOT / LOG).read_bytes() if command[0] == "live" else b""
        done = subprocess.run(
            [*start, *command], cwd=place, env=env, input=log, capture_output=True
        )
        return done.returncode, *(x.decode("utf-8", "replace") for x in (done.stdout, done.stderr))

    def compare(self, command: list[str]) -> None:
        """Runs a command on both systems and prints a row."""
        before = time.monotonic()
        code, output, messages = self.run(self.windows, command)
        seconds = time.monotonic() - before
        expected, linux_output, _ = self.run(self.linux, command)
        unlike = [] if code == expected else [f"exit code {code}, not {expected}: {messages}"]
        if "--json" in command and not unlike:
            lines = command[0] == "live"
            documents = (json_documents(x, lines) for x in (output, linux_output))
            unlike = list(differences(*documents))
        self.row(" ".join(command), code, seconds, unlike)

    def row(self, name: str, code: int, seconds: float, unlike: list[str]) -> None:
        """Prints a row of the table, and the first differences below it."""
        self.failures += bool(unlike)
        agreement = f"{len(unlike)} differences" if unlike else "agrees"
        print(f"{name:66} {code:4} {seconds:6.1f}  {agreement}", flush=True)
        for text in unlike[:5]:
            print(f"    {text}")

    def view(self) -> None:
        """Windows serves the recording to a browser; Wine has no window for the viewer."""
        start, env = self.systems[self.windows]
        pipe, before, is_served = subprocess.PIPE, time.monotonic(), False
        command = [*start, "view", RESULT, "--serve"]
        with subprocess.Popen(
            command, cwd=self.windows, env=env, stdin=pipe, stdout=pipe, stderr=pipe
        ) as server:
            url = server.stdout.readline().split()[-1].decode()
            for _ in range(100):  # until it listens
                with suppress(OSError), urllib.request.urlopen(url) as page:
                    is_served = b"Rerun" in page.read()
                    break
                time.sleep(0.2)
            server.kill()
        self.row("view --serve", 0, time.monotonic() - before, [] if is_served else [url])

    def exchange(self) -> None:
        """Each system inspects the result of the other one."""
        for place, other in (self.windows, self.linux), (self.linux, self.windows):
            shutil.copyfile(other / RESULT, place / "other.mcap")
            before = time.monotonic()
            code, _, messages = self.run(place, ["inspect", "other.mcap", "--json"])
            seconds = time.monotonic() - before
            self.row(
                f"{place.name}: inspect the other's result", code, seconds, [messages] * (code != 0)
            )


def main() -> None:
    """Unpacks the zip, runs the commands; exit code 1 where a result differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("zip", type=Path, help="what release/windows.py wrote")
    archive = zipfile.ZipFile(parser.parse_args().zip)
    with tempfile.TemporaryDirectory() as place, wine(Path(place) / "wine") as env:
        program = Path(place) / "Prüfung 1"
        archive.extractall(program)
        fit_to_wine(program / "python", Path(place) / "wine/drive_c/windows/system32")
        test = Test(program, Path(place), env)
        python = ["wine", windows_path(program / "python/python.exe"), "-c", DEPENDENCIES]
        done = subprocess.run(python, env=env, input=b"", capture_output=True)
        test.row(
            "dependencies", done.returncode, 0.0, [done.stderr.decode()] * (done.returncode != 0)
        )
        for command in COMMANDS:
            test.compare(command)
        test.view()
        test.row("files written", 0, 0.0, list(differences(*map(written, test.systems))))
        test.exchange()
    sys.exit(1 if test.failures else 0)


if __name__ == "__main__":
    main()
