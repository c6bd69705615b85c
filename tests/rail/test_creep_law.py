"""Polach's law: its slopes."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.rail.creep_law import Condition, Contact, conditions, creep_force, creep_slopes

PATCH = Contact().patch(47_000.0)
STEP = 1e-6


@given(
    rail=st.sampled_from(sorted(conditions().values())),
    speed=st.floats(0.05, 60.0), slip=st.floats(1e-4, 1.0), sign=st.sampled_from([-1.0, 1.0]),
)  # fmt: skip
def test_slopes_are_those_of_the_force(
    rail: Condition, speed: float, slip: float, sign: float
) -> None:
    sliding = sign * slip * speed
    force, by_sliding, *found = creep_slopes(sliding, speed, rail, PATCH)
    assert (force, by_sliding) == creep_force(sliding, speed, rail, PATCH)
    for name, slope in zip(("k_a", "k_s", "A", "B"), found, strict=True):
        value = getattr(rail, name)
        step = STEP * value
        more, less = (
            creep_force(sliding, speed, rail._replace(**{name: value + far}), PATCH)[0]
            for far in (step, -step)
        )
        relative = 1.0 if name == "A" else value  # of the others, by the logarithm
        expected = relative * (more - less) / (2.0 * step)
        assert slope == pytest.approx(expected, rel=1e-4, abs=1e-5 * abs(force) + 1e-3)
