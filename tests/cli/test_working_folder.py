"""No module of the working folder is executed: logs come in folders of other people."""

import os
import re
import subprocess
import sys
from importlib.metadata import packages_distributions
from pathlib import Path

import pytest
from helpers.live_runs import SERVICE

from adhesion_cli.cli import app

# Python's own modules, and all that is installed, except this package.
NAMES = sorted({*sys.stdlib_module_names, *packages_distributions()} - {"adhesion_cli"})
CODES = {"inspect": "1", "fleet": "3"}  # the others end with 0
# Elsewhere it would open a window.
VIEWED = "service-brake.adhesion.mcap" if sys.platform == "linux" else "missing.mcap"
COMMANDS = {
    "inspect": ["x.mf4", str(SERVICE)],
    "analyze": [str(SERVICE), "-a", "td", "--table", "x.parquet", "-o", "."],
    "compare": ["service-brake.adhesion.mcap"],
    "stops": [str(SERVICE), "-o", "."],
    "fleet": [str(SERVICE), "x.mf4", "-a", "td", "--workers", "1"],
    "slip": [str(SERVICE), "--axle", "1"],
    "calibrate": [str(SERVICE)],
    "live": ["--replay", str(SERVICE), "--speed", "0", "-a", "td", "-o", "."],
    "explain": ["gap"],
    "convert": [str(SERVICE), "x.csv"],
    "report": ["service-brake.adhesion.mcap", "-o", "y.html"],
    "view": [VIEWED],
    "estimators": [],
    "vehicle": ["metro"],
    "export-c": ["td", "-o", "c"],
}
RUN = """
import os, runpy, sys
sys.path[0] = os.getcwd()  # as `python -m` does
for words in sys.argv[1:]:
    sys.argv = ["-m", *words.split("|")]
    try:
        runpy.run_module("adhesion_cli", run_name="__main__", alter_sys=True)
    except SystemExit as end:
        print("\\nended", words.partition("|")[0], end.code)
"""


@pytest.fixture
def hostile(tmp_path: Path) -> Path:
    """A folder with a module of every name, each of which says that it was executed."""
    folder = tmp_path / "logs"
    folder.mkdir()
    for name in filter(str.isidentifier, NAMES):
        text = f"import os\nopen({str(tmp_path / 'executed')!r}, 'a').write({name!r} + chr(10))\n"
        (folder / f"{name}.py").write_text(text + "os._exit(9)\n", "utf-8")
    (folder / "x.mf4").write_bytes(b"MDF     4.10    x".ljust(999, b"\0"))
    return folder


@pytest.mark.parametrize(
    "left_out",
    [
        pytest.param({"calibrate", "compare", "fleet", "live", "slip", "stops"}, id="some"),
        pytest.param(set(), id="all", marks=pytest.mark.slow),
    ],
)
def test_no_command_executes_a_module_of_the_working_folder(
    hostile: Path, left_out: set[str]
) -> None:
    names = [name for name in app._COMMANDS if name not in left_out]
    commands = {name: COMMANDS.get(name, ["--help"]) for name in names}
    (hostile.parent / "run.py").write_text(RUN, "utf-8")
    words = ["|".join([name, *more]) for name, more in commands.items()]
    made = subprocess.run(
        [sys.executable, hostile.parent / "run.py", *words],
        cwd=hostile, capture_output=True, text=True, check=False,
        env={**os.environ, "DISPLAY": ":7777"},
    )  # fmt: skip
    executed = hostile.parent / "executed"
    assert not executed.exists(), executed.read_text()
    codes = dict(re.findall(r"(?m)^ended (\S+) (\d+)$", made.stdout))
    codes.pop("view")  # its viewer starts, and finds no display, or the one of another test
    assert codes == {n: CODES.get(n, "0") for n in commands if n != "view"}, made.stderr


def test_the_program_itself_is_loaded_from_where_it_is(hostile: Path) -> None:
    """By `python -m`, too; what Python itself imports before the program is not ours."""
    code = "import runpy, sys; print(*sys.modules)"
    before = subprocess.run([sys.executable, "-P", "-c", code], capture_output=True, check=True)
    for name in before.stdout.decode().split():
        (hostile / f"{name}.py").unlink(missing_ok=True)
    made = subprocess.run(
        [sys.executable, "-m", "adhesion_cli", "estimators"],
        cwd=hostile, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert not (hostile.parent / "executed").exists()
    assert (made.returncode, "imm" in made.stdout) == (0, True), made.stderr
