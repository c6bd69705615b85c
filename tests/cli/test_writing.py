"""Every command that writes: the old result or the new one, nothing left, whatever ends the run."""

import contextlib
import functools
import json
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import pytest
from helpers.forked import Forked
from helpers.mounts import mounted
from helpers.trains import rows

from adhesion_cli.cli.app import app

# What each command is given, {out} being its folder, and all that it writes there.
COMMANDS = {
    "analyze": ("a.csv -a td -o {out}", ["a.adhesion.mcap", "a.adhesion.rrd", "a.adhesion.sha256"]),
    "compare": ("a.csv -a td -o {out}", ["a.compare.mcap", "a.compare.rrd", "a.compare.sha256"]),
    "stops": ("a.csv -o {out}", ["stops.csv"]),
    "slip": ("a.csv -o {out}", ["a.slip.mcap", "a.slip.rrd", "a.slip.sha256"]),
    "calibrate": ("s.csv a.csv -o {out}/b.toml", ["b.toml"]),
    "tune": ("s.csv a.csv -a leso -o {out}/b.toml", ["b.toml"]),
    "convert": ("a.csv {out}/b.mcap", ["b.mcap"]),
    "simulate": ("service-brake --dt 0.02 -o {out}/b.csv", ["b.csv"]),
    "antiskid": (
        "slippery-stop -o {out}",
        ["slippery-stop.antiskid.rrd", "slippery-stop.antiskid.sha256"]
        + [f"slippery-stop.{law}.antiskid.mcap" for law in ("none", "patent", "rule")],
    ),
    "export-c": (
        "td -o {out}",
        [f"adhesion_td.{kind}" for kind in ("h", "c", "sha256")]
        + ["test_td.c", "Makefile", "README.md"],
    ),
    "report": ("r/a.adhesion.mcap -o {out}/b.html", ["b.html"]),
    "reproduce": ("-o {out}", [f"reproduce.{kind}" for kind in ("mcap", "rrd", "sha256")]),
}
SAMPLES = Path(__file__).parents[2] / "sample_logs"
LONG = ("antiskid", "reproduce")
ALL = sorted(COMMANDS)
QUICK = set(ALL) - set(LONG)
SOME = {"analyze", "convert"}  # a set of files, a single file


def crossed(variants: Mapping[str, set[str]]) -> list[Any]:
    """Every command in every variant; quick are those that stand beside it."""
    return [
        pytest.param(
            name, variant, id=f"{name}-{variant}", marks=[pytest.mark.slow] * (name not in quick)
        )
        for variant, quick in variants.items()
        for name in ALL
    ]


Files = dict[str, bytes]


def command(name: str, out: Path, *more: str) -> list[str]:
    return [name, *COMMANDS[name][0].format(out=out).split(), *more]


def started(folder: Path, arguments: list[str], code: str = "", **more: Any) -> Forked:
    """The command, after some code that spoils what it relies on."""
    more = {"stdout": subprocess.PIPE, **more}
    return Forked(folder, arguments, code, stderr=subprocess.PIPE, **more)


def ended(process: Forked) -> tuple[int, str, str]:
    out, err = process.communicate(timeout=300)
    return process.returncode, out, err


