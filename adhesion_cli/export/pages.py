"""Makefile and README of an export."""

import math
from collections.abc import Sequence
from typing import NamedTuple

from ..core.methods import parameters
from ..core.model import Vehicle, quantities
from ..core.physics import LEAST_SHARE, force_line
from .c_types import Number, flat, range_of
from .check_program import limits
from .interface import WHEELSET_INPUTS, Code, Interface
from .single_precision import ULPS
from .vectors import LIBRARIES, LOG, Vectors

MAKEFILE = """\
# {name}, made by adhesion {version}
#   make test      compile strictly, compare with the Python step on a log
#   make sanitize  the same with the address and the undefined-behaviour sanitizer
#   make misra     cppcheck with its MISRA C:2012 addon
CFLAGS = -O2
# Without contraction, products and sums round as in Python.
STRICT = -std=c99 -ffp-contract=off -Wall -Wextra -Wconversion -pedantic -Werror
SANITIZE = -g -fsanitize=address,undefined -fno-sanitize-recover=all
FILES = test_{method}.c {name}.c
# The README gives the reason for each suppressed rule.
MISRA = {suppressed}

test: test_{method}
	./test_{method}

test_{method}: $(FILES) {name}.h
	$(CC) $(STRICT) $(CFLAGS) -o $@ $(FILES) -lm

sanitize: $(FILES) {name}.h
	$(CC) $(STRICT) $(CFLAGS) $(SANITIZE) -o test_{method}_sanitized $(FILES) -lm
	./test_{method}_sanitized

misra:
	cppcheck --std=c99 --addon=misra --enable=style --error-exitcode=1 $(MISRA) {name}.c

clean:
	rm -f test_{method} test_{method}_sanitized {name}.c.dump {name}.c.ctu-info

.PHONY: test sanitize misra clean
"""

# What the checker is told not to report, and why.
DEVIATIONS = {
    "misra-c2012-1.2": "Rule 1.2 (advisory, language extensions): with gcc and clang the macro "
    "ADHESION_INLINE has an attribute. Other compilers get `static inline`.",
    "misra-c2012-15.5": "Rule 15.5 (advisory, one exit per function): a function of the estimator "
    "returns where its Python source returns, so that both can be compared line by line.",
    "misra-c2012-12.3": "Rule 12.3 (advisory, comma operator): there is none. cppcheck takes the "
    "commas of an initializer list for it.",
    "unreadVariable": "No MISRA rule. Variables of inner blocks have a value from the start (rule "
    "9.1), which the checker calls unused.",
    "variableScope": "No MISRA rule. Such variables stand at the head of the function.",
    "unusedStructMember": "No MISRA rule. A struct has the fields of its NamedTuple.",
    "missingIncludeSystem": "No MISRA rule. The headers of the C library are not checked.",
}


class Facts(NamedTuple):
    """What the README states about an export."""

    interface: Interface
    code: Code
    vectors: Vectors
    wheelset: dict[str, float]  # the vehicle's values by the names of `WHEELSET_INPUTS`
    vehicle: Vehicle  # K follows from its brake


def makefile(interface: Interface) -> str:
    """The Makefile."""
    suppressed = " ".join(f"--suppress={x}" for x in DEVIATIONS)
    names = {"name": interface.name, "method": interface.method.name}
    return MAKEFILE.format(**names, version=interface.version, suppressed=suppressed)


def readme(facts: Facts) -> str:
    """The README: use, units and ranges, operations, accuracy, deviations."""
    interface = facts.interface
    title = f"# {interface.name}\n\n{interface.method.title}. Source: {interface.method.source}.\n"
    kind = "the estimator" if interface.estimator else "the control law"
    sections = [
        title,
        f"Made by adhesion {interface.version}: C99, `{interface.number.c}`. "
        f"The C is translated from the Python source of {kind}. "
        "The caller owns all memory. "
        "There is no allocation, no global variable and no unbounded loop.\n",
        _files(interface),
        _usage(interface),
        _statuses(facts),
        _parameters(interface),
        _inputs(facts),
        _operations(facts),
        _accuracy(facts),
        _misra(),
    ]
    return "\n".join(sections).rstrip() + "\n"


def _files(interface: Interface) -> str:
    rows = [
        (f"`{interface.name}.h`, `{interface.name}.c`", "what goes into the control unit"),
        (f"`test_{interface.method.name}.c`", f"a test with samples of the log {LOG}"),
        ("`Makefile`", "`make test`, `make sanitize`, `make misra`"),
    ]
    text = (
        "\nWith gcc and clang every function of the source is a part of its caller. That is quick. "
        "`-Os` keeps the code small instead.\n"
    )
    return _table(("file", "content"), rows) + text


def _usage(interface: Interface) -> str:
    n, m = interface.name, interface.macro
    if interface.estimator:
        wheelset = [f"{n}_wheelset w = {n}_default_wheelset();"]
        init_inputs, step_inputs = "&w, K, y", "K, y"
        unit, answer = "sample", "use(axle.now.F); /* adhesion force [N] */"
    else:
        wheelset, init_inputs, step_inputs = [], "&observed", "&observed"
        unit, answer = "tick", "use(axle.now.valve); /* 0 apply, 1 hold, 2 dump */"
    lines = [
        f"{n}_params p = {n}_defaults();",
        *wheelset,
        f"{n}_state axle; /* one for each axle */",
        f"if ({n}_init(&axle, &p, {init_inputs}) == {m}_OK) {{ ... }} /* first {unit} */",
        f"if ({n}_step(&axle, h, {step_inputs}) == {m}_OK) {{ /* each later one */",
        f"    {answer}",
        "}",
    ]
    numbers = [kind.c for _, kind in flat(interface.state())]
    integer_count = len([x for x in numbers if x != "real"])
    size = f"The state holds {len(numbers) - integer_count} numbers of type `{interface.number.c}`"
    size += f" and {integer_count} of type `int32_t`." if integer_count else "."
    text = "After a gap, start anew with `_init`."
    return "\n".join(["## Use\n", "```c", *lines, "```\n", f"{size} {text}\n"])


