"""Outputs appear whole or not at all, whatever ends the run."""

import hashlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from filelock import FileLock
from helpers.forked import Forked
from helpers.systems import not_on_windows
from helpers.write_faults import FAULTS
from mcap.reader import make_reader

from adhesion_cli.core.errors import UserError
from adhesion_cli.results import atomic_files

NO_LINKS = "lets only administrators make links"
HIDDEN = ".adhesion-"  # begins the hidden folder of a killed run, which a later run removes


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """An empty folder."""
    return tmp_path


def pair(folder: Path) -> list[Path]:
    return [folder / "a.adhesion.mcap", folder / "a.adhesion.rrd"]


def write(paths: list[Path], text: str, force: bool = False) -> None:
    with atomic_files.outputs(paths, force) as temporary:
        for path in temporary:
            path.write_text(text)


def names(folder: Path) -> set[str]:
    return {p.name for p in folder.iterdir()}


def visible(folder: Path) -> set[str]:
    return {name for name in names(folder) if not name.startswith(HIDDEN)}


def manifest_holds(folder: Path) -> bool:
    lines = (folder / "a.adhesion.sha256").read_text().splitlines()
    assert lines[0].startswith("#")
    told = dict(reversed(line.split("  ")) for line in lines[1:])
    assert set(told) == {p.name for p in pair(folder)}
    return all(
        hashlib.sha256((folder / name).read_bytes()).hexdigest() == digest
        for name, digest in told.items()
    )


def test_set_appears_with_manifest(folder: Path) -> None:
    write(pair(folder), "new")
    assert names(folder) == {"a.adhesion.mcap", "a.adhesion.rrd", "a.adhesion.sha256"}
    assert manifest_holds(folder)
    assert all(p.stat().st_mode & 0o777 == 0o666 & ~_umask() for p in folder.iterdir())


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask


def test_hidden_folders_of_killed_runs_go(tmp_path: Path) -> None:
    """Those of a run that goes on, or has just begun, stay."""
    dead, alive, begun = (tmp_path / f"{HIDDEN}{x}" for x in ("dead", "alive", "begun"))
    for path in (dead, alive, begun):
        path.mkdir()
        (path / "a.csv").touch()
    with FileLock(alive / "lock"):
        for path in (dead, alive):
            os.utime(path, (time.time() - 100,) * 2)
        write([tmp_path / "a.csv"], "new")
    assert names(tmp_path) == {"a.csv", alive.name, begun.name}


def test_a_killed_run_is_swept(tmp_path: Path) -> None:
    stops = WRITE.replace("path.write_text(text)", "os._exit(9)")
    assert child(stops, tmp_path, "old", "").wait(20) == 9
    (left,) = tmp_path.iterdir()
    os.utime(left, (time.time() - 100,) * 2)
    assert child(WRITE, tmp_path, "new", "").wait(20) == 0
    assert len(names(tmp_path)) == 3


@not_on_windows("has no sha256sum")
def test_sha256sum_reads_the_manifest(tmp_path: Path) -> None:
    write(pair(tmp_path), "new")
    subprocess.run(["sha256sum", "-c", "--strict", "a.adhesion.sha256"], cwd=tmp_path, check=True)


@not_on_windows(NO_LINKS)
def test_a_set_may_lie_in_two_folders(folder: Path) -> None:
    (folder / "results").mkdir()
    (folder / "pictures").mkdir()
    (folder / "link").symlink_to("pictures")
    paths = [*pair(folder / "results"), folder / "link" / "a.svg"]
    places = [p for p in folder.rglob("*") if p.is_dir()]

    def fail() -> None:
        with atomic_files.outputs(paths, False) as temporary:
            for path in temporary:
                path.write_text("half")
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert all(names(place) == set() for place in places)
    write(paths, "new")
    subprocess.run(
        ["sha256sum", "-c", "--strict", "a.adhesion.sha256"], cwd=folder / "results", check=True
    )
    assert "  ../pictures/a.svg\n" in (folder / "results" / "a.adhesion.sha256").read_text()
    paths[0].unlink()
    with pytest.raises(UserError, match="exists already"):
        write(paths, "newer")
    assert paths[2].read_text() == "new"
    write(paths, "newer", force=True)
    assert {p.read_text() for p in paths} == {"newer"}
    assert names(folder / "pictures") == {"a.svg"}


def test_single_file_needs_no_manifest(folder: Path) -> None:
    write([folder / "a.csv"], "new")
    assert names(folder) == {"a.csv"}


