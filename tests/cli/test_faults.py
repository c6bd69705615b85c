"""Whole commands while the kernel refuses or kills: what is there is whole, or was there before."""

import errno
import functools
import hashlib
import os
import re
import shutil
import subprocess
import sys
import tempfile
import warnings
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from helpers.forked import Forked
from helpers.mounts import mounted
from helpers.write_faults import FAULTS
from rerun.chunk import RrdReader

ROOT = Path(__file__).parents[2]
SCENARIO = """
description = "a short stop"
duration = 20.0

[train]
speed = 9.0

[[rail.section]]
at = 0.0
condition = "low"

[[brake.command]]
at = 1.0
pressure = 9e5
"""
COMMANDS = {
    "convert": "convert log.csv out.mcap",
    "table": "convert damaged.mcap out.csv",
    "analyze": "analyze log.csv other.csv -a td",
    "slip": "slip log.csv",
    "antiskid": "antiskid short.toml",
}
MOST = 60  # strikes of a fault: of 60 calls every one, of more as many, spread
PAGE = 4096  # bytes of a disk that are given out at once
OLD = b"of an earlier run"
# strace knows a file by its name, and ours have none until they are whole: see data/strike.c.
WRITES = ("ENOSPC", "EIO")
# The other commands write one file without a manifest: they delete nothing.
DELETES = {"analyze", "slip", "antiskid"}
STRUCK = [
    (c, f)
    for c in COMMANDS
    for f in FAULTS
    if not f.startswith("write:error") and (c in DELETES or not f.startswith("unlink"))
]
pytestmark = pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")


def ran(
    folder: Path, command: str, environ: Mapping[str, str] = MappingProxyType({})
) -> subprocess.CompletedProcess[str]:
    """The command, with more in its environment, in a folder that holds what it reads."""
    arguments = [*COMMANDS[command].split(), "--force"]
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = Forked(folder, arguments, environ=environ, **pipes)
    out, err = process.communicate(timeout=300)
    return subprocess.CompletedProcess(arguments, process.returncode, out, err)


def struck(folder: Path, command: str, options: list[str]) -> subprocess.CompletedProcess[str]:
    """The command under strace, from its start."""
    python = [sys.executable, "-B", "-m", "adhesion_cli", *COMMANDS[command].split(), "--force"]
    return subprocess.run(
        ["strace", "-f", "-qq", *options, *python],
        cwd=folder, env={**os.environ, "PYTHONPATH": str(ROOT)}, capture_output=True,
        text=True, timeout=300, check=False,
    )  # fmt: skip


