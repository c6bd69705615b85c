"""Hostile names; digits of numbers."""

import unicodedata

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core.text import by_uncertainty, distinct, printable


@given(st.text(st.characters(categories=["L", "N", "P", "S", "Zs"])))
def test_ordinary_text_stays(text: str) -> None:
    assert printable(text) == text


@given(st.text(st.characters(categories=["C", "Z"])))
def test_nothing_steers_a_terminal(text: str) -> None:
    shown = printable(text)
    assert {unicodedata.category(c) for c in shown}.isdisjoint({"Cc", "Cf", "Cs", "Zl", "Zp"})
    assert len(shown.splitlines()) <= 1
    assert printable(shown) == shown


@given(st.lists(st.sampled_from(["a", "a (2)", "a (3)", "b", ""])))
def test_distinct(names: list[str]) -> None:
    told = distinct(names)
    assert len(set(told)) == len(names)
    assert all(t.startswith(n) for t, n in zip(told, names, strict=True))
    for name in set(names):  # the first of a name keeps it
        assert told[names.index(name)] == name


def test_many_equal_names_are_quick() -> None:
    assert distinct(["c"] * 65_536)[-1] == "c (65536)"


@pytest.mark.parametrize(
    ("value", "u", "most", "shown"),
    [
        (-7.398e-05, 0.00011, 15, "-0.00007 ± 0.00011"),
        (0.30512, 0.0087, 15, "0.3051 ± 0.0087"),
        (14032.0, 693.0, 15, "14030 ± 690"),
        (1.0, 0.0996, 15, "1.00 ± 0.10"),  # not 0.100: three digits
        (99.96, 9.96, 15, "100 ± 10"),
        (-0.0001, 0.11, 15, "0.00 ± 0.11"),
        (0.0713, 0.0067, 3, "0.071 ± 0.007"),
        (45.31, 12.4, 1, "45 ± 12"),
        (1234.5678, 0.0, 15, "1235 ± 0"),
    ],
)
def test_the_uncertainty_decides_the_digits(value: float, u: float, most: int, shown: str) -> None:
    assert " ± ".join(by_uncertainty(value, u, most)) == shown
