"""One axle's record with the channels that it is made of, and its clamping force."""

from dataclasses import replace
from typing import NamedTuple

from ..core.model import AxleRecord, Channel, Floats, FrictionTable, Vehicle
from ..core.physics import clamping_force, force_line


class MotorForce(NamedTuple):
    """The force of an axle's motors at its rim, the ED brake above zero; shape (n,) [N]."""

    last_value: Floats
    smooth: Floats  # interpolated at the record's times
    sigma: Floats  # standard uncertainty
    traction_known: bool  # whether a motor that drives is in it

    def scaled(self, factor: float) -> "MotorForce":
        """The same of forces that are so many times as large."""
        last_value, smooth, sigma = (factor * x for x in self[:3])
        return MotorForce(last_value, smooth, sigma, self.traction_known)


class AxleChannels(NamedTuple):
    """One axle's record and the channels it comes from."""

    record: AxleRecord
    speed: Channel
    brake: Channel
    train: Channel | None
    smooth_pressure: Floats | None  # pressure interpolated at the record's times; None where K is
    vehicle: Vehicle  # with the values of this axle for all axles; of its clamping force
    motors: MotorForce | None = None
    friction_table: FrictionTable | None = None  # its own, where the vehicle is the mean axle

    def clamped_by(self, vehicle: Vehicle) -> "AxleChannels":
        """The axle of another vehicle, with the clamping force that this one makes."""
        return self._replace(vehicle=vehicle.of_axle(self.record.axle)).clamped()

    def clamped(self) -> "AxleChannels":
        """The axle with the clamping force of friction brake and motors, by its vehicle.

        Sources: (15) for the friction brake; K is the equivalent clamping force of electric and air
        brake together, so a force F of motors at the rim is F/φ of it.
        """
        record, vehicle = self.record, self.vehicle
        pressure, smooth_pressure = record.pressure, self.smooth_pressure
        if pressure is not None and smooth_pressure is not None:
            K = clamping_force(pressure, vehicle)
            smooth = clamping_force(smooth_pressure, vehicle)
            step = self.brake.step * force_line(vehicle).per_pascal
        elif self.motors is None:
            return self
        else:
            K, smooth = record.friction_clamping, record.friction_clamping_smooth
            step = record.clamping_force_step
        record = replace(
            record, clamping_force=K, clamping_force_smooth=smooth, clamping_force_step=step
        )
        return self._with_motors(record)

    def _with_motors(self, record: AxleRecord) -> "AxleChannels":
        """The axle with a record of its friction brake alone, and what the motors add."""
        if self.motors is None:
            return self._replace(record=record)
        phi = self.vehicle.friction.value
        by_motors, by_motors_smooth = self.motors.last_value / phi, self.motors.smooth / phi
        record = replace(
            record,
            clamping_force=record.clamping_force + by_motors,
            clamping_force_smooth=record.clamping_force_smooth + by_motors_smooth,
            motor_clamping=by_motors,
            motor_clamping_smooth=by_motors_smooth,
            motor_sigma=self.motors.sigma,
            traction_known=self.motors.traction_known,
        )
        return self._replace(record=record)

    def as_mean_axle(self, mean: Vehicle, heavier: float = 1.0) -> "AxleChannels":
        """The axle as one of a train of equal axles: with what makes the mean axle brake as it.

        `heavier` is its mass over that of the mean axle of this log.
        """
        record, phi, table = self.record, self.vehicle.friction.value, self.vehicle.friction_table
        mean = mean.of_axle(record.axle)
        factor = heavier * phi / mean.friction.value
        if table is None and mean.friction_table:
            same_at_every_speed = ((phi,),)
            table = FrictionTable((0.0,), (), same_at_every_speed)
        elif table:
            table = table._replace(clamping_force=tuple(factor * K for K in table.clamping_force))
        motors = self.motors and self.motors.scaled(heavier)
        axle = self._replace(vehicle=mean, friction_table=table, motors=motors)
        if record.pressure is None or self.smooth_pressure is None:
            K, smooth = record.friction_clamping, record.friction_clamping_smooth
            step = factor * record.clamping_force_step
            forces = replace(record, clamping_force=factor * K, clamping_force_step=step)
            return axle._with_motors(replace(forces, clamping_force_smooth=factor * smooth))
        line, mean_line = force_line(self.vehicle), force_line(mean)
        # Both are straight lines below the springs' forces, too.
        scale = factor * line.per_pascal / mean_line.per_pascal
        offset = (mean_line.at_zero - factor * line.at_zero) / mean_line.per_pascal
        changed = replace(record, pressure=scale * record.pressure + offset)
        smooth = scale * self.smooth_pressure + offset
        return axle._replace(record=changed, smooth_pressure=smooth).clamped()