def files(folder: Path) -> Files:
    return {p.name: p.read_bytes() for p in folder.iterdir()}


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a log as CSV and as MCAP, and one with many bad rows."""
    folder = tmp_path_factory.mktemp("logs")
    whole = rows()
    (folder / "a.csv").write_text(whole)
    for name in ("service-brake.csv", "low-adhesion.csv"):
        shutil.copy(SAMPLES / name, folder / f"{name[0]}.csv")
    (folder / "bad.csv").write_text(whole + "no number,0,0\n" * 1000)
    assert ended(started(folder, ["convert", "a.csv", "a.mcap"]))[0] == 0
    assert ended(started(folder, ["analyze", "a.csv", "-a", "td", "-o", "r"]))[0] == 0
    return folder


@pytest.fixture(scope="module")
def old(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Files]:
    """What a command writes, from a run that nothing disturbs."""

    @functools.cache
    def of(name: str) -> Files:
        out = tmp_path_factory.mktemp(name)
        code, _, err = ended(started(logs, command(name, out)))
        assert code == (3 if name == "inspect" else 0), err
        assert sorted(files(out)) == sorted(COMMANDS[name][1])
        return files(out)

    return of


def put(folder: Path, of: Files) -> None:
    for name, content in of.items():
        (folder / name).write_bytes(content)


def test_the_table_has_every_command_that_writes() -> None:
    # The tables of a fleet, and files that grow with the samples, have tests of their own.
    others = {"estimators", "explain", "inspect", "view", "fleet", "live", "vehicle"}
    assert {c.name for c in app.registered_commands} - set(COMMANDS) == others


WAITS = """
def wait(_): open('begun', 'w').close(); time.sleep(60)
os.fsync = wait
"""


@pytest.mark.parametrize(("name", "sent"), crossed({"SIGINT": SOME, "SIGTERM": SOME}))
def test_a_signal_when_all_is_written_and_nothing_named(
    logs: Path, tmp_path: Path, old: Callable[[str], Files], name: str, sent: str
) -> None:
    number = signal.Signals[sent]
    put(tmp_path, old(name))
    begun = logs / "begun"
    begun.unlink(missing_ok=True)
    process = started(logs, command(name, tmp_path, "--force", "--json"), WAITS)
    until = time.monotonic() + 120.0
    while not begun.exists() and process.poll() is None and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(number)
    ends, out, err = ended(process)
    assert (ends, err) == (128 + number, "")
    document = json.loads(out)
    assert document["schema"] == "adhesion.error/1"
    assert document["error"] == {"SIGINT": "interrupted", "SIGTERM": "terminated"}[sent]
    assert files(tmp_path) == old(name)


LIMITED = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))"


@pytest.fixture
def disk(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[tuple[Path, Any, str]]:
    """A folder that takes old results and no more: what fills it, what a process does first."""
    if request.param == "limit":  # less than any result
        yield tmp_path, lambda: None, LIMITED
        return
    size = "nr_inodes=12" if request.param == "no inode" else "size=64m"
    with mounted(tmp_path, size) as folder:

        def fill() -> None:
            """Takes what is left, but one page where it is to be only nearly full."""
            with contextlib.suppress(OSError):
                if request.param == "no inode":
                    for i in range(12):
                        (folder / f".filler {i}").touch()
                with (folder / ".filler").open("wb", buffering=0) as filler:
                    while filler.write(bytes(4096)):
                        pass
            if request.param == "nearly full":
                os.truncate(folder / ".filler", (folder / ".filler").stat().st_size - 4096)

        yield folder, fill, ""


@pytest.mark.parametrize(
    ("name", "disk"),
    crossed({"limit": QUICK, "full": SOME, "nearly full": set(), "no inode": set()}),
    indirect=["disk"],
)
def test_a_full_disk(
    logs: Path, disk: tuple[Path, Any, str], old: Callable[[str], Files], name: str,
    request: pytest.FixtureRequest,
) -> None:  # fmt: skip
    folder, fill, code_first = disk
    if (
        name in ("calibrate", "stops", "tune")
        and request.node.callspec.params["disk"] == "nearly full"
    ):
        pytest.skip("its few lines fit into the page that is left")
    put(folder, old(name))
    before = files(folder)
    fill()
    code, out, err = ended(started(logs, command(name, folder, "--force"), code_first))
    assert (code, out) == (1, ""), err
    # reproduce analyses logs that it writes to the system's folder first: the limit holds there too
    if name != "reproduce" or not code_first:
        assert err.startswith(f"error: {folder}: cannot write the results (")
    assert {n: c for n, c in files(folder).items() if not n.startswith(".filler")} == before


TELLS_ITS_WORK = """
import contextlib, io, json
opened = []
sys.addaudithook(lambda event, told: event == "open" and opened.append(str(told[0])))
def run(arguments):
    opened.clear()
    sys.argv = ["adhesion", *arguments]
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            __main__.main()
        except SystemExit as end:
            code = end.code
    logs = [path for path in opened if path.endswith((".csv", ".mcap"))]
    return code, out.getvalue(), [*logs, *({"numba", "rerun"} & set(sys.modules))], err.getvalue()
