"""New samples of an axle that is measured now."""

from collections.abc import Mapping
from dataclasses import dataclass

from ..core.model import Bools, Floats, Times


@dataclass(frozen=True, slots=True)
class Samples:
    """What is new of one axle: columns of shape (n,), NaN where not known."""

    t: Times
    pressure: Floats  # [Pa]
    clamping: Floats  # K [N]
    wheel_speed: Floats  # [rad/s]
    train_speed: Floats  # [m/s]
    slip: Floats  # [-]
    estimates: Mapping[str, tuple[Floats, Floats]]  # force and its sigma by estimator [N]

    def rows(self, rows: slice | Bools) -> "Samples":
        """Some of them."""
        return Samples(
            self.t[rows], self.pressure[rows], self.clamping[rows], self.wheel_speed[rows],
            self.train_speed[rows], self.slip[rows],
            {algo: (force[rows], sigma[rows]) for algo, (force, sigma) in self.estimates.items()},
        )  # fmt: skip
