"""Hostile logs through `adhesion inspect`: each is refused or told of, in little memory."""

import gzip
import json
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from helpers.hostile_mcap import HOSTILE, LONG_MCAP, RIGHT

ROWS = b"t [s],p 1 [bar],v 1 [km/h]\n" + b"".join(b"%.2f,3,50\n" % (k / 100) for k in range(3000))
HALF = ROWS.rindex(b"\n", 0, len(ROWS) // 2) + 1
CSV: dict[str, Callable[[], bytes]] = {
    "no line end": lambda: b"1" * 50_000_000,
    "no line end after the head": lambda: ROWS + b"1" * 50_000_000,
    "cell of 10 MB in the first row": lambda: b't [s],p\n0,"' + b"x" * 10_000_000 + b'"\n1,2\n',
    "cell of 10 MB later": lambda: (
        ROWS[:HALF] + b'15,"' + b"x" * 10_000_000 + b'",50\n' + ROWS[HALF:]
    ),
    "name of 10 MB": lambda: b"t [s],p" + b"x" * 10_000_000 + b"\n0,1\n1,2\n2,3\n",
    "20000 columns": lambda: b"\n".join([b",".join([b"%d" % k for k in range(20_000)])] * 3),
    "20000 columns in one row": lambda: ROWS[:HALF] + b"1," * 20_000 + b"\n" + ROWS[HALF:],
    "hole of NUL": lambda: ROWS[:HALF] + bytes(50_000_000) + ROWS[HALF:],
    "only NUL": lambda: bytes(50_000_000),
    "only line ends": lambda: b"\n" * 10_000_000,
    "only quotes": lambda: b'"' * 10_000_000,
    "only delimiters": lambda: b"," * 10_000_000,
    "open quote": lambda: ROWS + b'31,"' + b"2,3\n" * 100_000,
    "open quote before 20 MB": lambda: ROWS + b'31,"' + b"2,3\n" * 5_000_000,
    "gzip bomb": lambda: 30 * gzip.compress(bytes(10 << 20), 1),
    "gzip bomb of rows": lambda: gzip.compress(ROWS + b"9" * (300 << 20), 1),
    "numbers without end": lambda: (
        ROWS[:HALF] + b"1e400,1e-400," + b"9" * 4000 + b"\n" + ROWS[HALF:]
    ),
    "no text": lambda: ROWS[:HALF] + b"\xff\xfe\x00\xd8" * 1000 + b"\n" + ROWS[HALF:],
}
DRIVER = """
import gc, importlib, json, os, signal, sys, time
from contextlib import suppress
from pathlib import Path
import typer.main
from adhesion_cli.__main__ import main
from adhesion_cli.cli import app
import numpy as np

def loaded(log):  # names of the modules that `inspect` of a sound log needs
    reader, writer = os.pipe()
    if os.fork():
        os.close(writer)
        with open(reader) as names:
            return json.load(names)
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    sys.argv = ["adhesion", "inspect", log, "--json"]
    with suppress(SystemExit):
        main()
    with open(writer, "w") as names:
        json.dump([*sys.modules], names)
    os._exit(0)

for suffix in ("csv", "mcap"):
    for name in loaded(f"sample_logs/low-adhesion.{suffix}"):
        with suppress(ImportError):
            importlib.import_module(name)

# Built once, and not by every fork.
commands = typer.main.get_command(app.app)
typer.main.get_command = lambda _: commands
gc.freeze()  # else each fork looks through all of this for garbage
def peak():  # of this process alone, page cache left out [KiB]
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0])

for path in sorted(Path(sys.argv[1]).iterdir()):
    if child := os.fork():
        os.waitpid(child, 0)
        path.unlink()  # some are large
        continue
    signal.setitimer(signal.ITIMER_PROF, 60.0)  # of its own time, only so that the test ends
    os.dup2(os.open(f"{path}.out", os.O_WRONLY | os.O_CREAT), 1)
    Path("/proc/self/clear_refs").write_text("5")
    before, begin = peak(), time.process_time()
    sys.argv = ["adhesion", "inspect", str(path), "--json"]
    try:
        main()
    except SystemExit as end:
        told = end.code, peak() - before, time.process_time() - begin
        Path(f"{path}.told").write_text(json.dumps(told))
    os._exit(0)
"""
MOST = 200 << 10  # KiB
CASES = {f"{name}.mcap": make for name, make in HOSTILE.items()}
CASES |= {f"{name}.csv": make for name, make in CSV.items()}
# Each takes a second or more to make and to read, and has a like among the others.
LONG = {
    *(f"{name}.mcap" for name in LONG_MCAP), "open quote before 20 MB.csv", "gzip bomb of rows.csv",
}  # fmt: skip
# The other MCAP files are small: in this process, `test_read_mcap_damage` reads every one.
LARGE = re.compile(r"csv|bomb|end|fan-out|large|length|lists|long|many")
QUICK = {name for name in CASES if LARGE.search(name)} - LONG


@pytest.mark.parametrize(
    "names",
    [
        pytest.param(QUICK, id="quick"),
        pytest.param(CASES.keys() - QUICK, id="others", marks=pytest.mark.slow),
    ],
)
def test_hostile_logs_are_told_in_little_memory(tmp_path: Path, names: set[str]) -> None:
    cases = {name: make for name, make in CASES.items() if name in names}
    places = {name: tmp_path / f"{i}{Path(name).suffix}" for i, name in enumerate(cases)}
    for name, make in cases.items():
        places[name].write_bytes(make())
    subprocess.run(
        [sys.executable, "-c", DRIVER, str(tmp_path)], check=True, cwd=Path(__file__).parents[1]
    )
    wrong = {}
    for name, path in places.items():
        kept, told = Path(f"{path}.told"), Path(f"{path}.out")
        code, grown, seconds = json.loads(kept.read_text()) if kept.exists() else (None, 0, 0)
        print(f"{name:40} {code} {grown / 1024:6.1f} MiB {seconds:6.2f} s")
        document = json.loads(told.read_text()) if code is not None else {}
        if grown > MOST or not _told(code, document, Path(name).stem in RIGHT):
            wrong[name] = code, grown, document
    assert not wrong


def _told(code: int | None, document: dict[str, Any], right: bool) -> bool:
    """Whether a log was refused with place and remedy, or read with findings that say so."""
    if "logs" not in document:
        return False
    (log,) = document["logs"]
    if "internal error" in (log["error"] or ""):
        return False
    if code == 1:
        return log["path"] in log["error"] and bool(log["hint"])
    findings = [f for f in log["findings"] if f["severity"] != "info"]
    return code == 0 and not findings if right else code == 3 and bool(findings)
