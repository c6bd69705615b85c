"""New samples of an axle that is measured now."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from ..core.model import Bools, Floats, Times, columns_at


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
        estimates = {a: (F[rows], s[rows], u[rows]) for a, (F, s, u) in self.estimates.items()}
        return replace(self, estimates=estimates, **columns_at(self, rows))
