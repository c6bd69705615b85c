"""README of an export, and what both it and the Makefile say of the checker."""

import math
from collections.abc import Mapping

from ..core.methods import parameters
from ..core.model import Vehicle, quantities
from ..core.physics import LEAST_SHARE, force_line
from .c_types import Number, flat, range_of
from .check_program import SINGLE_ERROR, limits
from .interface import WHEELSET_INPUTS, Code, Interface
from .templates import render
from .vectors import LOG, Vectors

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
    wheelset = {x: (values[x], annotations[name]) for x, name in WHEELSET_INPUTS.items()}
    return render(
        "README.md.jinja",
        interface=interface,
        code=code,
        vectors=vectors,
        wheelset=wheelset,
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
        double_limit=limits(vectors, Number(True))[-1],
        seconds=sum(row[0] for row in vectors.rows),
        single_errors={x: vectors.single_errors(i) for i, x in enumerate(interface.answers())},
        counts_readings=any(path.endswith(".readings") for path, _ in flat(interface.now)),
        range_of=range_of,
        rms=lambda errors: math.hypot(*errors) / math.sqrt(len(errors)),
        zip=zip,
    )
