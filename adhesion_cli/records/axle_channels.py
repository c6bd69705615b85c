"""One axle's record with the channels that it is made of, and its clamping force."""

from dataclasses import replace
from typing import NamedTuple

from ..core.model import AxleRecord, Channel, Floats, Vehicle
from ..core.physics import clamping_force, force_line


class AxleChannels(NamedTuple):
    """One axle's record and the channels it comes from."""

    record: AxleRecord
    speed: Channel
    brake: Channel
    train: Channel | None
    smooth_pressure: Floats | None  # pressure interpolated at the record's times; None where K is

    def clamped_by(self, vehicle: Vehicle) -> "AxleChannels":
        """The axle with the clamping force that a vehicle makes of its pressure. Source: (15)."""
        pressure, smooth_pressure = self.record.pressure, self.smooth_pressure
        if pressure is None or smooth_pressure is None:
            return self
        K = clamping_force(pressure, vehicle)
        smooth = clamping_force(smooth_pressure, vehicle)
        step = self.brake.step * force_line(vehicle).per_pascal
        record = replace(
            self.record, clamping_force=K, clamping_force_smooth=smooth, clamping_force_step=step
        )
        return self._replace(record=record)
