"""`test_ALGO.c`: a program that compares the C with the Python `step` on vectors of a log."""

from collections.abc import Iterator
from typing import NamedTuple

from .c_types import INT, Number
from .interface import Interface
from .templates import render
from .vectors import LOG, Vectors

LIBRARY_ERROR = 1e-9  # error of another C library in double precision, over the largest value
SINGLE_ERROR = 6.0  # and in single precision, over that of a library that rounds exactly


class _Answer(NamedTuple):
    name: str
    c: str  # its type
    limit: float  # largest error accepted


def limits(vectors: Vectors, number: Number) -> list[float]:
    """Largest error that the program accepts, of each answer."""
    answers = range(len(vectors.expected[0]))
    if number.double:
        return [LIBRARY_ERROR * vectors.largest(i) for i in answers]
    return [SINGLE_ERROR * max(vectors.single_errors(i)) for i in answers]


def program(interface: Interface, vectors: Vectors) -> str:
    """The text of the program."""
    kinds, largest = dict(interface.now.fields), limits(vectors, interface.number)
    answers = [
        _Answer(x, INT.c if kinds[x] == INT else "double", limit)
        for x, limit in zip(interface.answers(), largest, strict=True)
    ]
    return render(
        "test.c.jinja",
        interface=interface,
        log=LOG,
        answers=answers,
        parameter=interface.params.fields[0][0],
        rows=_rows(interface, vectors, answers),
    )


def _rows(interface: Interface, vectors: Vectors, answers: list[_Answer]) -> Iterator[str]:
    literal, exact = interface.number.literal, Number(True).literal
    inputs = [kind == INT for _, kind in interface.given.fields]
    for (h, *row), expected in zip(vectors.rows, vectors.expected, strict=True):
        if interface.estimator:
            sample = interface.literals(row)
        else:
            fields = zip(row, inputs, strict=True)
            sample = f"{{{', '.join(str(int(x)) if whole else literal(x) for x, whole in fields)}}}"
        results = [
            str(int(x)) if answer.c == INT.c else exact(x)
            for x, answer in zip(expected, answers, strict=True)
        ]
        yield ", ".join([literal(h), sample, *results])
