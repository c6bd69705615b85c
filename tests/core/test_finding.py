"""Findings are data; every code has its words."""

import ast
import re
from pathlib import Path
from string import Formatter

import pytest

from adhesion_cli.core.finding import Finding, catalogue, merge_spans

ROOT = Path(__file__).parents[2] / "adhesion_cli"


def test_every_code_that_is_written_out_has_an_entry() -> None:
    used = {
        ast.literal_eval(node.args[0])
        for path in ROOT.rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text("utf-8")))
        if isinstance(node, ast.Call) and ast.unparse(node.func) in ("Finding", "self.found")
        if node.args and isinstance(node.args[0], ast.Constant)
    }
    assert len(used) > 40
    assert sorted(used - set(catalogue())) == []


@pytest.mark.parametrize("code", list(catalogue()))
def test_words_are_complete_and_short(code: str) -> None:
    words = catalogue()[code]
    assert all((words.title, words.message, words.cause, words.effect, words.remedy))
    assert len(words.message) <= 160
    assert not words.title.endswith(".")
    fields = {name for _, name, _, _ in Formatter().parse(words.message + words.remedy) if name}
    assert all(name.isidentifier() for name in fields)
    assert not re.search(r"_mps:[^}]*\} [^{]*km/h|_kmh:[^}]*\} m/s", words.message)
    assert not re.search(r"\{\w+_mps:", words.message)  # speeds are km/h on every screen


def test_a_finding_fills_its_words() -> None:
    values = {"longest_s": 3.0}
    one = Finding("gap", "warning", "speed", 2, ((1.0, 2.0), (4.0, 5.0)), values)
    assert one.message == catalogue()["gap"].message.format(**values)
    assert one.first_s == 1.0
    assert Finding("standstill", "info").first_s is None


def test_spans_are_merged_across_the_smallest_gaps() -> None:
    assert merge_spans([(5.0, 6.0), (0.0, 1.0), (0.5, 2.0)]) == ((0.0, 2.0), (5.0, 6.0))
    assert merge_spans([(0.0, 1.0), (1.5, 2.0), (9.0, 9.5)], limit=2) == ((0.0, 2.0), (9.0, 9.5))
