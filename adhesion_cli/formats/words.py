"""Columns of words, which may be states: each word has a number."""

from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from ..core.model import Floats
from .source import number_words


def numbered(texts: Any, words: list[str]) -> Floats:
    """The number of each text in a list of words, shape (n,); NaN for nulls.

    Words that are new are appended, in the order in which they occur, see `number_words`.
    """
    encoded = pc.utf8_trim_whitespace(pa.array(texts, pa.string())).dictionary_encode()
    met = encoded.dictionary.to_pylist()
    number_of = number_words(words, met)
    numbers: Floats = np.array([*(number_of.get(word, np.nan) for word in met), np.nan])
    indices: NDArray[np.int64] = np.asarray(pc.fill_null(encoded.indices, len(met)))
    return numbers[indices]
