"""Hostile names."""

import unicodedata

from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core.text import distinct, printable


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
