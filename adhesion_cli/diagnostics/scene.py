"""What every check looks at: all axles of a log on one grid, and how the train slows."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding, Severity
from ..core.masks import spans_of_mask
from ..core.model import Bools, Channel, Train, Vehicle
from ..core.physics import rolling_deceleration, wheelset
from ..core.toml import option
from ..core.units import UNITS, Unit, unit_for
from ..records.axle_channels import AxleChannels
from ..train.explanation import Explanation
from ..train.grid import Grid
from ..train.mean_axle import mean_axle


class Scene(NamedTuple):
    """What every check looks at."""

    axles: Sequence[AxleChannels]
    grid: Grid
    vehicle: Vehicle
    start_ns: int  # the log's start
    explanation: Explanation  # of how the train slows
    train: Train = Train()

    @property
    def by_rolling(self) -> float:
        """Deceleration of a train that rolls, per K of an axle [m/s² per N]. Source: (1)."""
        numbers = [a.record.axle for a in self.axles]
        mean = mean_axle(self.vehicle, numbers)
        w = wheelset(mean, numbers[0])
        share = self.train.braked_share(mean, len(numbers))
        return share * rolling_deceleration(w) * w.radius

    def pressure_option(self, brake: Channel, statement: str) -> str:
        """The option that states something of a pressure, for each axle that it serves.

        `statement` follows the name of the setting, as " = …" or ".zero = …".
        """
        axles = [a.record.axle for a in self.axles if a.brake.title == brake.title]
        places = [""] if brake.axle is None else [f".axle{axle}" for axle in axles]
        return option(*(f"channels.pressure{place}{statement}" for place in places))

    def finding(  # noqa: PLR0913 (the fields of a finding)
        self,
        code: str,
        severity: Severity,
        channel: Channel,
        grid_mask: Bools | None = None,
        axle: int = 0,
        values: Mapping[str, float] | None = None,
        names: Mapping[str, str] | None = None,
    ) -> Finding:
        """A finding about the samples of an axle, by its place, where a mask on the grid holds."""
        t = self.axles[axle].record.t
        mask = np.ones(len(t), np.bool_)
        if grid_mask is not None:
            mask = self.grid.sample_mask(t, grid_mask)
        spans, count = spans_of_mask(mask, t, self.start_ns), max(int(mask.sum()), 1)
        return Finding(code, severity, channel.title, count, spans, values or {}, names or {})


def pressure_unit(brake: Channel) -> Unit:
    """The unit of a pressure as logged; Pa where it states none."""
    return unit_for(brake.unit, "pressure") or UNITS["pa"]
