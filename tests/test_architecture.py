"""The arrows between modules, walked on the imports themselves."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import adhesion_cli
from adhesion_cli.bundled import SAMPLE, folder
from adhesion_cli.cli.app import app

PACKAGE = Path(adhesion_cli.__file__).parent

# From bottom to top: a module may import only from layers below its own, or from its own folder.
LAYERS = [
    {"__init__", "errors", "bundled"},
    {"model", "text", "toml"},
    {"physics", "methods", "stop"},
    {"estimator", "controller", "signals"},
    {"estimators", "compiled", "rail", "slope", "trainspeed"},
    {"events", "runout", "smoother", "controllers"},
    {"railfit"},
    {"reference"},
    {"metrics", "read", "write"},
    {"scenario"},
    {"plant"},
    {"simulate"},
    {"unit"},
    {"antiskid"},
    {"sweep"},
    {"settings"},
    {"slip"},
    {"document"},
    {"analysis", "figures", "inspection", "replay", "response"},
    {"reproduce"},
    {"cli"},
    {"__main__"},
]
OWNERS = {
    "numba": {"compiled"},
    "rerun": {"write/rrd"},
    "mcap": {"read/mcap_records", "write/container", "write/mcap"},
}


def imports(path: Path) -> set[tuple[str, int]]:
    """Modules a file imports, (dotted name, relative level), wherever in the file it does."""
    found: set[tuple[str, int]] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {(a.name, 0) for a in node.names}
        elif isinstance(node, ast.ImportFrom):
            if node.module:
                found.add((node.module, node.level))
            else:
                found |= {(a.name, node.level) for a in node.names}
    return found


def test_no_arrow_runs_backwards() -> None:
    layer = {name: i for i, names in enumerate(LAYERS) for name in names}
    wrong = []
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).with_suffix("").parts
        assert place[0] in layer, f"{place[0]} has no layer: say where it stands in LAYERS"
        for name, level in imports(path):
            if level == 0 or level < len(place):
                continue  # foreign, or of the same folder
            target = name.split(".")[0]
            if target in layer and layer[target] >= layer[place[0]] and target != place[0]:
                wrong.append(f"{'/'.join(place)} -> {name}")
    assert not wrong


def test_one_place_knows_each_heavy_library() -> None:
    wrong = []
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).with_suffix("").as_posix()
        for name, level in imports(path):
            owners = OWNERS.get(name.split(".")[0], {place})
            if level == 0 and owners.isdisjoint({place, place.rpartition("/")[0]}):
                wrong.append(f"{place} imports {name}")
    assert not wrong


@pytest.mark.parametrize("command", [c.name for c in app.registered_commands])
def test_help_imports_nothing_heavy(command: str) -> None:
    code = (
        "import sys\nfrom adhesion_cli.cli.app import app\n"
        f"try: app([{command!r}, '--help'], standalone_mode=False)\nexcept SystemExit: pass\n"
        "heavy = {'numpy', 'scipy', 'numba', 'pyarrow', 'rerun', 'mcap'} & set(sys.modules)\n"
        "sys.exit(f'imported {heavy}' if heavy else 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert f"Example: adhesion {command}" in done.stdout


def test_the_main_job_does_not_wait_for_what_it_does_not_use(tmp_path: Path) -> None:
    arguments = ["analyze", str(folder("sample_logs") / SAMPLE), "-o", str(tmp_path)]
    code = (
        "import sys\nfrom adhesion_cli.cli.app import app\n"
        f"app({arguments}, standalone_mode=False)\n"
        "print({'scipy.linalg', 'scipy.signal', 'scipy.optimize'} & set(sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "set()"
