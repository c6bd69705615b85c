"""Cases of a test over several parameters, of which the quick suite takes an even share."""

import itertools
from collections.abc import Iterable
from typing import Any

import pytest


def thinned(every: int, *axes: Iterable[Any]) -> list[Any]:
    """All combinations of the axes' values; all but one of `every` are slow.

    Where `every` has no factor in common with the axes' lengths, each value is in a quick case.
    """
    return [
        pytest.param(*case, marks=[pytest.mark.slow] if i % every else [])
        for i, case in enumerate(itertools.product(*axes))
    ]
