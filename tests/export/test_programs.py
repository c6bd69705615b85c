"""The files of an export: they compile strictly, their tests pass, checkers accept them."""

import os
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from helpers.c_library import tool
from helpers.grids import thinned

from adhesion_cli.core import physics
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import FrictionTable, Parameter, Vehicle
from adhesion_cli.export import files, vectors
from adhesion_cli.export.c_types import DOUBLE
from adhesion_cli.export.interface import Interface
from adhesion_cli.export.translate import Translation

METHODS = list(files.methods())


@pytest.fixture(scope="session")
def exports(tmp_path_factory):
    """The folder of each export; made when it is first asked for."""
    made: dict[tuple[str, bool], Path] = {}

    def folder(name, double):
        if (name, double) not in made:
            place = made[name, double] = tmp_path_factory.mktemp(name)
            for file, text in files.export(name, {}, Vehicle(), double=double).texts.items():
                (place / file).write_text(text, encoding="utf-8")
        return made[name, double]

    return folder


def make(folder, *arguments):
    done = subprocess.run(
        [tool("make"), "-C", str(folder), *arguments], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


# Each is compiled by the tests of its bits, too.
@pytest.mark.parametrize(("name", "double"), thinned(5, METHODS, [True, False]))
def test_the_test_of_an_export_passes(exports, name, double):
    tool("gcc")
    said = make(exports(name, double), "test", "CC=gcc")
    assert f"adhesion_{name}: 1801 samples, passed" in said
    errors = [float(x) for x in re.findall(r"largest error (\S+),", said)]
    assert errors
    if double:
        assert errors == [0.0] * len(errors)


@pytest.mark.slow
@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("name", METHODS)
def test_other_compilers_and_sanitizers(exports, name, double):
    folder = exports(name, double)
    make(folder, "sanitize", "CC=gcc")
    make(folder, "clean", "test", "CC=gcc", "CFLAGS=-Os")  # without inlining
    strict = "" if double else " -Wdouble-promotion"
    said = make(folder, "clean", "test", f"CC={tool('clang')}{strict}")
    assert not double or set(re.findall(r"largest error (\S+),", said)) == {"0"}


@pytest.mark.slow
@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("name", METHODS)
def test_misra(exports, name, double):
    """cppcheck and its addon report nothing but the deviations that the README lists."""
    tool("cppcheck")
    make(exports(name, double), "misra")


@pytest.mark.slow
@pytest.mark.parametrize("double", [True, False])
@pytest.mark.parametrize("name", METHODS)
def test_a_32_bit_arm(exports, name, double):
    """Another C library and another floating-point unit: within the limits of the test."""
    gcc, run = tool("arm-none-eabi-gcc"), tool("qemu-arm")
    folder = exports(name, double)
    flags = "-mcpu=cortex-a7 -mfpu=vfpv4 -mfloat-abi=hard --specs=rdimon.specs"
    make(folder, "clean", f"test_{name}", f"CC={gcc} {flags}")
    done = subprocess.run(
        [run, folder / f"test_{name}"], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "passed" in done.stdout


@pytest.mark.parametrize("name", METHODS)
def test_the_library_asks_for_no_memory_and_has_no_variables(name, tmp_path):
    """Of the C library it needs mathematics only; its data segments are empty."""
    method, w = files.methods()[name], physics.wheelset(Vehicle(), 1)
    vehicle = (w.radius, w.phi, w.inertia, w.mass)
    code = Interface(method, method.Params(), vehicle, DOUBLE, "test").code()
    (tmp_path / f"adhesion_{name}.h").write_text(code.header, encoding="ascii")
    (tmp_path / f"adhesion_{name}.c").write_text(code.source, encoding="ascii")
    place = tmp_path / "a.o"
    source = str(tmp_path / f"adhesion_{name}.c")
    subprocess.run([tool("gcc"), "-std=c99", "-O1", "-c", source, "-o", str(place)], check=True)
    listed = subprocess.run([tool("nm"), str(place)], capture_output=True, text=True, check=True)
    symbols = [line.split()[-2:] for line in listed.stdout.splitlines()]
    variables = [symbol for kind, symbol in symbols if kind in "bBdDC"]
    needed = {symbol for kind, symbol in symbols if kind == "U"}
    mathematics = {
        "sqrt",
        "exp",
        "expm1",
        "pow",
        "sin",
        "cos",
        "sincos",
        "ceil",
        "floor",
        "erfc",
    }
    assert variables == []
    assert needed <= mathematics | {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail", "memcpy"}


def test_the_readme_states_the_figures_of_the_run():
    made = files.export("td", {"td": {"h0": 0.1}}, Vehicle(), double=False)
    readme = made.texts["README.md"]
    assert "| `h0` | 0.1 | s | 0 to 10 | filter step" in readme
    (stated,) = re.findall(r"\| F \| (\S+) N \|", readme)
    assert float(stated) == pytest.approx(made.single_error, rel=0.06)  # of its two digits
    assert 0.0 < made.single_error < 5.0
    assert all(x.isascii() for x in (made.texts["adhesion_td.h"], made.texts["adhesion_td.c"]))


def test_a_fade_of_the_friction_is_in_the_formula_of_k():
    """By it, the inputs of the vectors follow from pressure and speed of the log."""
    fade = Vehicle(friction_fade=Parameter(-0.004, 0.0), friction_speed=Parameter(10.0, 0.0))
    readme = files.export("td", {}, fade).texts["README.md"]
    (per, zero) = re.search(r"K = (\S+) N/Pa · p − (\S+) N", readme).groups()
    (slope, at) = re.search(r"1 \+ (\S+) s/m · \(R y − (\S+) m/s\)", readme).groups()
    p, y = 3e5, 30.0
    K = max(float(per) * p - float(zero), 0.0)
    K *= max(1.0 + float(slope) * (0.42 * y - float(at)), 0.1)
    share = physics.friction_share(np.array([0.42 * y]), np.array([K]), fade)[0]
    assert pytest.approx(share * physics.clamping_force(np.array([p]), fade)[0], rel=1e-5) == K
    assert "1 +" not in files.export("td", {}, Vehicle()).texts["README.md"]


def test_a_friction_table_is_in_the_readme():
    table = FrictionTable((0.0, 20.0), (1e4, 5e4), ((0.4, 0.2), (0.3, 0.18)))
    vehicle = Vehicle(friction=Parameter(0.18, 0.018), friction_table=table)
    readme = files.export("td", {}, vehicle).texts["README.md"]
    assert "| K | 0 m/s | 20 m/s |" in readme
    assert "| 10000 N | 2.22222 | 1.11111 |" in readme


def test_cpp_links_with_the_c(exports, tmp_path):
    folder = exports("td", True)
    (tmp_path / "main.cpp").write_text(
        '#include "adhesion_td.h"\n'
        "int main() { adhesion_td_params p = adhesion_td_defaults(); return p.h0 > 0.0 ? 0 : 1; }\n"
    )
    made, c = str(tmp_path / "a.o"), str(folder / "adhesion_td.c")
    subprocess.run([tool("gcc"), "-std=c99", "-c", c, "-o", made], check=True)
    program = str(tmp_path / "a.out")
    subprocess.run(
        [tool("g++"), f"-I{folder}", str(tmp_path / "main.cpp"), made, "-lm", "-o", program],
        check=True,
    )
    subprocess.run([program], check=True)


def test_settings_are_the_defaults_of_the_c():
    text = files.export("leso", {"leso": {"beta1": 77.5}}, Vehicle()).texts["adhesion_leso.c"]
    assert "(adhesion_leso_params){77.5, 216.0, 0.0}" in text


def test_parameters_that_are_unstable_on_the_log_are_refused():
    with pytest.raises(UserError, match=r"an interval of 0.02 s is unstable with euler = 1"):
        files.export("leso", {"leso": {"euler": 1.0}}, Vehicle())


def rises(x: float) -> float:
    total = 0.0
    while x > 0.0:
        total += 1.0
    return total


def square(x: float) -> float:
    return x**2


def endless(x: float) -> float:
    for _ in range(int(x)):
        x = x + 1.0
    return x


def itself(x: float) -> float:
    return itself(x)


def mixed(x: float) -> float:
    return x + 1


def reads(x: float) -> float:
    return float(os.environ["X"])


@pytest.mark.parametrize(
    ("f", "why"),
    [
        (rises, "While is not in the subset"), (square, "x \\* x"), (endless, "states no SUBSTEPS"),
        (itself, "calls itself"), (mixed, "write 1.0"), (reads, "Subscript|neither|index"),
    ],
)  # fmt: skip
def test_what_c_would_do_otherwise_is_refused(f, why):
    """With file and line."""
    c = Translation("adhesion_x", DOUBLE)
    with pytest.raises(UserError, match=why) as refused:
        c.function(f, (c.types.real,))
    assert re.search(r"test_programs\.py:\d+: ", refused.value.text)


def test_every_estimator_and_both_laws_are_there():
    assert sorted(METHODS) == ["gradient", "imm", "kalman", "leso", "neso", "patent", "rule", "td"]
    assert len(vectors.records(Vehicle())) == 4
