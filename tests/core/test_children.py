"""Child processes: their calls, errors and ends."""

import os
import pickle
import signal
import sys
import threading
import time
from pathlib import Path

import pytest
from helpers.systems import not_on_windows

from adhesion_cli.core import children
from adhesion_cli.core.children import Child, ChildDiedError


def answer_late(begun: str) -> str:
    """Says that it has begun, and answers after a while."""
    Path(begun).touch()
    time.sleep(1.0)
    return "late"


def slowly(x: int, seconds: float) -> int:
    """The same number, after a while."""
    time.sleep(seconds)
    return x


def test_an_error_comes_back_with_its_trace_and_the_child_works_on() -> None:
    child = Child()
    try:
        assert child.call(os.getpid) == child.pid
        with pytest.raises(FileNotFoundError) as error:
            child.call(os.stat, "/no such file")
        assert "Traceback" in str(error.value.__cause__)
        assert child.call(os.getpid) == child.pid
    finally:
        child.end()


def test_a_child_that_dies_is_an_error_with_its_code() -> None:
    child = Child()
    with pytest.raises(ChildDiedError) as error:
        child.call(os._exit, 7)
    assert error.value.code == 7
    assert not child.is_usable


def test_an_interrupted_call_ends_the_child(tmp_path: Path) -> None:
    """Else its answer would be taken for that to the next call."""
    child, begun = Child(), tmp_path / "begun"

    def interrupt() -> None:
        while not begun.exists():
            time.sleep(0.01)
        signal.raise_signal(signal.SIGINT)

    thread = threading.Thread(target=interrupt)
    previous = signal.signal(signal.SIGINT, signal.default_int_handler)  # whatever ran before
    thread.start()
    with pytest.raises(KeyboardInterrupt):
        child.call(answer_late, str(begun))
    thread.join()
    signal.signal(signal.SIGINT, previous)
    assert not child.is_usable


class Interrupted(BaseException):
    """As a notebook or a timeout raises it, at any time."""


@not_on_windows("has no alarm clock")
@pytest.mark.parametrize("instants", [25, pytest.param(140, marks=pytest.mark.slow)])
def test_no_answer_is_lost_or_taken_for_another(instants: int) -> None:
    """Calls that are interrupted at some instant, each followed by one that is not."""

    def interrupt(number: int, frame: object) -> None:
        raise Interrupted

    interrupted, child = 0, Child()
    before = signal.signal(signal.SIGALRM, interrupt)
    try:
        for k in range(instants):
            child = child if child.is_usable else Child()
            assert child.call(abs, -k) == k
            signal.setitimer(signal.ITIMER_REAL, 1e-4 * (1 + 8 * (k % 20)))
            try:
                assert child.call(slowly, k, 4e-4 * (k % 7)) == k
            except Interrupted:
                interrupted += 1
            finally:
                signal.setitimer(signal.ITIMER_REAL, 0.0)
            assert not child.is_usable or child.call(abs, k) == k
    finally:
        signal.signal(signal.SIGALRM, before)
        child.end()
    assert interrupted > instants / 6


def test_an_answer_to_another_call_ends_the_child() -> None:
    child = Child()
    pipe = child._process.stdin
    assert pipe is not None
    pickle.dump(pickle.dumps((99, os.getcwd, ())), pipe)
    with pytest.raises(ChildDiedError):
        child.call(os.getpid)
    assert not child.is_usable


def test_modules_of_the_working_folder_are_not_imported(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("json", "pickle", "signal", "numpy"):
        (tmp_path / f"{name}.py").write_text("import os; os._exit(9)\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend("")  # as in an interactive Python
    monkeypatch.syspath_prepend(str(tmp_path))  # as by `python -m`, of a Dask worker too
    child = Child()
    try:
        assert child.call(os.getcwd) == str(tmp_path)
    finally:
        child.end()


def test_a_child_runs_the_package_of_its_caller_where_another_one_is_installed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "adhesion_cli").mkdir()
    (tmp_path / "adhesion_cli" / "__init__.py").write_text("import os; os._exit(9)\n")
    clone = Path(children.__file__).parents[2]
    monkeypatch.chdir(clone)
    monkeypatch.setattr(sys, "path", [str(clone), str(tmp_path), *sys.path])
    child = Child()
    try:
        assert child.call(os.getcwd) == str(clone)
    finally:
        child.end()


def test_the_time_of_a_call_begins_when_its_process_works_for_it() -> None:
    """A thread that waits for the call of another one loses none of its time."""
    child, answers = Child(), []

    def ask() -> None:
        answers.append(child.call(time.sleep, 1.0, seconds=1.8))

    threads = [threading.Thread(target=ask) for _ in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    child.end()
    assert answers == [None, None]


def test_a_call_that_does_not_end_ends_the_child() -> None:
    child = Child()
    with pytest.raises(ChildDiedError) as error:
        child.call(time.sleep, 60.0, seconds=0.5)
    assert error.value.was_late
    assert not child.is_usable
