"""Compiled code: same numbers as plain Python, kept on disk, never stale."""

import ast
import json
import math
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from helpers.systems import not_on_windows
from hypothesis import given
from hypothesis import strategies as st

import adhesion_cli
from adhesion_cli.core import cache_folder, compiled, estimator
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset

PACKAGE = Path(adhesion_cli.__file__).parent

BATCH = """
import json, sys
import numpy as np
from adhesion_cli.core import compiled, estimator
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
est = estimator.registry()[sys.argv[1]]
w = wheelset(Vehicle(), 1)
t = np.arange(200) * 1_000_000
K, y = np.full(200, 21e3), 40.0 - 2e-9 * t
F = compiled.batch(est, est.Params(), w, t, K, y, np.array([0]))[0]
state, online = None, []
for K_now, y_now in zip(K.tolist(), y.tolist()):
    state = estimator.advance(est, est.Params(), w, state, 1_000_000 * 1e-9, K_now, y_now)
    online.append(state.F)
print(json.dumps([F.tolist(), online]))
"""
TOLD = """
from adhesion_cli.core import compiled
told = []
compiled.report = told.append
"""
AGAIN = """
import os
from pathlib import Path
def machine_code():
    return {x: x.stat().st_mtime_ns for x in Path(os.environ["XDG_CACHE_HOME"]).rglob("*.nbc")}
def run_again():
    compiled._compiled.cache_clear()
    assert np.array_equal(compiled.batch(est, est.Params(), w, t, K, y, np.array([0]))[0], F)
for folder in sys.argv[2:]:
    os.environ["XDG_CACHE_HOME"] = folder
    run_again()
    assert any("damaged" in x for x in told) == (Path(folder).name != "no text"), (folder, told)
    told.clear()
    before = machine_code()
    run_again()
    assert before
    assert machine_code() == before  # whole again
    assert not told
    assert all(x.stat().st_size for x in Path(folder).rglob("batch_td.*"))
"""


@pytest.fixture(scope="module")
def copy(tmp_path_factory):
    """A copy of the package, free to be edited."""
    path = tmp_path_factory.mktemp("source")
    shutil.copytree(PACKAGE, path / PACKAGE.name, ignore=shutil.ignore_patterns("__pycache__"))
    return path


def start(path, code, *arguments, **environment):
    environment = {**os.environ, **{k: str(v) for k, v in environment.items()}}
    environment |= {"PYTHONPATH": str(path), "PYTHONDONTWRITEBYTECODE": "1"}
    command = [sys.executable, "-c", code, *map(str, arguments)]
    pipe = subprocess.PIPE
    return subprocess.Popen(command, cwd=path, env=environment, stdout=pipe, stderr=pipe, text=True)


def answer(process):
    out, err = process.communicate(timeout=120)
    assert process.returncode == 0, err
    return out


@pytest.fixture(scope="module")
def filled(copy, tmp_path_factory):
    """A cache that two processes filled at once with the loop of leso, and each answer."""
    cache = tmp_path_factory.mktemp("cache")
    racing = [start(copy, BATCH, "leso", XDG_CACHE_HOME=cache) for _ in range(2)]
    return cache, *map(answer, racing)


def machine_code(cache):
    return {path: path.stat().st_mtime_ns for path in cache.rglob("*.nbc")}


class Pair(NamedTuple):
    a: float
    b: float


def halved(x):
    return 0.5 * x


def swapped(pair, x):
    return Pair(halved(pair.b) + x, math.exp(-abs(pair.a)))


def ratio(a, b):
    return a / b


number = st.floats(-1e6, 1e6)


