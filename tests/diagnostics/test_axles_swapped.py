"""Speeds of two axles under each other's names."""

import re
from pathlib import Path

import pytest
from helpers import simulated
from helpers.diagnosed import clean, found
from helpers.pasted import pasted

from adhesion_cli.analysis.settings import load


@pytest.mark.parametrize(
    "pair", [(1, 3), *(pytest.param(x, marks=pytest.mark.slow) for x in ((1, 2), (2, 4)))]
)
def test_swapped_axles_are_found_where_they_slide(pair: tuple[int, int], tmp_path: Path) -> None:
    log = clean("low-adhesion", 1, "as it is")
    findings = {f.code: f for f in found(simulated.swapped(log, *pair), tmp_path)}
    (stated,) = load(
        assignments=pasted(findings["axles-swapped"].hint or ""), folder=False
    ).mappings
    assert {stated.axle, *map(int, re.findall(r"\d+", stated.channel)[:1])} == {*pair}
    # the one is a reason of the other
    assert findings.keys() <= {"axles-swapped", "axle-pressure-differs"}
