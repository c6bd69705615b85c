"""The command against its terminal: interrupts, encodings, outputs that are full, closed, gone."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from helpers.forked import Forked

PIPES = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
COMMAND = [sys.executable, "-m", "adhesion_cli"]
ROWS = "时间[s],制动缸压力(kPa),轮速(km/h)\n" + "".join(
    f"{i},{3 * i},{200 - i}\n" for i in range(100)
)

Run = Callable[..., subprocess.CompletedProcess[str]]


def test_the_bare_command_shows_its_help(run: Run) -> None:
    bare, asked = run(), run("--help")
    assert (bare.returncode, asked.returncode) == (2, 0)
    assert not bare.stdout
    assert bare.stderr == asked.stdout
    assert "\n  analyze " in asked.stdout


@pytest.mark.parametrize("as_json", [True, False])
def test_an_interrupt_is_told(tmp_path: Path, as_json: bool) -> None:
    arguments = ["reproduce", *(["--json"] if as_json else [])]
    code = (
        "from adhesion_cli.studies import reproduce\n"
        "def wait(**_): open('begun', 'w').close(); time.sleep(60)\n"
        "reproduce.reproduce = wait"
    )
    with Forked(tmp_path, arguments, code, **PIPES) as process:
        until = time.monotonic() + 60.0
        while not (tmp_path / "begun").exists() and time.monotonic() < until:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=60)
    assert process.returncode == 130
    if as_json:
        assert json.loads(out)["error"] == "interrupted"
        assert not err
    else:
        assert not out
        assert err.startswith("error: interrupted\nhint: ")
    assert [p.name for p in tmp_path.iterdir()] == ["begun"]


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_that_python_tells_as_another_error(
    number: int, code: int, tmp_path: Path
) -> None:
    """While modules are imported, too, as where a class is made."""
    program = (
        "from adhesion_cli.studies import reproduce\n"
        "class Comes:\n"
        f"    def __set_name__(self, *_): signal.raise_signal({number})\n"
        "def fails(**_): type('Made', (), {'it': Comes()})\n"
        "reproduce.reproduce = fails"
    )
    process = Forked(tmp_path, ["reproduce"], program, **PIPES)
    _, told = process.communicate(timeout=50)
    assert process.returncode == code
    assert "internal" not in told


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_in_a_callback_of_the_compiler_is_not_lost(
    number: int, code: int, tmp_path: Path
) -> None:
    """What Python raises in a callback, C drops, as when the compiler asks for its cache."""
    program = (
        "import ctypes; from adhesion_cli.studies import reproduce\n"
        "callback = ctypes.CFUNCTYPE(None)\n"
        "def compiles(**_):\n"
        f"    callback(lambda: signal.raise_signal({number}))()\n"
        "    for _ in range(1000): time.sleep(0.01)\n"
        "reproduce.reproduce = compiles"
    )
    process = Forked(tmp_path, ["reproduce"], program, **PIPES)
    _, told = process.communicate(timeout=50)
    assert process.returncode == code
    assert told.startswith("error: ")
    assert "ignored" not in told


@pytest.mark.parametrize("encoding", ["ascii", "cp1252", "cp850", "gbk"])
def test_a_pipe_gets_utf8_whatever_the_code_page(tmp_path: Path, encoding: str) -> None:
    (tmp_path / "a.csv").write_text(ROWS, encoding="utf-8")
    code = f"for stream in (sys.stdout, sys.stderr): stream.reconfigure(encoding={encoding!r})"
    for command, holds in (
        (["inspect", "a.csv"], "轮速(km/h)"),
        (["inspect", "a.csv", "--json"], r'"\u8f6e\u901f(km/h)"'),
        (["explain", "vehicle-default"], "…"),
    ):
        with (tmp_path / "out").open("wb") as out:
            process = Forked(tmp_path, command, code, stdout=out, stderr=subprocess.PIPE)
            _, told = process.communicate(timeout=50)
        assert process.returncode == 0, told
        printed = (tmp_path / "out").read_bytes()
        assert holds in printed.decode()
        assert b"\r" not in printed


def test_a_file_name_that_is_no_text(run: Run, tmp_path: Path) -> None:
    name = os.fsdecode(b"bad\xff.csv")
    (tmp_path / name).write_text(ROWS, encoding="utf-8")
    done = run("analyze", name, "-a", "td", "--json")
    assert done.returncode == 0, done.stderr
    (result,) = json.loads(done.stdout)["results"]
    assert result["log"]["path"] == r"bad\udcff.csv"
    assert "wrote" in run("analyze", name, "-a", "td", "--force").stdout
    checked = ["sha256sum", "-c", os.fsdecode(b"bad\xff.adhesion.sha256")]
    assert subprocess.run(checked, cwd=tmp_path, check=False, capture_output=True).returncode == 0
    missing = run("analyze", os.fsdecode(b"none\xff.csv"), "--json")
    assert json.loads(missing.stdout)["error"] == r"none\udcff.csv: no such file"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no /dev/full")
@pytest.mark.parametrize("options", [[], ["--json"]])
def test_results_that_cannot_be_printed_are_an_error(tmp_path: Path, options: list[str]) -> None:
    command = ["estimators", *options]
    with open("/dev/full", "w") as full:
        process = Forked(tmp_path, command, stdout=full, stderr=subprocess.PIPE)
        _, told = process.communicate(timeout=50)
    assert process.returncode == 1
    assert [line.split(":")[0] for line in told.splitlines()] == ["error", "hint"]
    closed = subprocess.run(
        ["sh", "-c", '"$@" >&-', "sh", *COMMAND, *command],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert closed.returncode == 1
    assert closed.stderr.startswith("error: standard output is closed\nhint: ")


def test_without_stderr_nothing_but_results_is_on_stdout(tmp_path: Path) -> None:
    done = subprocess.run(
        ["sh", "-c", '"$@" 2>&-', "sh", *COMMAND, "analyze", "missing.csv"],
        cwd=tmp_path, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (1, "")