def test_compiling_is_told_once_for_a_cache(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    told: list[str] = []
    monkeypatch.setattr(compiled, "cache_folder", lambda: tmp_path)
    monkeypatch.setattr(compiled, "report", told.append)
    for _ in range(2):
        compiled._compiled.cache_clear()
        assert compiled.function(ratio)(1.0, 4.0) == 0.25
        assert len(told) == 1


@given(a=number, b=number, x=number)
def test_function_is_the_plain_function(a, b, x):
    assert compiled.function(swapped)(Pair(a, b), x) == swapped(Pair(a, b), x)


def test_no_result_is_made_by_calling_python() -> None:
    """A tuple is: with a signal pending, numba crashes at it."""
    texts = {path: path.read_text("utf-8") for path in PACKAGE.rglob("*.py")}
    called = {
        (place, name)
        for path, text in texts.items()
        for module, name in re.findall(r"\bcompiled\.function\((?:(\w+)\.)?(\w+)", text)
        for place in (path.parent.glob("*.py") if module else [path])
    }
    returned = {
        (place, node.name): ast.unparse(node.returns)
        for place in {place for place, _ in called}
        for node in ast.parse(texts[place]).body
        if isinstance(node, ast.FunctionDef) and node.returns
    }
    called &= returned.keys()
    assert len(called) > 5
    assert {returned[x] for x in called} <= {"None", "bool", "int", "float"}


INTERRUPTED = """
import signal
from dataclasses import replace
from adhesion_cli.wsp import closed_loop, scenario
case = scenario.load("slippery-stop")
closed_loop.run(replace(case, train=scenario.ScenarioTrain(1.0)), "none")  # compiled
signal.signal(signal.SIGALRM, signal.default_int_handler)
signal.setitimer(signal.ITIMER_REAL, 0.02, 0.02)  # one alone may come where Python ignores it
try:
    closed_loop.run(case, "none")
finally:
    signal.setitimer(signal.ITIMER_REAL, 0.0)
"""


@not_on_windows("has no alarm clock")
def test_a_signal_in_a_compiled_stop_is_heard_at_its_end() -> None:
    with start(PACKAGE.parent, INTERRUPTED) as process:
        _, err = process.communicate(timeout=120)
    assert process.returncode == -signal.SIGINT, err
    assert "KeyboardInterrupt" in err


def test_division_by_zero_is_inf():
    assert compiled.function(ratio)(1.0, 0.0) == math.inf


def test_processes_may_start_at_once_and_an_edited_helper_is_noticed(copy, filled, tmp_path):
    """And nothing is compiled again while nothing changed."""

    def run():
        return json.loads(answer(start(copy, BATCH, "leso", XDG_CACHE_HOME=tmp_path)))

    cache, first, second = filled
    assert first == second
    batch, online = json.loads(first)
    assert batch == online
    shutil.copytree(cache, tmp_path, dirs_exist_ok=True)
    kept = machine_code(tmp_path)
    assert kept
    assert run()[0] == batch
    assert machine_code(tmp_path) == kept

    helper = copy / PACKAGE.name / "estimators" / "_linear_observer.py"
    text = helper.read_text(encoding="utf-8")
    assert "sigma = 0.5 * beta1" in text
    try:
        helper.write_text(
            text.replace("sigma = 0.5 * beta1", "sigma = 0.4 * beta1"), encoding="utf-8"
        )
        edited, online = run()
    finally:
        helper.write_text(text, encoding="utf-8")
    assert edited == online
    assert edited != batch


@pytest.mark.skipif(sys.platform != "linux", reason="the cache is elsewhere")
@pytest.mark.parametrize("kind", ["no folder", "mine", "of another user", "open to others"])
def test_where_the_cache_is(tmp_path, monkeypatch, kind):
    """What lies in the cache is run: without a folder of the user's own there is none to keep."""
    home, temporary = tmp_path / "home", tmp_path / "tmp"
    temporary.mkdir()
    monkeypatch.setenv("XDG_CACHE_HOME", str(home))
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    told: list[str] = []
    monkeypatch.setattr(cache_folder, "report", told.append)
    if kind == "no folder":
        home.write_text("a file")
    elif kind != "mine":
        (home / "adhesion-cli").mkdir(parents=True)
        mode, user = (0o777, os.getuid()) if kind == "open to others" else (0o755, 12345)
        os.chmod(home / "adhesion-cli", mode)
        monkeypatch.setattr(os, "geteuid", lambda: user)
    folder = compiled._folder("key")
    assert compiled._folder("other").parent == folder.parent
    assert len(told) == (kind != "mine")
    assert folder.is_relative_to(home if kind == "mine" else temporary)
    assert folder.is_dir()


def test_a_process_without_a_cache_leaves_nothing_and_its_children_share_it(tmp_path):
    (tmp_path / "tmp").mkdir()
    (tmp_path / "file").touch()
    code = """
import os
from adhesion_cli.core import cache_folder, children
cache_folder.report = print
folder = str(cache_folder.cache_folder())
for _ in range(3):
    child = children.Child()
    print(str(child.call(cache_folder.cache_folder)) == folder, os.path.isdir(folder))
    child.end()
"""
    told = answer(
        start(PACKAGE.parent, code, XDG_CACHE_HOME=tmp_path / "file", TMPDIR=tmp_path / "tmp")
    )
    assert told.splitlines()[1:] == ["True True"] * 3
    assert told.startswith(f"{tmp_path / 'file' / 'adhesion-cli'}: not used, it cannot be written")
    assert not list((tmp_path / "tmp").iterdir())


@pytest.mark.skipif(sys.platform != "linux", reason="the cache is elsewhere")
def test_old_folders_go(tmp_path, monkeypatch):
    root = tmp_path / "adhesion-cli"
    root.mkdir(mode=0o700)
    for i in range(compiled._KEPT_FOLDERS + 4):
        folder = root / f"{i:016x}"
        folder.mkdir()
        os.utime(folder, (i, i))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    latest = compiled._folder("key")
    left = {path.name for path in root.iterdir()}
    assert left == {latest.name, *(f"{i:016x}" for i in range(5, compiled._KEPT_FOLDERS + 4))}


def test_importing_compiles_nothing(copy):
    code = (
        "import sys, adhesion_cli.core.compiled, adhesion_cli.core.estimator as e; e.registry();"
        "print(*sys.modules)"
    )
    assert "numba" not in answer(start(copy, code)).split()


def test_no_samples_no_answer():
    est = estimator.registry()["leso"]
    none, no_times = np.zeros(0), np.zeros(0, np.int64)
    w = wheelset(Vehicle(), 1)
    assert compiled.batch(est, est.Params(), w, no_times, none, none, no_times)[0].shape == (0,)


def test_a_damaged_cache_costs_time_and_no_run(
    copy: Path, filled: tuple[Path, str, str], tmp_path: Path
) -> None:
    """The first one is that of a fresh process."""
    cache, good, _ = filled
    damages = {
        "half of the code": ("*.nbc", 0.5),
        "half an index": ("*.nbi", 0.5),
        "empty index": ("*.nbi", 0.0),
        "no text": ("batch_leso.py", 0.0),
    }
    for name, (pattern, share) in damages.items():
        shutil.copytree(cache, tmp_path / name)
        (path,) = (tmp_path / name).rglob(pattern)
        whole = path.read_bytes()
        path.write_bytes(whole[: int(share * len(whole))])
    folders = [tmp_path / name for name in damages]
    process = start(copy, TOLD + BATCH + AGAIN, "leso", *folders, XDG_CACHE_HOME=folders[0])
    assert answer(process) == good


@not_on_windows("has no limit of the size of files")
def test_a_cache_on_a_full_disk_is_done_without(
    copy: Path, filled: tuple[Path, str, str], tmp_path: Path
) -> None:
    full = "import resource, signal\nsignal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
    full += "resource.setrlimit(resource.RLIMIT_FSIZE, (0, resource.RLIM_INFINITY))\n"
    assert answer(start(copy, full + BATCH, "leso", XDG_CACHE_HOME=tmp_path)) == filled[1]