def prepared(
    folder: Path, command: str, environ: Mapping[str, str] = MappingProxyType({})
) -> dict[str, bytes]:
    """Puts the inputs there and runs the command once, as `ran`: its outputs, by name."""
    lines = (ROOT / "sample_logs" / "service-brake.csv").read_text().splitlines(keepends=True)
    (folder / "log.csv").write_text("".join(lines[:400]))
    (folder / "other.csv").write_text("".join([*lines[:300], "1,2,3\n"]))
    whole = (ROOT / "sample_logs" / "low-adhesion.mcap").read_bytes()
    (folder / "damaged.mcap").write_bytes(whole[: len(whole) // 2])
    (folder / "short.toml").write_text(SCENARIO)
    before = {p.name for p in folder.iterdir()}
    done = ran(folder, command, environ)
    assert done.returncode in (0, 3), done.stderr
    return {p.name: p.read_bytes() for p in folder.iterdir() if p.name not in before}


def calls(folder: Path, command: str) -> Counter[str]:
    """How often the command makes each system call that a fault strikes."""
    names = ",".join(dict.fromkeys(fault.split(":")[0] for fault in FAULTS))
    struck(folder, command, [f"-o{folder / 'trace'}", f"-etrace={names}"])
    made = re.findall(rf"\b({names.replace(',', '|')})\(", (folder / "trace").read_text())
    (folder / "trace").unlink()
    return Counter(made)


def holds(folder: Path, command: str, made: dict[str, bytes], fault: str, nth: int) -> int:
    """Strikes at the nth call; every output is then that of this run or of the one before.

    Returns the exit code.
    """
    for name in made:
        (folder / name).unlink(missing_ok=True)
    old = {n for n in made if not n.endswith(".sha256")}
    for name in old:
        (folder / name).write_bytes(OLD)
    before = {p.name for p in folder.iterdir()}
    call = fault.split(":")[0]
    options = ["-o/dev/null", f"-etrace={call}", f"-einject={fault}:when={nth}"]
    done = struck(folder, command, options)
    hidden = [p for p in folder.iterdir() if p.is_dir()]
    there = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    found = {name: there.pop(name) for name in old & set(there)}
    earlier = {content == OLD for content in found.values()}
    assert len(earlier) == 1, (fault, nth)  # never outputs of two runs side by side
    if earlier == {True} or len(found) < len(old):
        assert done.returncode not in (0, 3), (fault, nth)
    for name, content in found.items():
        if earlier == {False} and not name.endswith(".rrd"):
            assert content == made[name], (fault, nth, name)
        elif earlier == {False}:
            with warnings.catch_warnings():
                warnings.simplefilter("error")
                assert sum(1 for _ in RrdReader(folder / name).stream()) > 0
    for name in [n for n in there if n.endswith(".sha256")]:
        for line in there.pop(name).decode().splitlines()[1:]:
            digest, of = line.split("  ")
            assert hashlib.sha256((folder / of).read_bytes()).hexdigest() == digest, (fault, nth)
    assert set(there) <= before, (fault, nth)
    if "error" in fault:
        assert done.returncode in (0, 1, 3), (fault, nth, done.stderr)
        assert "Traceback" not in done.stderr, (fault, nth)
        assert not hidden or call == "unlink", (fault, nth)
    for path in hidden:  # a run that was killed had no time for it, or the disk refused
        assert path.name.startswith(".adhesion-"), path
        shutil.rmtree(path)
    return done.returncode


@functools.cache
def striker() -> Path:
    """The library that lets writes fail; the test is left out where none can be made."""
    library = Path(tempfile.mkdtemp(prefix="strike")) / "strike.so"
    compiler = shutil.which("cc") or pytest.skip("needs a C compiler")
    source = ROOT / "tests" / "data" / "strike.c"
    subprocess.run([compiler, "-shared", "-fPIC", "-o", library, source], check=True)
    return library


def failing_writes(tmp_path: Path, command: str, error: str, most: int) -> None:
    """Lets `most` of the writes of a run into its folder fail, each in a run of its own.

    All is then as it was before, which is as a run left it that did not fail.
    """
    folder, log = tmp_path / "out", tmp_path / "writes"
    folder.mkdir()
    number = getattr(errno, error)
    text = f"cannot write the results ({os.strerror(number)})"
    environ = {
        "LD_PRELOAD": str(striker()), "STRIKE_IN": str(folder), "STRIKE_LOG": str(log),
        "STRIKE_ERROR": str(number),
    }  # fmt: skip
    made = prepared(folder, command, {**environ, "STRIKE_NTH": "0"})
    writes = log.stat().st_size
    assert writes >= len(made)
    struck = 0
    for nth in range(writes, 0, writes // -most):
        log.unlink()
        before = {p.name: p.read_bytes() for p in folder.iterdir()}
        done = ran(folder, command, {**environ, "STRIKE_NTH": str(nth)})
        if log.stat().st_size < nth:  # a recording comes through a pipe, in more writes or fewer
            assert done.returncode in (0, 3), done.stderr
            continue
        struck += 1
        assert done.returncode == 1, (error, nth)
        assert text in done.stderr, (error, nth)
        assert {p.name: p.read_bytes() for p in folder.iterdir()} == before, (error, nth)
    assert struck


def test_a_failing_write_leaves_the_old_results(tmp_path: Path) -> None:
    failing_writes(tmp_path, "analyze", "EIO", 2)


@pytest.mark.slow
@pytest.mark.parametrize("error", WRITES)
@pytest.mark.parametrize("command", COMMANDS)
def test_every_failing_write_does(tmp_path: Path, command: str, error: str) -> None:
    failing_writes(tmp_path, command, error, MOST)


@pytest.mark.parametrize(
    ("command", "fault", "nth"),
    [("convert", "fsync:error=EIO", 1), ("analyze", "rename:signal=KILL", 8)],
)
def test_a_fault_leaves_nothing_half_written(
    tmp_path: Path, command: str, fault: str, nth: int
) -> None:
    made = prepared(tmp_path, command)
    assert holds(tmp_path, command, made, fault, nth) not in (0, 3)  # it struck


@pytest.mark.slow
@pytest.mark.parametrize(("command", "fault"), STRUCK)
def test_every_fault_leaves_nothing_half_written(tmp_path: Path, command: str, fault: str) -> None:
    made = prepared(tmp_path, command)
    count = calls(tmp_path, command)[fault.split(":")[0]]
    assert count, fault
    for nth in range(1, count + 1, -(-count // MOST)):
        holds(tmp_path, command, made, fault, nth)


def fills_up(folder: Path, command: str, share: float) -> None:
    """The disk has room for a share of the results."""
    made = prepared(folder, command)
    for name in made:
        (folder / name).unlink()
    inputs = {p.name: p.read_bytes() for p in folder.iterdir()}
    taken, needed = (sum(-(-len(x) // PAGE) for x in some.values()) for some in (inputs, made))
    room = min(int(share * needed), needed - 1)
    with mounted(folder, f"size={(taken + room) * PAGE}") as disk:
        for name, content in inputs.items():
            (disk / name).write_bytes(content)
        done = ran(disk, command)
        assert done.returncode == 1
        assert "No space left on device" in done.stderr
        assert {p.name for p in disk.iterdir()} == set(inputs)


@pytest.mark.parametrize("share", [0.6, 0.9])
def test_a_disk_that_fills_up_leaves_nothing_behind(tmp_path: Path, share: float) -> None:
    fills_up(tmp_path, "analyze", share)


@pytest.mark.slow
@pytest.mark.parametrize("share", np.linspace(0.05, 0.98, 12))
@pytest.mark.parametrize("command", COMMANDS)
def test_no_disk_that_fills_up_ever_does(tmp_path: Path, command: str, share: float) -> None:
    fills_up(tmp_path, command, share)
