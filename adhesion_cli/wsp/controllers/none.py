"""No wheel slide protection: both valves stay at rest."""

from typing import NamedTuple

from ...core.methods import About
from ..controller import APPLY, Observed


class Params(NamedTuple):
    """None."""


class State(NamedTuple):
    """Slip, and valve command."""

    judged: float
    valve: int


def init(p: Params, o: Observed) -> State:
    """Both valves at rest."""
    return State(o.slip, APPLY)


def step(p: Params, s: State, h: float, o: Observed) -> State:
    """Nothing changes."""
    return State(o.slip, APPLY)


ABOUT = About("No wheel slide protection", "the brake as it is")
