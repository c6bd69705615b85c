"""No wheel slide protection: both valves stay at rest."""

from typing import NamedTuple

from ..controller import APPLY, Observed
from ..methods import About


class Params(NamedTuple):
    """None."""


class State(NamedTuple):
    """Valve command."""

    valve: int


def init(p: Params, o: Observed) -> State:
    """Both valves at rest."""
    return State(APPLY)


def step(p: Params, s: State, h: float, o: Observed) -> State:
    """Nothing changes."""
    return State(APPLY)


ABOUT = About("No wheel slide protection", "the brake as it is")