print(json.dumps([run(arguments) for arguments in json.loads(sys.argv[1])]))
sys.exit()
"""


@pytest.mark.parametrize("how", ["read-only", "hard link", "symlink", "exists"])
def test_what_cannot_be_written_is_found_before_the_work(
    logs: Path, tmp_path: Path, how: str
) -> None:
    """No log is opened and nothing compiled, and nothing changes."""
    inputs = {name: logs / COMMANDS[name][0].split()[0] for name in ALL}
    if how in ("hard link", "symlink"):
        inputs = {name: log for name, log in inputs.items() if log.is_file()}
    force, says = ["--force"], "is the input itself"
    with contextlib.ExitStack() as stack:
        for name, log in inputs.items():
            folder = tmp_path / name
            folder.mkdir()
            out = folder / COMMANDS[name][1][0]
            if how == "read-only":
                stack.enter_context(mounted(folder, "ro"))
                says = "the folder cannot be written to"
            elif how == "exists":
                out.symlink_to("nowhere")
                force, says = [], "exists already"
            elif how == "hard link":
                os.link(log, out)
            else:
                out.symlink_to(log)
        before = {name: os.listdir(tmp_path / name) for name in inputs}
        contents = {log: log.read_bytes() for log in inputs.values() if log.is_file()}
        commands = [command(name, tmp_path / name, *force) for name in inputs]
        process = started(logs, [json.dumps(commands)], TELLS_ITS_WORK, bare=True)
        ends, told, err = ended(process)
        assert (ends, err) == (0, "")
        for name, (code, *worked, said) in zip(inputs, json.loads(told), strict=True):
            assert (code, *worked) == (1, "", []), name
            assert said.startswith("error: "), name
            assert says in said, name
        assert {name: os.listdir(tmp_path / name) for name in inputs} == before
        assert {log: log.read_bytes() for log in contents} == contents


@pytest.mark.parametrize(
    "name", [n if n in SOME else pytest.param(n, marks=pytest.mark.slow) for n in ALL]
)
def test_a_reader_that_went_away_and_outputs_that_are_links(
    logs: Path, tmp_path: Path, old: Callable[[str], Files], name: str
) -> None:
    """The results are whole, the links' target is kept, the exit code is the same for all."""
    (tmp_path / "precious").write_bytes(b"precious")
    for written in COMMANDS[name][1]:
        (tmp_path / written).symlink_to("precious")
    reader, writer = os.pipe()
    os.close(reader)
    process = started(logs, command(name, tmp_path, "--force"), stdout=writer)
    os.close(writer)
    code, _, err = ended(process)
    assert code == 1
    assert "error" not in err
    found = files(tmp_path)
    assert found.pop("precious") == b"precious"
    assert sorted(found) == sorted(COMMANDS[name][1])
    same = [n for n in found if not n.endswith((".rrd", ".sha256"))]  # a recording has an id
    assert {n: found[n] for n in same} == {n: old(name)[n] for n in same}
    assert not any((tmp_path / n).is_symlink() for n in found)


def test_eight_runs_of_a_command_to_one_output(
    logs: Path, tmp_path: Path, old: Callable[[str], Files]
) -> None:
    runs = [started(logs, command("convert", tmp_path)) for _ in range(8)]
    assert sorted(ended(run)[0] for run in runs) == [0] + [1] * 7
    assert files(tmp_path) == old("convert")
    runs = [started(logs, command("convert", tmp_path, "--force")) for _ in range(8)]
    assert [ended(run)[0] for run in runs] == [0] * 8
    assert files(tmp_path) == old("convert")
