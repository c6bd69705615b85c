"""What each part of the package may import."""

import ast
import re
import subprocess
import sys
from pathlib import Path

import pytest
from helpers.forked import Forked

from adhesion_cli.cli.app import app
from adhesion_cli.core.bundled import SAMPLE, folder

ROOT = Path(__file__).parents[1]
HEAVY = ["numpy", "scipy", "numba", "pyarrow", "rerun", "mcap", "rich"]


def test_the_contracts_between_packages_hold() -> None:
    code = "import sys; from importlinter.cli import lint_imports_command as f; sys.exit(f())"
    command = [sys.executable, "-c", code, "--no-cache"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout


def test_the_hashes_are_of_the_versions_that_are_tested() -> None:
    """And of all packages; those that build the package, pip takes by itself."""

    def versions(name: str) -> dict[str, str]:
        text = (ROOT / name).read_text(encoding="utf-8")
        pairs = re.findall(r"(?m)^([\w.-]+)==([\w.]+)", text)
        return {re.sub(r"[-_.]+", "-", package).lower(): version for package, version in pairs}

    tested, hashed = versions("constraints.txt"), versions("constraints-hashes.txt")
    assert tested.keys() - hashed.keys() <= {"hatchling"}
    assert {k: v for k, v in hashed.items() if k in tested} == {
        k: v for k, v in tested.items() if k in hashed
    }


@pytest.fixture(scope="module")
def trees() -> dict[Path, ast.Module]:
    """The modules of the package, parsed."""
    paths = sorted(ROOT.glob("adhesion_cli/**/*.py"))
    return {path: ast.parse(path.read_text(encoding="utf-8")) for path in paths}


def test_no_function_is_longer_than_a_screen(trees: dict[Path, ast.Module]) -> None:
    """Below its signature and its docstring, which state shapes, units and errors a line each."""

    def body_lines(node: ast.FunctionDef) -> int:
        first = node.body[1 if ast.get_docstring(node) and len(node.body) > 1 else 0]
        return (node.end_lineno or 0) - first.lineno

    long = [
        f"{path.relative_to(ROOT)}:{node.lineno} {node.name}"
        for path, tree in trees.items()
        for node in ast.walk(tree)
        if isinstance(node, ast.FunctionDef) and body_lines(node) >= 60
    ]
    assert not long


def test_few_modules_lie_at_the_top_and_no_folder_is_large() -> None:
    folders: dict[Path, list[Path]] = {}
    for path in ROOT.glob("adhesion_cli/**/*.py"):
        folders.setdefault(path.parent, []).append(path)
    assert len(folders[ROOT / "adhesion_cli"]) <= 6
    lines = {
        str(folder): sum(p.read_text(encoding="utf-8").count("\n") for p in paths)
        for folder, paths in folders.items()
    }
    assert not {folder: n for folder, n in lines.items() if n > 4000}


def test_help_imports_nothing_heavy(tmp_path: Path) -> None:
    """Of one command after the other, in one process."""
    commands = [c.name for c in app.registered_commands]
    code = f"""
from contextlib import suppress
for command in {commands}:
    sys.argv = ["adhesion", command, "--help"]
    with suppress(SystemExit):
        __main__.main()
    print(command, {{*{HEAVY}}} & {{*sys.modules}}, end="\\0")
sys.exit()
"""
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = Forked(tmp_path, [], code, bare=True, **pipes)
    out, err = process.communicate(timeout=60)
    assert process.returncode == 0, err
    *texts, _ = out.split("\0")
    for command, text in zip(commands, texts, strict=True):
        assert f"Example: adhesion {command}" in text
        assert text.endswith(f"\n{command} set()"), text[-200:]


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> set[str]:
    """The modules that `analyze` loads; refused tries are among them."""
    log = folder("sample_logs") / SAMPLE
    done = subprocess.run(
        [sys.executable, "-X", "importtime", "-m", "adhesion_cli", "analyze", str(log)],
        cwd=tmp_path_factory.mktemp("loaded"), capture_output=True, text=True, check=True,
    )  # fmt: skip
    return {line.rpartition("|")[2].strip() for line in done.stderr.splitlines()}


def test_the_main_job_does_not_wait_for_what_it_does_not_use(loaded: set[str]) -> None:
    assert "adhesion_cli.analysis.analyze" in loaded
    assert not {"scipy.signal", "scipy.optimize"} & loaded


def test_analyze_does_not_load_pandas_which_arrow_would(loaded: set[str]) -> None:
    pytest.importorskip("pandas")
    assert "pyarrow.lib" in loaded
    assert "pandas.core.api" not in loaded


def test_a_class_name_stands_once(trees: dict[Path, ast.Module]) -> None:
    """Except the names that every estimator, check or format defines by its contract."""
    names = [n.name for tree in trees.values() for n in tree.body if isinstance(n, ast.ClassDef)]
    by_contract = {"About", "Params", "State", "Reader"}
    assert not {name for name in names if names.count(name) > 1} - by_contract
