"""One axle's record with the channels that it is made of, and its clamping force."""

from dataclasses import replace
from typing import NamedTuple

from ..core.model import AxleRecord, Channel, Floats, FrictionTable, Vehicle
from ..core.physics import clamping_force, force_line


class AxleChannels(NamedTuple):
    """One axle's record and the channels it comes from."""

    record: AxleRecord
    speed: Channel
    brake: Channel
    train: Channel | None
    smooth_pressure: Floats | None  # pressure interpolated at the record's times; None where K is
    friction_table: FrictionTable | None = None  # its own, where the vehicle is the mean axle

    def clamped_by(self, vehicle: Vehicle) -> "AxleChannels":
        """The axle with the clamping force that a vehicle makes of its pressure. Source: (15)."""
        pressure, smooth_pressure = self.record.pressure, self.smooth_pressure
        if pressure is None or smooth_pressure is None:
            return self
        vehicle = vehicle.of_axle(self.record.axle)
        K = clamping_force(pressure, vehicle)
        smooth = clamping_force(smooth_pressure, vehicle)
        step = self.brake.step * force_line(vehicle).per_pascal
        record = replace(
            self.record, clamping_force=K, clamping_force_smooth=smooth, clamping_force_step=step
        )
        return self._replace(record=record)

    def as_mean_axle(self, vehicle: Vehicle, mean: Vehicle, heavier: float = 1.0) -> "AxleChannels":
        """The axle as one of a train of equal axles: with what makes the mean axle brake as it.

        Args:
            vehicle: with this axle's own values.
            mean: the mean axle, from `core.mean_axle`.
            heavier: its mass over that of the mean axle of this log.
        """
        own, record = vehicle.of_axle(self.record.axle), self.record
        factor = heavier * own.friction.value / mean.friction.value
        table = own.friction_table
        if table is None and mean.friction_table:
            table = FrictionTable((0.0,), (), ((own.friction.value,),))  # the same at every speed
        elif table:
            table = table._replace(clamping_force=tuple(factor * K for K in table.clamping_force))
        if record.pressure is None or self.smooth_pressure is None:
            changed = replace(
                record,
                clamping_force=factor * record.clamping_force,
                clamping_force_smooth=factor * record.clamping_force_smooth,
                clamping_force_step=factor * record.clamping_force_step,
            )
            return self._replace(record=changed, friction_table=table)
        line, mean_line = force_line(own), force_line(mean)
        # Both are straight lines below the springs' forces, too.
        scale = factor * line.per_pascal / mean_line.per_pascal
        offset = (mean_line.at_zero - factor * line.at_zero) / mean_line.per_pascal
        changed = replace(record, pressure=scale * record.pressure + offset)
        smooth = scale * self.smooth_pressure + offset
        axle = self._replace(record=changed, smooth_pressure=smooth, friction_table=table)
        return axle.clamped_by(mean)
