"""README and `test_ALGO.c` of an export, and what both it and the Makefile say of the checker.

The program compares the C with the Python `step` on vectors of a log.
"""

import math
from collections.abc import Iterator, Mapping

from ..core.methods import parameters
from ..core.model import Vehicle, quantities
from ..core.physics import LEAST_SHARE, force_line
from .c_types import DOUBLE, INT, Number, flat, range_of
from .interface import WHEELSET_INPUTS, Code, Interface
from .templates import render
from .vectors import LOG, Vectors

LIBRARY_ERROR = 1e-9  # error of another C library in double precision, over the largest value
SINGLE_ERROR = 6.0  # and in single precision, over that of a library that rounds exactly
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


def limits(vectors: Vectors, number: Number) -> list[float]:
    """Largest error that the program accepts, of each answer."""
    answers = range(len(vectors.expected[0]))
    if number == DOUBLE:
        return [LIBRARY_ERROR * vectors.largest(i) for i in answers]
    return [SINGLE_ERROR * max(vectors.single_errors(i)) for i in answers]


def program(interface: Interface, vectors: Vectors) -> str:
    """The text of the program."""
    kinds, largest = dict(interface.now.fields), limits(vectors, interface.number)
    names = interface.answers()
    types = [INT.c if kinds[name] == INT else "double" for name in names]
    answers = [
        {"name": name, "c": c_type, "limit": limit}
        for name, c_type, limit in zip(names, types, largest, strict=True)
    ]
    return render(
        "test.c.jinja",
        interface=interface,
        log=LOG,
        answers=answers,
        parameter=interface.params.fields[0][0],
        rows=_rows(interface, vectors, types),
    )


def _rows(interface: Interface, vectors: Vectors, types: list[str]) -> Iterator[str]:
    literal, exact = interface.number.literal, DOUBLE.literal
    inputs = [kind == INT for _, kind in interface.given.fields]
    for (h, *row), expected in zip(vectors.rows, vectors.expected, strict=True):
        if interface.estimator:
            sample = interface.literals(row)
        else:
            fields = zip(row, inputs, strict=True)
            sample = f"{{{', '.join(str(int(x)) if whole else literal(x) for x, whole in fields)}}}"
        results = [
            str(int(x)) if c_type == INT.c else exact(x)
            for x, c_type in zip(expected, types, strict=True)
        ]
        yield ", ".join([literal(h), sample, *results])


def readme(
    interface: Interface,
    code: Code,
    vectors: Vectors,
    values: Mapping[str, float],
    vehicle: Vehicle,
) -> str:
    """The README: use, units and ranges, accuracy, deviations.

    `values` are the vehicle's, by the names of `WHEELSET_INPUTS`; K follows from its brake.
    """
    annotations, numbers = quantities(Vehicle), [kind.c for _, kind in flat(interface.state())]
    return render(
        "README.md.jinja",
        interface=interface,
        code=code,
        vectors=vectors,
        wheelset={x: (values[x], annotations[name]) for x, name in WHEELSET_INPUTS.items()},
        vehicle=vehicle,
        log=LOG,
        single_error=SINGLE_ERROR,
        least_share=LEAST_SHARE,
        deviations=DEVIATIONS,
        parameters=parameters(interface.method),
        inputs={"h": interface.interval, **interface.inputs},
        unread=set() if interface.estimator else set(interface.inputs) - code.read,
        line=force_line(vehicle),
        reals=numbers.count("real"),
        integers=len(numbers) - numbers.count("real"),
        double_limit=limits(vectors, DOUBLE)[-1],
        seconds=sum(row[0] for row in vectors.rows),
        single_errors={x: vectors.single_errors(i) for i, x in enumerate(interface.answers())},
        counts_readings=any(path.endswith(".readings") for path, _ in flat(interface.now)),
        range_of=range_of,
        rms=lambda errors: math.hypot(*errors) / math.sqrt(len(errors)),
        zip=zip,
    )