def _statuses(facts: Facts) -> str:
    rows = [(f"`{facts.interface.macro}_{x}`", text) for x, text in facts.code.statuses]
    text = (
        "If the status is not OK, `now` is as before. Once `_init` was OK, an answer is always a "
        "finite number. Before that, the state holds what its memory held: use no answer of it. "
        "Where NOT_FINITE comes again, start anew with `_init`.\n"
    )
    return f"## Status\n\n{_table(('status', 'meaning'), rows)}\n{text}"


def _parameters(interface: Interface) -> str:
    rows = [
        (f"`{name}`", f"{value:g}", q.unit, range_of(q), q.text)
        for (name, q, _), value in zip(parameters(interface.method), interface.p, strict=True)
    ]
    head = ("parameter", "value", "unit", "range", "what")
    return f"## Parameters\n\n{_table(head, rows)}"


def _inputs(facts: Facts) -> str:
    interface, annotations = facts.interface, quantities(Vehicle)
    listed = {"h": interface.interval, **interface.inputs}
    unread = set() if interface.estimator else set(interface.inputs) - facts.code.read
    rows = [
        (f"`{x}`", q.unit, range_of(q), q.text + ("; not read" if x in unread else ""))
        for x, q in listed.items()
    ]
    text = f"## Inputs\n\n{_table(('input', 'unit', 'range', 'what'), rows)}"
    if interface.estimator:
        body = []
        for x, name in WHEELSET_INPUTS.items():
            q = annotations[name]
            body.append((f"`{x}`", f"{facts.wheelset[x]:g}", q.unit, range_of(q), q.text))
        head = ("wheelset", "default", "unit", "range", "what")
        text += f"\n`_wheelset_of` takes\n\n{_table(head, body)}\n{_clamping(facts.vehicle)}"
    return text


def _clamping(vehicle: Vehicle) -> str:
    """How K follows from the pressure and, where friction changes over speed, from the speed."""
    line, fade = force_line(vehicle), vehicle.friction_fade.value
    text = "`K` follows from the cylinder pressure p [Pa]. For this vehicle K = "
    text += f"{line.per_pascal:.6g} N/Pa · p − {line.at_zero:.6g} N, at least 0.\n"
    if not fade:
        return text
    return text + (
        "\nThe pad friction of this vehicle changes over speed. So multiply K by "
        f"1 + {fade:.6g} s/m · (R y − {vehicle.friction_speed.value:.6g} m/s), at least "
        f"{LEAST_SHARE:g}, before `_init` and `_step`: φ stands for all speeds there.\n"
    )


def _operations(facts: Facts) -> str:
    columns = {f"`_{x}`": cost for x, cost in facts.code.costs.items()}
    text = "## Operations\n\nAt most, over every branch, parameter and interval:\n\n"
    names = sorted({name for cost in columns.values() for name in cost})
    rows = [(name, *(str(cost[name]) for cost in columns.values())) for name in names]
    text += _table(("operation", *columns), rows)
    if substeps := facts.interface.method.step.__globals__.get("SUBSTEPS"):
        text += (
            f"\n`_step` divides a long interval into sub-steps. The table counts {substeps:.0f} of "
            "them, the most that there can be.\n"
        )
    return text


def _accuracy(facts: Facts) -> str:
    interface, vectors = facts.interface, facts.vectors
    text = (
        "## Accuracy\n\nIn double precision each step has the bits of the Python `step`, with gcc "
        "or clang `-O2 -ffp-contract=off` and the same C library."
    )
    if interface.estimator:
        double_limits = limits(vectors, Number(True))[-1]
        text += f" With another one `test_{interface.method.name}.c` accepts an error of"
        text += f" {double_limits:.2g} N."
    seconds = sum(row[0] for row in vectors.rows)
    text += f"\n\nIn single precision, over axle 1 of {LOG} ({len(vectors.rows)} samples, "
    text += f"{seconds:.0f} s), the answers differ by what the table shows. It has the worst of "
    text += f"{LIBRARIES} C libraries: one that rounds exactly, and others whose functions err by "
    text += f"up to {ULPS} units in the last place.\n\n"
    rows = []
    for i, x in enumerate(interface.answers()):
        errors = vectors.single_errors(i)
        if x == "valve":
            rows.append((x, f"{sum(e > 0.0 for e in errors)} samples differ", ""))
            continue
        rms = math.sqrt(sum(e * e for e in errors) / len(errors))
        unit = " N" if interface.estimator else ""
        rows.append((x, f"{max(errors):.2g}{unit}", f"{rms:.2g}{unit}"))
    text += _table(("answer", "largest error", "rms"), rows)
    if vectors.missing_count:
        text += "\nSingle precision has no finite answer at "
        text += f"{vectors.missing_count} of these samples.\n"
    counts_readings = any(path.endswith(".readings") for path, _ in flat(interface.now))
    if counts_readings and not interface.number.double:
        text += (
            "\nA `float` counts up to 16 777 216, at 1 kHz in 4.6 hours. `noise.readings` stops "
            "there: start anew with `_init` before, for example while the train stands.\n"
        )
    return text


def _misra() -> str:
    rows = [(f"`{x}`", text) for x, text in DEVIATIONS.items()]
    text = "`make misra` runs cppcheck with its addon. These are not reported:\n"
    return f"## MISRA C:2012\n\n{text}\n{_table(('id', 'reason'), rows)}"


def _table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows), ""])
