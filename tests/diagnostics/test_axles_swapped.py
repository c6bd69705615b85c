"""Speeds of two axles under each other's names."""

from pathlib import Path

import pytest
from helpers import simulated
from helpers.diagnosed import clean, codes


@pytest.mark.parametrize(
    "pair", [(1, 3), *(pytest.param(x, marks=pytest.mark.slow) for x in ((1, 2), (2, 4)))]
)
def test_swapped_axles_are_found_where_they_slide(pair: tuple[int, int], tmp_path: Path) -> None:
    log = clean("low-adhesion", 1, "as it is")
    found = codes(simulated.swapped(log, *pair), tmp_path)
    assert "axles-swapped" in found
    assert found <= {"axles-swapped", "axle-pressure-differs"}  # the one is a reason of the other
