"""States in words: "off" and "on", "zu" and "auf", or the names of a few levels."""

import re
from dataclasses import replace

import numpy as np

from ..core.model import Column, Meaning
from ..core.text import NO_VALUE
from .rules import VOCABULARY

_OFF, _ON, _CLOSED, _OPEN = (
    frozenset(" ".join(VOCABULARY["states"][kind].values()).split())
    for kind in ("off", "on", "closed", "open")
)


def words_key(meaning: Meaning, axle: int | None) -> str:
    """Where the provenance of a result has the words of a state, a line for each level."""
    return f"{meaning}_words" if axle is None else f"{meaning}_{axle}_words"


def says_state(words: tuple[str, ...]) -> bool:
    """Whether one of these words of a column is known as that of a state."""
    return any(word.casefold() in _OFF | _ON | _CLOSED | _OPEN for word in words)


def as_levels(column: Column, meaning: Meaning | None) -> tuple[Column, tuple[str, ...]]:
    """A column of words as 0 and 1, or as 0, 1, 2 and so on; and the word of each level.

    Words for "off" are 0. Words as "unknown" are no value. Where all others are words for "on",
    these are 1. Else each of them is a level, by the number in it, then in the order of the log. A
    hold valve acts where it is closed, every other one where it is open.
    """
    if not column.words:
        return column, ()
    off_words = _OFF | (_OPEN if meaning == "hold_valve" else _CLOSED)
    on_words = _ON | (_CLOSED if meaning == "hold_valve" else _OPEN)
    folded = [word.casefold() for word in column.words]
    known_words = off_words | on_words
    missing = {word for word in folded if word not in known_words and NO_VALUE.search(word)}
    level_words = [word for word in dict.fromkeys(folded) if word not in off_words | missing]
    if all(word in on_words for word in level_words):
        level_of = {word: float(word in on_words) for word in folded}
    else:
        level_of = dict.fromkeys(folded, 0.0)
        level_words.sort(key=lambda word: float((re.search(r"\d+", word) or ["inf"])[0]))
        level_of |= {word: float(k) for k, word in enumerate(level_words, 1)}
    level_of |= dict.fromkeys(missing, np.nan)
    numbers = np.array([level_of[word] for word in folded])
    value = np.full(len(column.t), np.nan)
    value[column.valid] = numbers[column.value[column.valid].astype(np.int64)]
    pairs = list(zip(numbers.tolist(), column.words, strict=True))
    names = {int(k): word for k, word in reversed(pairs) if k == k}
    levels = tuple(names.get(k, "") for k in range(max(names, default=-1) + 1))
    return replace(column, value=value, valid=np.isfinite(value), words=()), levels
