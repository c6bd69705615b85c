"""Speeds of two axles under each other's names."""

import re
from pathlib import Path

import numpy as np
import pytest
from helpers import simulated
from helpers.diagnosed import clean, found
from helpers.pasted import pasted

from adhesion_cli.analysis.settings import load
from adhesion_cli.diagnostics.checks.axles_swapped import Params, is_pair


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


# correlations of the wheels of four axles with the pressures, rows by axle: as wet stops show them
MUTUAL = [
    [-0.06, 0.39, -0.13, -0.14],
    [0.83, 0.12, 0.25, 0.11],
    [0.32, 0.3, 0.91, 0.28],
    [0.35, 0.14, 0.27, 0.96],
]
OWN = [[0.88, 0.9, 0.58, 0.26], [0.05, 0.48, 0.84, 0.5], [0.4, 0.86, 0.79, 0.4], [0, 0, 0.2, 0.7]]


@pytest.mark.parametrize(
    ("follows", "pairs"), [(MUTUAL, {(0, 1), (1, 0)}), (OWN, set()), (np.zeros((4, 4)), set())]
)
def test_axles_that_follow_each_other_are_a_pair_where_the_rest_follow_themselves(
    follows: list[list[float]], pairs: set[tuple[int, int]]
) -> None:
    indices = [(i, j) for i in range(4) for j in range(4)]
    assert {(i, j) for i, j in indices if is_pair(Params(), np.array(follows), i, j)} == pairs
