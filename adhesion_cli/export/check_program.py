"""`test_ALGO.c`: a program that compares the C with the Python `step` on vectors of a log."""

from .c_types import Number, Scalar
from .interface import Interface
from .vectors import LOG, Vectors

LIBRARY_ERROR = 1e-9  # error of another C library in double precision, over the largest value

_PROGRAM = """\
/* test_{method}.c: {name} on axle 1 of {log}, against the Python step.
   Also: a NaN and a parameter out of range are refused, and change nothing. */
#include "{name}.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

typedef struct {{
    {name}_real h; /* interval [s] */
{fields}}} sample;

static const sample samples[] = {{
{rows}}};

static const int count = (int)(sizeof samples / sizeof samples[0]);

static int refuses({name}_state *state, {name}_params p)
{{
    const {name}_state before = *state;
    {name}_real none = ({name}_real)NAN;
{bad}    p.{parameter} = none;
    int failed = ({name}_step({step_bad}) != {macro}_BAD_INPUT) ? 1 : 0;
    failed += ({name}_init({init_bad}) != {macro}_BAD_PARAMETER) ? 1 : 0;
    return failed + ((memcmp(&before, state, sizeof before) != 0) ? 1 : 0);
}}

int main(void)
{{
    const {name}_params p = {name}_defaults();
{begin}    {name}_state s;
    int failed = ({name}_init({init}) != {macro}_OK) ? 1 : 0;
{worst}    for (int i = 0; i < count; i++) {{
        const sample *at = &samples[i];
        if (i > 0) {{
            failed += ({name}_step({step}) != {macro}_OK) ? 1 : 0;
        }}
{compared}    }}
    failed += refuses(&s, p);
{judged}    printf("{name}: %d samples, %s\\n", count, (failed == 0) ? "passed" : "FAILED");
    return (failed == 0) ? 0 : 1;
}}
"""


def limits(vectors: Vectors, number: Number) -> list[float]:
    """Largest error that the program accepts, of each answer.

    In single precision it is twice what the vectors show: another C library rounds otherwise.
    """
    answers = range(len(vectors.expected[0]))
    if number.double:
        return [LIBRARY_ERROR * vectors.largest(i) for i in answers]
    return [2.0 * max(vectors.single_errors(i)) for i in answers]


def program(interface: Interface, vectors: Vectors) -> str:
    """The text of the program."""
    n = interface.name
    fields = [f"{n}_real K;", f"{n}_real y;"] if interface.estimator else [f"{n}_observed o;"]
    if interface.estimator:
        first_sample = "samples[0].K, samples[0].y"
        arguments = {"init": f"&s, &p, &w, {first_sample}", "step": "&s, at->h, at->K, at->y"}
        arguments |= {"begin": f"    const {n}_wheelset w = {n}_default_wheelset();\n", "bad": ""}
        arguments |= {"step_bad": "state, samples[1].h, none, samples[1].y"}
        arguments |= {"init_bad": f"state, &p, &state->w, {first_sample}"}
    else:
        arguments = {"init": "&s, &p, &samples[0].o", "step": "&s, at->h, &at->o", "begin": ""}
        arguments |= {"bad": f"    {n}_observed o = samples[0].o;\n    o.slip = none;\n"}
        arguments |= {"step_bad": "state, samples[1].h, &o", "init_bad": "state, &p, &samples[0].o"}
    compared, worst, judged = [], [], []
    kinds = dict(interface.now.fields)
    for x, limit in zip(interface.answers(), limits(vectors, interface.number), strict=True):
        fields.append(f"{'double' if kinds[x] == interface.real else 'int32_t'} {x}_expected;")
        worst.append(f"double worst_{x} = 0.0;")
        error = f"fabs((double)s.now.{x} - (double)at->{x}_expected)"
        compared.append(f"    worst_{x} = fmax(worst_{x}, {error});")
        judged.append(f'printf("{x}: largest error %g, limit {limit:.2g}\\n", worst_{x});')
        judged.append(f"failed += (worst_{x} > {limit!r}) ? 1 : 0;")
    lines = {"fields": fields, "worst": worst, "compared": compared, "judged": judged}
    arguments |= {k: "".join(f"    {x}\n" for x in v) for k, v in lines.items()}
    names = {"name": n, "macro": interface.macro, "method": interface.method.name, "log": LOG}
    names["parameter"] = interface.params.fields[0][0]
    return _PROGRAM.format(**names, rows=_rows(interface, vectors), **arguments)


def _rows(interface: Interface, vectors: Vectors) -> str:
    double, kinds = Number(True), dict(interface.now.fields)
    is_integer = [isinstance(k, Scalar) and k != interface.real for _, k in interface.given.fields]
    text = []
    for row, expected in zip(vectors.rows, vectors.expected, strict=True):
        literals = [interface.number.literal(x) for x in row]
        if not interface.estimator:
            inputs = zip(row[1:], is_integer, strict=True)
            literals = [str(int(x)) if i else interface.number.literal(x) for x, i in inputs]
            literals = [interface.number.literal(row[0]), f"{{{', '.join(literals)}}}"]
        for x, value in zip(interface.answers(), expected, strict=True):
            is_real = kinds[x] == interface.real
            literals.append(double.literal(value) if is_real else str(int(value)))
        text.append(f"    {{{', '.join(literals)}}},\n")
    return "".join(text)
