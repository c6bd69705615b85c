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
    # By estimator: force, its sigma by noise, and that by the vehicle's tolerances [N].
    estimates: Mapping[str, tuple[Floats, Floats, Floats]]

    def rows(self, rows: slice | Bools) -> "Samples":
        """Some of them."""
        return Samples(
            self.t[rows],
            self.pressure[rows],
            self.clamping[rows],
            self.wheel_speed[rows],
            self.train_speed[rows],
            self.slip[rows],
            {algo: (F[rows], s[rows], u[rows]) for algo, (F, s, u) in self.estimates.items()},
        )