def test_single_file_of_a_set_takes_the_manifest_with_it(folder: Path) -> None:
    write(pair(folder), "old")
    write([folder / "a.adhesion.rrd"], "new", force=True)
    assert names(folder) == {"a.adhesion.mcap", "a.adhesion.rrd"}
    (folder / "a.adhesion.sha256").write_text("somebody's own")
    write([folder / "a.adhesion.rrd"], "newer", force=True)
    assert (folder / "a.adhesion.sha256").read_text() == "somebody's own"


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
def test_nothing_is_left_of_a_failed_run(folder: Path, error: type[BaseException]) -> None:
    def fail() -> None:
        with atomic_files.outputs(pair(folder), False) as temporary:
            temporary[0].write_text("half")
            raise error

    with pytest.raises(error):
        fail()
    assert names(folder) == set()
    write(pair(folder), "old")
    with pytest.raises(UserError, match="exists"):
        fail()
    assert {p.read_text() for p in pair(folder)} == {"old"}


@pytest.mark.parametrize("nth", range(6))
def test_of_several_sets_all_appear_or_none(
    folder: Path, nth: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that fails as the nth of their six files is brought to it."""
    calls = iter(range(100))
    fsync = os.fsync

    def failing(descriptor: int) -> None:
        if next(calls) == nth:
            raise OSError(28, "No space left on device")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", failing)
    pairs = [pair(folder), [folder / "b.adhesion.mcap", folder / "b.adhesion.rrd"]]

    def run() -> None:
        with atomic_files.sets(pairs, False) as places:
            for place in (place for of in places for place in of):
                place.write_text("new")

    with pytest.raises(UserError, match="No space left"):
        run()
    assert names(folder) == set()


def test_a_folder_in_the_place_of_the_manifest_destroys_nothing(folder: Path) -> None:
    write(pair(folder), "old")
    (folder / "a.adhesion.sha256").unlink()
    (folder / "a.adhesion.sha256").mkdir()
    with pytest.raises(UserError, match="cannot write the results"):
        write(pair(folder), "new", force=True)
    assert {p.read_text() for p in pair(folder)} == {"old"}


def test_existing_results_need_force(folder: Path) -> None:
    write(pair(folder)[:1], "old")
    with pytest.raises(UserError) as caught:
        write(pair(folder), "new")
    assert (caught.value.code, "--force" in caught.value.hint) == (1, True)
    assert pair(folder)[0].read_text() == "old"
    write(pair(folder), "new", force=True)
    assert {p.read_text() for p in pair(folder)} == {"new"}
    assert manifest_holds(folder)


def test_manifest_left_alone_is_no_result(folder: Path) -> None:
    write(pair(folder), "old")
    for path in pair(folder):
        path.unlink()
    write(pair(folder), "new")
    assert manifest_holds(folder)
    for path in pair(folder):
        path.unlink()
    (folder / "a.adhesion.sha256").write_text("somebody's own")
    with pytest.raises(UserError, match="sha256: exists"):
        write(pair(folder), "newer")
    assert names(folder) == {"a.adhesion.sha256"}


def test_result_that_appeared_meanwhile_is_kept(folder: Path) -> None:
    def late() -> None:
        with atomic_files.outputs(pair(folder), False) as temporary:
            for path in temporary:
                path.write_text("ours")
            pair(folder)[1].write_text("theirs")

    with pytest.raises(UserError, match="exists"):
        late()
    assert names(folder) == {"a.adhesion.rrd"}


@pytest.mark.parametrize("how", ["same", "hard link", "symlink", "folder link"])
def test_output_that_is_the_input_is_refused_even_with_force(tmp_path: Path, how: str) -> None:
    source, target = tmp_path / "log.mcap", tmp_path / "log.adhesion.mcap"
    source.write_text("measured")
    if how == "same":
        target = source
    elif how == "hard link":
        os.link(source, target)
    elif sys.platform == "win32":
        pytest.skip(f"Windows {NO_LINKS}")
    elif how == "symlink":
        target.symlink_to(source)
    else:
        (tmp_path / "other").symlink_to(tmp_path)
        target = tmp_path / "other" / "log.mcap"
    with (
        pytest.raises(UserError, match="input"),
        atomic_files.outputs([target], True, inputs=[source]) as temporary,
    ):
        temporary[0].write_text("computed")
    assert source.read_text() == "measured"


@pytest.mark.parametrize("seconds", [0.2, 99.0])
def test_a_result_that_is_held_open_is_tried_again(
    folder: Path, seconds: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Windows refuses to rename what a viewer or a virus scanner has open."""
    write(pair(folder), "old")
    rename, opened = os.rename, time.monotonic()

    def refuse(source: Path, target: Path) -> None:
        if Path(target) == pair(folder)[1] and time.monotonic() - opened < seconds:
            raise PermissionError(13, "in use")
        rename(source, target)

    monkeypatch.setattr(os, "rename", refuse)
    monkeypatch.setattr(atomic_files.sys, "platform", "win32")
    monkeypatch.setattr(atomic_files, "_PATIENCE", 0.4)
    if seconds < 1.0:
        write(pair(folder), "new", force=True)
    else:
        with pytest.raises(UserError, match=r"a\.adhesion\.rrd: another program") as error:
            write(pair(folder), "new", force=True)
        assert "close it" in error.value.hint
    assert {p.read_text() for p in pair(folder)} == {"new" if seconds < 1.0 else "old"}
    assert manifest_holds(folder)


@pytest.mark.parametrize("name", ["a:b.mcap", "CON", "nul.csv", "com1.rrd", "a.csv ", "a.", "a?b"])
def test_windows_refuses_some_names(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if sys.platform != "win32":
        atomic_files.check([tmp_path / name], False)
    monkeypatch.setattr(atomic_files.sys, "platform", "win32")
    with pytest.raises(UserError, match=r"Windows does not allow this name|no such folder"):
        atomic_files.check([tmp_path / name], False)
    for other in ("console.csv", "control", "com.csv", "a b.csv", "制动.mcap"):
        atomic_files.check([tmp_path / other], False)


@not_on_windows(NO_LINKS)
def test_link_as_output_is_replaced_and_its_target_kept(folder: Path) -> None:
    kept, link = folder / "precious", folder / "a.csv"
    kept.write_text("precious")
    link.symlink_to(kept)
    with pytest.raises(UserError, match="exists"):
        write([link], "new")
    write([link], "new", force=True)
    assert (kept.read_text(), link.is_symlink(), link.read_text()) == ("precious", False, "new")


@not_on_windows(NO_LINKS)
def test_dangling_link_counts_as_existing(tmp_path: Path) -> None:
    (tmp_path / "a.csv").symlink_to(tmp_path / "nowhere")
    with pytest.raises(UserError, match="exists"):
        atomic_files.check([tmp_path / "a.csv"], False)


@not_on_windows("has no pipes in folders")
def test_a_pipe_is_no_output(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "a.csv")
    with pytest.raises(UserError, match="a pipe or a device"):
        atomic_files.check([tmp_path / "a.csv"], True)


def test_the_longest_name_is_replaced(folder: Path) -> None:
    target = folder / ("é" * 125 + "a.csv")  # 255 bytes
    write([target], "old")
    write([target], "new", force=True)
    assert names(folder) == {target.name}
    assert target.read_text() == "new"


def test_missing_folder_folder_as_output_and_double_name(tmp_path: Path) -> None:
    with pytest.raises(UserError, match="no such folder"):
        atomic_files.check([tmp_path / "no" / "a.csv"], False)
    with pytest.raises(UserError, match="is a folder"):
        atomic_files.check([tmp_path], True)
    with pytest.raises(UserError, match="two results"):
        atomic_files.check([tmp_path / "a.csv", tmp_path / "." / "a.csv"], True)


@not_on_windows("has no /proc")
def test_folder_that_takes_no_files(tmp_path: Path) -> None:
    target = Path("/proc/a.csv")  # refuses even root
    with pytest.raises(UserError, match=r"^/proc: ") as caught:
        write([target], "new")
    assert "another folder" in caught.value.hint
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o555)
    if os.geteuid():
        with pytest.raises(UserError, match="cannot be written"):
            atomic_files.check([locked / "a.csv"], False)


# ---- real processes

CHILD = """
import os, signal, sys, time
from pathlib import Path
from adhesion_cli.core.errors import UserError
from adhesion_cli.results import atomic_files
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in the background
folder, text, force = Path(sys.argv[1]), sys.argv[2], sys.argv[3] == "force"
paths = [folder / "a.adhesion.mcap", folder / "a.adhesion.rrd"]
"""
WRITE = """
try:
    with atomic_files.outputs(paths, force) as temporary:
        for path in temporary:
            path.write_text(text)
except UserError as error:
    sys.exit(error.code)
"""
DIE = """
die, step, end = int(sys.argv[4]), 0, lambda: os._exit(9)  # as a kill does
def hook(event, arguments):
    global step
    if event in ("os.rename", "os.remove"):
        step += 1
        if step == die:
            end()
sys.addaudithook(hook)
"""
CONTROL_C = 0xC000013A if sys.platform == "win32" else -signal.SIGINT  # exit code
INTERRUPTED = DIE + "end = lambda: signal.raise_signal(signal.SIGINT)\n"
SETS = """
sets = [paths, [folder / "b.adhesion.mcap", folder / "b.adhesion.rrd"]]
with atomic_files.sets(sets, force) as places:
    for path in (path for of in places for path in of):
        path.write_text(text)
"""


def child(code: str, folder: Path, *arguments: str) -> "subprocess.Popen[str]":
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    words = [str(folder), *arguments]
    if sys.platform == "win32":
        return subprocess.Popen([sys.executable, "-c", CHILD + code, *words], text=True, **pipes)
    return Forked(folder, words, f"{CHILD}{code}\nsys.exit()", bare=True, **pipes)


def assert_whole(folder: Path) -> None:
    """The old result or the new one, never a mixture; nothing else."""
    found = visible(folder)
    assert found <= {"a.adhesion.mcap", "a.adhesion.rrd", "a.adhesion.sha256"}
    texts = {p.read_text() for p in pair(folder) if p.exists()}
    assert len(texts) <= 1
    assert texts <= {"old" * 9, "new" * 9}
    if "a.adhesion.sha256" in found:
        assert manifest_holds(folder)


@pytest.mark.parametrize("before", [False, True], ids=["fresh", "replacing"])
def test_kill_before_every_step_of_publishing(tmp_path: Path, before: bool) -> None:
    for die in range(1, 20):
        folder = tmp_path / str(die)
        folder.mkdir()
        if before:
            write(pair(folder), "old" * 9)
        process = child(DIE + WRITE, folder, "new" * 9, "force", str(die))
        code = process.wait(20)
        assert_whole(folder)
        if before:
            assert pair(folder)[0].exists()  # there always is a record
        if code == 0:
            assert pair(folder)[0].read_text() == "new" * 9
            assert manifest_holds(folder)
            break
        assert code == 9
        write(pair(folder), "new" * 9, force=True)
        assert visible(folder) == {"a.adhesion.mcap", "a.adhesion.rrd", "a.adhesion.sha256"}
    assert die > 2  # it was killed at least at each link


def test_of_several_sets_killed_at_any_step_none_is_new_beside_old(tmp_path: Path) -> None:
    """Every step but the last leaves no manifest either."""
    old, new = "old" * 9, "new" * 9
    kinds = "mcap", "rrd"
    sets = [[tmp_path / f"{name}.adhesion.{kind}" for kind in kinds] for name in "ab"]
    for die in range(1, 30):
        with atomic_files.sets(sets, True) as places:
            for path in (path for of in places for path in of):
                path.write_text(old)
        code = child(DIE + SETS, tmp_path, new, "force", str(die)).wait(20)
        found = {p.name: p.read_bytes() for p in tmp_path.iterdir() if p.is_file()}
        told = {name for name in found if name.endswith(".sha256")}
        assert {found[name].decode() for name in set(found) - told} in ({old}, {new})
        assert not told or len(found) > 4
        if code == 0:
            break
        assert code == 9
    assert len(found) == 6
    assert die > 6


@pytest.mark.parametrize("before", [False, True], ids=["fresh", "replacing"])
def test_an_interrupt_waits_while_names_are_given(tmp_path: Path, before: bool) -> None:
    for die in range(1, 20):
        if before:
            write(pair(tmp_path), "old" * 9, force=True)
        process = child(INTERRUPTED + WRITE, tmp_path, "new" * 9, "force", str(die))
        process.communicate(timeout=20)
        assert {p.read_text() for p in pair(tmp_path)} == {"new" * 9}
        assert manifest_holds(tmp_path)
        assert len(names(tmp_path)) == 3
        if process.returncode == 0:
            break
        assert process.returncode == CONTROL_C
        if not before:
            for path in tmp_path.iterdir():
                path.unlink()
    assert die > 3


def killed_at_random(tmp_path: Path, times: int) -> None:
    loop = "print(flush=True)\nfor text in ['old' * 9, 'new' * 9] * 99999:" + WRITE.replace(
        "\n", "\n    "
    )
    for i in range(times):
        process = child(loop, tmp_path, "", "force")
        assert process.stdout is not None
        process.stdout.readline()
        time.sleep(0.002 + 0.0137 * (i % 7))
        process.kill()
        process.communicate(timeout=20)
        assert_whole(tmp_path)


def test_kill_at_random(tmp_path: Path) -> None:
    killed_at_random(tmp_path, 5)


@pytest.mark.slow
def test_kill_at_random_many_times(tmp_path: Path) -> None:
    killed_at_random(tmp_path, 300)


@not_on_windows("sends no signals to processes")
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_while_writing(tmp_path: Path, number: signal.Signals) -> None:
    wait = WRITE.replace(
        "path.write_text(text)",
        "path.write_text(text)\n        print(flush=True)\n        while True: time.sleep(0.01)",
    )
    process = child(wait, tmp_path, "new", "")
    assert process.stdout is not None
    process.stdout.readline()
    process.send_signal(number)
    process.communicate(timeout=20)
    assert process.returncode != 0
    assert visible(tmp_path) == set()
    assert number == signal.SIGTERM or names(tmp_path) == set()  # the command handles SIGTERM, too


def test_eight_runs_to_one_output(tmp_path: Path) -> None:
    runs = [child(WRITE, tmp_path, "new" * 9, "") for _ in range(8)]
    codes = sorted(run.wait(30) for run in runs)
    for run in runs:
        run.communicate()
    assert codes == [0] + [1] * 7  # one wins, the others are told
    assert manifest_holds(tmp_path)
    runs = [child(WRITE, tmp_path, text * 9, "force") for text in ["old", "new"] * 4]
    assert [run.wait(30) for run in runs] == [0] * 8
    for run in runs:
        run.communicate()
    assert_whole(tmp_path)
    assert manifest_holds(tmp_path)


@not_on_windows("has no limit of the size of files")
@pytest.mark.parametrize("kind", ["mcap", "rrd"])
def test_file_size_limit(tmp_path: Path, kind: str) -> None:
    """What a full disk looks like: writing fails in the middle."""
    code = f"""
import resource
from tests.helpers.made_results import result
from adhesion_cli.results import {kind}
from adhesion_cli.core.errors import UserError
big = result(1, 20_000)
resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, 100_000))
try:
    with atomic_files.outputs(paths, False) as (record, picture):
        if "{kind}" == "mcap":
            mcap.write_results(record, [big], "{{}}")
        else:
            rrd.write_results(picture, [big])
except UserError as error:
    print(error.text)
    sys.exit(error.code)
"""
    process = subprocess.run(
        [sys.executable, "-c", CHILD + code, str(tmp_path), "", ""],
        cwd=Path(__file__).parents[2], capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    assert process.returncode == 1, process.stderr
    assert re.search("cannot write the results", process.stdout)
    assert names(tmp_path) == set()


RESULT = """
from tests.helpers.made_results import result
from adhesion_cli.results import mcap
if force:
    try:
        with atomic_files.outputs(paths, force) as (record, picture):
            mcap.write_results(record, [result(1, 400)], "{}")
            picture.write_text(text)
    except UserError as error:
        sys.exit(error.code)
"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("strace") is None, reason="needs strace")
@pytest.mark.parametrize("fault", FAULTS)
def test_fault_at_every_system_call(tmp_path: Path, fault: str) -> None:
    """The kernel refuses, or the run is killed, at the nth write, fsync, link, rename, unlink."""
    call = fault.split(":")[0]
    python = [sys.executable, "-B", "-c", CHILD + RESULT, str(tmp_path), "new" * 9]
    root = Path(__file__).parents[2]
    write(pair(tmp_path), "old" * 9)
    clean = 0
    for nth in range(1, 60):
        inject = f"-einject={fault}:when={nth}"
        command = ["strace", "-f", "-qq", "-o/dev/null", f"-etrace={call}", inject, *python]
        process = subprocess.run(
            [*command, "force"], cwd=root, capture_output=True, text=True, timeout=60
        )
        found = visible(tmp_path)
        assert found <= {"a.adhesion.mcap", "a.adhesion.rrd", "a.adhesion.sha256"}
        record = pair(tmp_path)[0].read_bytes()
        new = record != b"old" * 9
        if new:
            with pair(tmp_path)[0].open("rb") as file:
                assert list(make_reader(file, validate_crcs=True).iter_messages())
        if pair(tmp_path)[1].exists():
            assert pair(tmp_path)[1].read_text() == ("new" if new else "old") * 9
        if "a.adhesion.sha256" in found:
            assert manifest_holds(tmp_path)
        if process.returncode == 0:
            assert new
            clean += 1
            if clean == 3:
                break
        elif "error" in fault:
            assert process.returncode == 1, process.stderr
            assert names(tmp_path) == found
        write(pair(tmp_path), "old" * 9, force=True)
    assert clean == 3
    assert nth > 3, "the fault never struck"
