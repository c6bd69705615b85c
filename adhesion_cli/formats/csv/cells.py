"""Text cells of a block as numbers and exact decimals, all rows at once.

Every function takes an Arrow array of shape (n,) that is null where a cell has no value.
"""

import re
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ...core.model import Bools, Floats, Times
from ..number_text import number_grammar
from .dialect import INFINITE, NULLS

# States of a cell. Some are numbers by their column: with the other decimal mark, or such that this
# mark may separate groups of digits; and texts of digits. The last one is bad by its quality.
NUMBER, NO_VALUE, NO_NUMBER, IS_INFINITE, OTHER_MARK, IN_GROUPS, DIGITS, IS_BAD = range(8)


def floats(text: Any, decimal: str) -> tuple[Floats, NDArray[np.int8]]:
    """Numbers of one column by the strict grammar.

    Returns:
        float64 values, NaN where the cell is no number, and states; both of shape (n,).
    """
    if pc.any(pc.match_substring(text, " ")).as_py():
        text = pc.utf8_trim_whitespace(text)
    with_point = pc.replace_substring(text, decimal, ".") if decimal != "." else text
    try:
        if decimal != "." and pc.any(pc.match_substring(text, ".")).as_py():
            raise pa.ArrowInvalid
        value = np.array(pc.cast(with_point, pa.float64()))
    except pa.ArrowInvalid:
        grammar = f"^(?:{number_grammar(decimal).pattern})$"
        numeric = pc.fill_null(pc.match_substring_regex(text, grammar), False)
        value = np.array(pc.cast(pc.if_else(numeric, with_point, None), pa.float64()))
    state = np.full(len(value), NUMBER, np.int8)
    non_finite = np.flatnonzero(~np.isfinite(value))
    if len(non_finite):
        odd_cells = text.take(pa.array(non_finite))
        infinite = np.isinf(value[non_finite]) | _is_any(INFINITE, odd_cells)
        value[non_finite], kinds = _other_notations(odd_cells, decimal)
        state[non_finite] = np.select(
            [is_missing(odd_cells), infinite], [NO_VALUE, IS_INFINITE], kinds
        )
        value[np.isin(state, (NO_VALUE, IS_INFINITE))] = np.nan
    return value, state


def _other_notations(text: Any, decimal: str) -> tuple[Floats, NDArray[np.int8]]:
    """Numbers of cells that are none by the grammar, NaN where they are no number; and states."""
    other_mark = "." if decimal == "," else ","
    d, o = re.escape(decimal), re.escape(other_mark)
    value, state = np.full(len(text), np.nan), np.full(len(text), NO_NUMBER, np.int8)
    for kind, pattern, mark in (
        (DIGITS, r"\(?[+-]?[0-9][^A-Za-z]*(?:[A-Za-z][^0-9_]*)?", ""),
        (OTHER_MARK, rf"[+-]?[1-9][0-9]{{0,2}}(?:[' {d}][0-9]{{3}})+{o}[0-9]*", other_mark),
        (OTHER_MARK, number_grammar(other_mark).pattern, other_mark),
        (IN_GROUPS, rf"[+-]?[1-9][0-9]{{0,2}}{o}[0-9]{{3}}", other_mark),
        (NUMBER, rf"[+-]?[0-9]{{1,3}}(?:[' ][0-9]{{3}})+(?:{d}[0-9]*)?", decimal),
        (NUMBER, rf"[+-]?[1-9][0-9]{{0,2}}(?:{o}[0-9]{{3}})+{d}[0-9]*", decimal),
        (NUMBER, rf"[+-]?[1-9][0-9]{{0,2}}(?:{o}[0-9]{{3}}){{2,}}", decimal),
    ):
        matches = pc.fill_null(pc.match_substring_regex(text, f"^(?:{pattern})$"), False)
        rows = np.flatnonzero(np.asarray(matches))
        state[rows] = kind
        if mark and len(rows):
            digits = pc.replace_substring_regex(text.take(pa.array(rows)), f"[^0-9eE+{mark}-]", "")
            digits = pc.replace_substring(digits, mark, ".")
            value[rows] = np.asarray(pc.cast(digits, pa.float64()))
    return value, state


def is_missing(text: Any) -> Bools:
    """Which cells are null or spell it, shape (n,)."""
    return np.asarray(pc.is_null(text)) | _is_any(NULLS, pc.utf8_trim_whitespace(text))


def _is_any(texts: Sequence[str], text: Any) -> Bools:
    return np.asarray(pc.is_in(text, pa.array(texts, pa.string())))


def decimals(text: Any, scale: int, decimal: str) -> tuple[Times, Bools]:
    """Decimals times 10**scale as int64, exactly, rounded to the nearest; and which hold."""
    text = pc.utf8_trim_whitespace(text)
    text = pc.replace_substring(text, decimal, ".") if decimal != "." else text
    grammar = r"^[+-]?[0-9]{1,19}(\.[0-9]*)?([eE][+-]?[0-9]{1,2})?$"
    # digits beyond the 18th decimal say nothing here
    shortened = pc.replace_substring_regex(text, r"(\.[0-9]{18})[0-9]+", r"\1")
    is_decimal = pc.match_substring_regex(text, grammar)
    array = pc.cast(pc.if_else(is_decimal, shortened, None), pa.decimal128(38, 18))
    array = pc.round(array, ndigits=scale, round_mode="half_to_even")
    array = array.cast(pa.decimal128(38, scale))
    halves = np.frombuffer(array.buffers()[1], np.int64, 2 * len(array), 16 * array.offset)
    low_half, high_half = halves[0::2], halves[1::2]
    ok = np.asarray(array.is_valid()) & (high_half == low_half >> 63)
    return np.where(ok, low_half, 0), ok
