"""The vehicle that everything after uses: what is stated is the prior, the logs are the evidence.

The adhesion of all axles stops the train, so its deceleration shows the force per mass of the
brake. `train.brake_line` reads it from the log alone. Then

| stated | and the log | the vehicle is |
|---|---|---|
| the brake, part of it, or nothing | agrees | the posterior of stated tolerances and log |
| the brake | differs by more than 4 sigma | the stated one, with a band that holds both |
| the brake | slows more, and not by the pressure | the stated one, and `other-brake` says so |
| part or nothing | differs by more than 3 sigma | the log's, by any brake |
| part or nothing | shows no brake | not known: the log has no adhesion in newtons or as µ |

The brake is stated where all is that scales its force per mass: `Settings.unstated_brake`. Parts
that nobody stated are those of the default vehicle, or the log's. A parameter without tolerance
never moves. `[analysis] vehicle = "stated"` keeps the stated one.

Sources: JCGM 102, 6.2; `reference.calibrated_vehicle`.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from ..core.model import (
    Z95,
    AxleRecord,
    CarBrake,
    DifferingStop,
    IdentifiedVehicle,
    LogBrake,
    Parameter,
    Train,
    Vehicle,
    VehicleSource,
)
from ..core.physics import BAR, braked, clamping, force_line, friction_change, piston_area, wheelset
from ..records.brake_applications import find_applications
from ..reference import calibrated_vehicle
from ..reference.calibrated_vehicle import Evidence, MeanBrake
from ..train import longitudinal as model
from ..train import pieces, solve
from ..train.brake_line import ANY_SHARE, ROTATING, BrakeLine, find_brake_line
from ..train.deceleration_cause import explain_deceleration
from ..train.mean_axle import brake_shares, mean_axle, move_axles
from ..train.motor_mass import MASS, find_motor_mass, with_mean_mass
from .prepare import AlignedLog
from .settings import Settings

_DEFAULT_SIGMAS = 3.0  # from which a vehicle that nobody stated is another one
_DEFAULT_ERROR = 0.3  # the same of ln of the force, however uncertain the log
_DOUBT_SIGMAS = 2.0  # from which what is stated is in doubt
_STATED_SIGMAS = 4.0  # from which a stated one does not fit the log
_FADE = Parameter(0.0, 0.015)  # of any pad or block: cast iron loses half of it over 25 m/s [s/m]
_FADE_SIGMAS = 2.0  # from which a fitted fade is not zero
# per pressure and mass, of any brake, the least of a hydraulic one [m/s² per Pa]
_LEAST_FORCE, _MOST_FORCE = 5e-8, 2e-5
_LARGEST_LN = 50.0  # of a force over that of a vehicle without one
_LARGEST_SHARE = 10.0  # 1 sigma of a force that the log contradicts: a unit is wrong, not a value
_ALIKE = 0.01  # share by which axles differ that are shown as one car
ANY_WHEEL = 0.12  # 1 sigma of the radius, as a share: 95 % of diameters are 0.64 to 1.04 m
_LOWEST_ZERO = -3e4  # pressure from which a brake acts: lower, another brake acts [Pa]


class _Setting(NamedTuple):
    """What holds for all logs of one train."""

    train: Train
    axles: int  # of each log
    by_pressure: bool  # whether pressures are logged, not clamping forces


_Lines = dict[int, BrakeLine]  # of the logs that show one, by their place


def identify(logs: Sequence[AlignedLog], settings: Settings) -> IdentifiedVehicle:
    """The vehicle of logs of one train.

    The log shows one error of all axles, in a train of unlike ones too: see `core.mean_axle`.
    """
    settings = with_any_wheel(logs, settings)
    logs, mean = as_equal_axles(logs, settings)
    identified = _identify(logs, replace(settings, vehicle=mean))
    if "friction_fade" not in settings.stated:
        identified = _with_friction_change(identified, mean)
    return of_all_axles(identified, mean, settings.vehicle, logs[0].numbers[0])


def as_equal_axles(
    logs: Sequence[AlignedLog], settings: Settings
) -> tuple[list[AlignedLog], Vehicle]:
    """The logs of a train of equal axles that slows alike, and its axle."""
    numbers = sorted({number for log in logs for number in log.numbers})
    mean = mean_axle(settings.vehicle, numbers)
    return [log.as_mean_axles(mean) for log in logs], mean


def of_all_axles(
    identified: IdentifiedVehicle, mean: Vehicle, vehicle: Vehicle, first: int
) -> IdentifiedVehicle:
    """What was identified of a mean axle, for the axles of a vehicle.

    `mean` and `vehicle` are as stated, `first` is the axle whose force per bar is reported.
    """
    cars = car_brakes(vehicle) if identified.stated_force_per_bar else ()
    identified = replace(identified, mean_axle=(mean, identified.vehicle), cars=cars)
    moved = move_axles(vehicle, mean, identified.vehicle)
    if not vehicle.axles:
        return replace(identified, vehicle=moved)
    used_force = identified.force_per_bar and force_per_bar(moved.of_axle(first))
    stated_force = identified.stated_force_per_bar and force_per_bar(vehicle.of_axle(first))
    identified = replace(identified, force_per_bar=used_force, stated_force_per_bar=stated_force)
    return replace(identified, vehicle=moved)


def at_load(identified: IdentifiedVehicle, vehicle: Vehicle) -> Vehicle:
    """What was identified, for a vehicle as stated with the masses of another load."""
    if not identified.mean_axle:
        return identified.vehicle
    return move_axles(vehicle, *identified.mean_axle)


def with_force_of_log(identified: IdentifiedVehicle, vehicle: Vehicle) -> IdentifiedVehicle:
    """A stated vehicle that the log contradicts, with a 95 % band that holds the log's force, too.

    `vehicle` is as stated. The checks take the one before: such a band hides what is wrong.
    """
    if identified.factor is None or identified.other_brake:
        return identified
    return with_friction_error(identified, vehicle, abs(identified.factor - 1.0) / Z95)


def with_friction_error(
    identified: IdentifiedVehicle, vehicle: Vehicle, share: float
) -> IdentifiedVehicle:
    """An identified vehicle with one more error of its friction, 1 sigma of it as a share.

    `vehicle` is as stated. The error is independent of all others.
    """
    if not identified.mean_axle:
        return identified
    mean, used_axle = identified.mean_axle
    phi = used_axle.friction
    sigma = math.hypot(phi.tolerance, min(share, _LARGEST_SHARE) * phi.value)
    kept_share = phi.tolerance / sigma if sigma else 1.0
    correlation = tuple(
        (a, b, r * kept_share if "friction" in (a, b) else r) for a, b, r in used_axle.correlation
    )
    used_axle = replace(used_axle, friction=Parameter(phi.value, sigma), correlation=correlation)
    moved_vehicle = move_axles(vehicle, mean, used_axle)
    return replace(identified, vehicle=moved_vehicle, mean_axle=(mean, used_axle))


def _identify(logs: Sequence[AlignedLog], settings: Settings) -> IdentifiedVehicle:
    """The same for equal axles."""
    prior, lines = find_prior(logs, settings)
    if not lines or not prior.known or prior.factor is not None:
        return prior
    setting = _setting(logs, settings)
    if not calibrated_vehicle.scale_sigma(prior.vehicle, False, setting.train):
        return prior  # exactly known: nothing can move
    identified, sigmas = _posterior(prior, logs, lines, setting)
    line = _most_rolling(lines)
    if prior.source == "stated" and sigmas > _DOUBT_SIGMAS:
        factor = math.exp(_error(prior.vehicle, line, setting))
        if sigmas > _STATED_SIGMAS:
            return replace(prior, factor=factor)
        return replace(identified, doubt=(factor, sigmas))
    if prior.source == "default" and sigmas > _DEFAULT_SIGMAS:
        vehicle = _any_vehicle(settings.vehicle, settings.stated, line, setting)
        prior = replace(prior, vehicle=vehicle, source="log")
        identified, _ = _posterior(prior, logs, lines, setting)
    return identified


def _with_friction_change(identified: IdentifiedVehicle, mean: Vehicle) -> IdentifiedVehicle:
    """The vehicle with the change of friction over speed that its logs show, if it is a clear one.

    A straight line is not the friction of cast iron, so its slope is as uncertain as it is large. A
    stated table and a vehicle that is used as stated keep their values: what the log shows beyond
    them widens their band.
    """
    changes = [friction_change(effect, mean) for effect in identified.speed_effects.values()]
    slope = max(changes, key=abs, default=0.0)
    if not slope or identified.other_brake or not identified.known:
        return identified
    vehicle, fade = identified.vehicle, identified.vehicle.friction_fade
    is_fitted = abs(fade.value) > _FADE_SIGMAS * fade.tolerance  # to the wheels that roll
    keeps_value = is_fitted or mean.friction_table or identified.factor is not None
    fade = Parameter(fade.value if keeps_value else slope, max(abs(fade.value), abs(slope)))
    own_errors = tuple(x for x in vehicle.correlation if "friction_fade" not in x)
    vehicle = replace(vehicle, friction_fade=fade, correlation=own_errors)
    return replace(identified, vehicle=vehicle)


def _most_rolling(lines: dict[int, BrakeLine]) -> BrakeLine:
    return max(lines.values(), key=lambda x: x.rolling)


def find_prior(
    logs: Sequence[AlignedLog], settings: Settings
) -> tuple[IdentifiedVehicle, dict[int, BrakeLine]]:
    """The vehicle before evidence, and the line of each log that shows one, by its place.

    All axles are equal: see `as_equal_axles`.

    The stated vehicle, or the default one where the logs do not contradict it; else one of which
    nothing is known but the line. Arguments as of `identify`.
    """
    setting, vehicle = _setting(logs, settings), settings.vehicle
    unstated = settings.unstated_brake(setting.by_pressure)
    source: VehicleSource = "default" if unstated else "stated"
    unstated = unstated if settings.states_brake_or_mass else ()
    force = force_per_bar(vehicle) if setting.by_pressure else None
    if settings.analysis.vehicle == "stated":  # by the user, or a result that carries its vehicle
        source = "stated" if vehicle != Vehicle() else source
        carried = settings.carries_vehicle
        return IdentifiedVehicle(vehicle, source, force, force, carried=carried), {}
    prior = IdentifiedVehicle(vehicle, source, force, force, unstated=unstated)
    lines = {i: line for i, log in enumerate(logs) if (line := _find_line(log, settings))}
    mixed = tuple(logs[i].path for i, line in lines.items() if line.mixed)
    if mixed and len(mixed) < len(lines):  # the others show the brake without another one
        lines = {i: line for i, line in lines.items() if not line.mixed}
        prior = replace(prior, differing=mixed)
    stops = {logs[i].path: _differing_stops(logs[i], line) for i, line in lines.items()}
    effects = {logs[i].path: x for i, line in lines.items() if (x := line.speed_effect)}
    prior = replace(prior, differing_stops=stops, speed_effects=effects)
    # one axle of several is measured: the others may brake otherwise
    incomplete = any(f.code == "axle-incomplete" for log in logs for f in log.findings)
    single_pressure = incomplete and all(len(log.axles) == 1 for log in logs)
    if not lines or single_pressure or len(brake_kinds(logs)) > 1:
        return _unknown(prior), {}
    line = with_mean_mass(_most_rolling(lines), lines.values())
    sigmas = _contradiction(vehicle, line, setting)
    if line.mixed and (source == "default" or sigmas > _DOUBT_SIGMAS):
        prior = replace(prior, other_brake=True)
        if source == "stated":
            return replace(prior, factor=math.exp(_error(vehicle, line, setting))), lines
    if source == "stated" and abs(sigmas) > _STATED_SIGMAS:
        return replace(prior, factor=math.exp(_error(vehicle, line, setting))), lines
    differs = abs(sigmas) > _DEFAULT_SIGMAS or abs(_error(vehicle, line, setting)) > _DEFAULT_ERROR
    differs |= line.mass is not None
    if source == "default" and differs:
        # else a unit is wrong, or another brake acts
        is_brake = _LEAST_FORCE < line.slope < _MOST_FORCE and line.zero > _LOWEST_ZERO
        if setting.by_pressure and (line.mixed or not is_brake):
            return _unknown(prior), lines
        vehicle = _any_vehicle(vehicle, settings.stated, line, setting)
        return replace(prior, vehicle=vehicle, source="log", motor_mass=line.mass), lines
    return prior, lines


def find_log_brake(log: AlignedLog, settings: Settings) -> LogBrake | None:
    """The brake that one log alone shows; None where it shows none, or another brake acted.

    The settings have the vehicle that is used.
    """
    # The force of motors and a friction table are in the grid by the vehicle that is used, too.
    (log,), mean = as_equal_axles([log.clamped_by(settings.vehicle)], settings)
    settings = replace(settings, vehicle=mean)
    vehicle, setting = settings.vehicle, _setting([log], settings)
    line = _find_line(log, settings)
    if not line or line.mixed or len(brake_kinds([log])) > 1:
        return None
    ratio = math.exp(min(_error(vehicle, line, setting), _LARGEST_LN))
    per_bar, pressure = (line.slope * BAR, line.brake / BAR) if setting.by_pressure else (None,) * 2
    return LogBrake(per_bar, ratio, line.sigma, pressure, line.speed)


def _find_line(log: AlignedLog, settings: Settings) -> BrakeLine | None:
    """The line of a log, less the force of motors where the mass that it slows is stated."""
    if not log.grids:
        return None
    grid, axles, vehicle, by_motors = log.grids.coarse, log.axles, settings.vehicle, None
    share, mass = settings.train.braked_share(vehicle, len(axles)), None
    if "axle_mass" not in settings.stated and log.motors_by_axle:
        is_stated = "wheelset_inertia" in settings.stated
        mass = find_motor_mass(axles, grid, vehicle, share, is_stated)
        vehicle = replace(vehicle, axle_mass=mass) if mass else vehicle
    if grid.motors is None or "axle_mass" in settings.stated or mass:
        by_motors = pieces.motor_deceleration(grid, vehicle, axles, share)
    line = find_brake_line(axles, grid, _rotating_share(vehicle, settings.stated), by_motors)
    return line and line._replace(mass=mass)


def _differing_stops(log: AlignedLog, line: BrakeLine) -> tuple[DifferingStop, ...]:
    """The stops that the line of a log does not explain, after the start of the log."""
    assert log.grids is not None
    since = (log.grids.coarse.start_ns - log.view.start_ns) * 1e-9
    return tuple(x._replace(start=since + x.start, stop=since + x.stop) for x in line.differing)


def _setting(logs: Sequence[AlignedLog], settings: Settings) -> "_Setting":
    return _Setting(settings.train, len(logs[0].axles), brake_kinds(logs) == {"pressure"})


def _unknown(prior: IdentifiedVehicle) -> IdentifiedVehicle:
    """The stated vehicle without evidence; nothing where nobody stated it."""
    if prior.source == "stated":
        return prior
    return replace(prior, known=False, force_per_bar=None, stated_force_per_bar=None)


def brake_kinds(logs: Sequence[AlignedLog]) -> set[str]:
    """What the brakes are measured by: pressures, clamping forces."""
    return {str(a.brake.meaning) for log in logs for a in log.axles}


def force_per_bar(vehicle: Vehicle) -> Parameter:
    """Brake force at the rim of an axle's wheels per bar, with 1 sigma [N]. Source: (15)."""
    shares = brake_shares(vehicle)
    force = vehicle.friction.value * force_line(vehicle).per_pascal * BAR
    return Parameter(force, force * math.sqrt(float(vehicle.covariance(shares, shares))))


def deceleration_per_bar(vehicle: Vehicle) -> Parameter:
    """Deceleration per bar of a car whose axles all brake and roll, with 1 sigma [m/s²]."""
    shares = calibrated_vehicle.slowing_shares(vehicle, radius=False)
    slowing = float(braked(force_line(vehicle).per_pascal * BAR, wheelset(vehicle, 1)))
    return Parameter(slowing, slowing * math.sqrt(float(vehicle.covariance(shares, shares))))


def car_brakes(vehicle: Vehicle) -> tuple[CarBrake, ...]:
    """The brake of each car; of several where the axles of a car differ by more than a percent."""
    if not vehicle.axles:
        return (_car_brake("", (), vehicle),)
    cars: list[CarBrake] = []
    for car_axle in vehicle.axles:
        brake = _car_brake(car_axle.car, (car_axle.number,), car_axle.vehicle)
        for i, car in enumerate(cars):
            pairs = (car.force, brake.force), (car.deceleration, brake.deceleration)
            has_equal_brakes = all(abs(x.value / y.value - 1.0) < _ALIKE for x, y in pairs)
            if has_equal_brakes and car.name == car_axle.car:
                cars[i] = car._replace(axles=(*car.axles, car_axle.number))
                break
        else:
            cars.append(brake)
    if len(cars) == 1 and not cars[0].name:
        cars[0] = cars[0]._replace(axles=())
    return tuple(cars)


def _car_brake(name: str, axles: tuple[int, ...], vehicle: Vehicle) -> CarBrake:
    state = vehicle.friction_table.middle if vehicle.friction_table else None
    return CarBrake(name, axles, force_per_bar(vehicle), deceleration_per_bar(vehicle), state)


def _rotating_share(vehicle: Vehicle, stated_names: frozenset[str]) -> Parameter:
    """Rotating mass over mass: of a stated inertia, else of any wheelset."""
    if "wheelset_inertia" not in stated_names:
        return ROTATING
    w, R = wheelset(vehicle, 1), vehicle.radius(1)
    share = w.inertia / (w.mass * w.radius**2)
    inertia, mass = vehicle.wheelset_inertia, vehicle.axle_mass
    return Parameter(share, math.hypot(inertia.share, mass.share, 2.0 * R.share) * share)


def _contradiction(vehicle: Vehicle, line: BrakeLine, setting: _Setting) -> float:
    """By how many sigma a log's brake differs from the vehicle's, with its sign."""
    _, sigma = _by_vehicle(vehicle, line, setting)
    return _error(vehicle, line, setting) / math.hypot(sigma, line.sigma)


def _error(vehicle: Vehicle, line: BrakeLine, setting: _Setting) -> float:
    """Ln of the line's deceleration at its mean brake over the vehicle's; infinite without one."""
    deceleration, _ = _by_vehicle(vehicle, line, setting)
    return math.log(line.slope * line.brake / deceleration) if deceleration > 0.0 else math.inf


def _by_vehicle(vehicle: Vehicle, line: BrakeLine, setting: _Setting) -> tuple[float, float]:
    """Deceleration by the vehicle at the mean brake of a line [m/s²], and 1 sigma of its ln."""
    K, w = _clamping_force(vehicle, line, setting), wheelset(vehicle, 1)
    share = setting.train.braked_share(vehicle, setting.axles)
    deceleration = share * w.phi * K * w.rolling / w.mass
    sigma = calibrated_vehicle.scale_sigma(vehicle, not line.rolling, setting.train)
    spring = force_line(vehicle).at_zero * setting.by_pressure / max(K, 1e-9)
    tolerance = vehicle.spring_force.tolerance / max(vehicle.spring_force.value, 1e-9)
    return deceleration, math.hypot(sigma, spring * tolerance)


def _clamping_force(vehicle: Vehicle, line: BrakeLine, setting: _Setting) -> float:
    """K at the mean brake of a line [N]."""
    x = line.brake + line.zero
    return float(clamping(force_line(vehicle), x)) if setting.by_pressure else x


def _any_vehicle(
    vehicle: Vehicle, stated_names: frozenset[str], line: BrakeLine, setting: _Setting
) -> Vehicle:
    """The vehicle of a line, with a brake of which nothing is known; stated parts are kept."""
    changed: dict[str, Any] = {}
    correlation = []
    if "axle_mass" not in stated_names:
        changed["axle_mass"] = line.mass or MASS
    if "friction_fade" not in stated_names and not vehicle.friction_table:
        changed["friction_fade"] = _FADE
    mass, R = changed.get("axle_mass", vehicle.axle_mass), vehicle.radius(1).value
    if "wheelset_inertia" not in stated_names:
        shares = ROTATING.share, mass.share
        sigma = math.hypot(*shares)
        I = ROTATING.value * mass.value * R * R  # noqa: E741
        changed["wheelset_inertia"] = Parameter(I, sigma * I)
        correlation = [("axle_mass", "wheelset_inertia", shares[1] / sigma)]
    vehicle = replace(vehicle, **changed, correlation=tuple(correlation))
    w = wheelset(vehicle, 1)
    share = setting.train.braked_share(vehicle, setting.axles)
    per_unit = line.slope * w.mass / w.rolling / share  # φ dK/dx
    if not setting.by_pressure:
        return replace(vehicle, friction=Parameter(per_unit, ANY_SHARE * per_unit))
    phi, per_pascal = vehicle.friction.value, force_line(vehicle).per_pascal
    # The same force at the mean brake, with x₀ before the log: it has it as evidence once.
    zero = line.prior_zero
    per_unit *= line.brake / max(line.brake + line.zero - zero.value, 0.1 * line.brake)
    ratio = per_unit / phi / per_pascal * vehicle.lever_ratio.value
    piston, lever_ratio = piston_area(vehicle), Parameter(ratio, 0.0)
    spring = Parameter(zero.value * piston, zero.tolerance * piston)
    friction = Parameter(phi, ANY_SHARE * phi)
    return replace(vehicle, friction=friction, lever_ratio=lever_ratio, spring_force=spring)


def _evidence(log: AlignedLog, vehicle: Vehicle, setting: _Setting) -> Evidence:
    """What the rolling brake applications of a log say, with a vehicle near its own."""
    log = log.clamped_by(vehicle)
    assert log.grids is not None
    explanation = explain_deceleration(log.axles, log.grids, vehicle, setting.train)
    record = log.axles[0].record
    start_ns = log.grids.coarse.start_ns
    return calibrated_vehicle.evidence(explanation, start_ns, record, find_applications(record))


def _posterior(
    prior: IdentifiedVehicle, logs: Sequence[AlignedLog], lines: _Lines, setting: _Setting
) -> tuple[IdentifiedVehicle, float]:
    """The vehicle of prior and evidence, and by how many sigma the evidence differs from the prior.

    A brake that the longitudinal model does not describe, as cast iron whose friction falls quickly
    with speed, leaves it with another force than the line, which is the mean of what was measured.
    """
    vehicle = prior.vehicle
    evidence = [_evidence(logs[i], vehicle, setting) for i in lines]
    setting = setting._replace(train=calibrated_vehicle.train_by(evidence, setting.train))
    rolling = [e for e in evidence if e.applications()]
    line = min(lines.values(), key=lambda x: x.sigma)
    calibrated, sigmas = None, abs(_contradiction(vehicle, line, setting))
    if rolling:
        designs = pieces.join_designs([e.design for e in rolling if e.design], vehicle)
        parameters = calibrated_vehicle.prior(designs, vehicle, rolling, setting.train)
        posterior = solve.joint(designs, parameters)
        brake_point = calibrated_vehicle.mean_brake(designs)
        calibrated = calibrated_vehicle.calibrate_vehicle(
            vehicle, logs[0].axles[0].record, brake_point, parameters, posterior, len(designs)
        ).vehicle
    # Where most of the braking has slides, the line takes them and the model does not. And nothing
    # but the log holds a brake of which nothing is known to the mean of what was measured.
    by_line = calibrated is None or not line.rolling
    if calibrated and prior.source == "log":
        by_line |= abs(_error(calibrated, line, setting)) > line.sigma
    if calibrated is None or by_line:
        calibrated = _by_line(vehicle, logs[0].axles[0].record, [*lines.values()], setting)
    elif prior.source != "log":
        # What a normal prior moves by has the variance that it loses.
        n, g = model.SHARED, brake_point.gradient
        change = float(g @ (posterior.mean[:n] - posterior.prior))
        lost_variance = np.diag(posterior.prior_sigma**2) - posterior.covariance[:n, :n]
        sigmas = abs(change) / math.sqrt(max(float(g @ lost_variance @ g), 1e-12))
    distances = {logs[i].path: _contradiction(calibrated, x, setting) for i, x in lines.items()}
    differing = (path for path, x in distances.items() if abs(x) > _STATED_SIGMAS)
    identified = replace(
        prior,
        vehicle=calibrated,
        force_per_bar=force_per_bar(calibrated) if setting.by_pressure else None,
        stops=sum(e.applications() for e in rolling) or len(evidence),
        logs=len(evidence),
        differing=(*prior.differing, *differing) if len(lines) > 1 else prior.differing,
    )
    return identified, sigmas


def _by_line(
    vehicle: Vehicle, record: AxleRecord, lines: Sequence[BrakeLine], setting: _Setting
) -> Vehicle:
    """The vehicle of its prior and the lines: each measures ln of the force at its mean brake."""
    line = min(lines, key=lambda x: x.sigma)
    top = _clamping_force(vehicle, line, setting)
    brake_point = MeanBrake(top, 1.0, line.speed, 0.0, not line.rolling)
    prior = model.line_prior(vehicle, top, line.speed)
    scale = calibrated_vehicle.scale_sigma(vehicle, brake_point.by_wheels, setting.train)
    prior[model.SCALE] = Parameter(0.0, scale)
    errors = np.array([_error(vehicle, x, setting) for x in lines])
    weights = np.array([x.sigma**-2.0 for x in lines]) * np.isfinite(errors)
    error = float(np.sum(weights * np.nan_to_num(errors)) / weights.sum())
    # What lines differ by beyond their own errors, friction over force and speed, is in it, too.
    scatter = float(np.sum(weights * (np.nan_to_num(errors) - error) ** 2) / weights.sum())
    variance = max(1.0 / float(weights.sum()), scatter)
    mean, sigmas = np.array([prior[i] for i in range(model.SHARED)]).T
    covariance, g = np.diag(sigmas**2), brake_point.gradient
    gain = covariance @ g / (g @ covariance @ g + variance)
    covariance = covariance - np.outer(gain, g @ covariance)
    posterior = solve.Posterior(mean, sigmas, mean + gain * error, covariance, 0.0)
    return calibrated_vehicle.calibrate_vehicle(
        vehicle, record, brake_point, prior, posterior, logs=1
    ).vehicle


def is_wheel_unknown(log: AlignedLog, settings: Settings) -> bool:
    """Whether speeds count turns of wheels that nobody states, and no train speed shows them."""
    states_wheel = "wheel_radius" in settings.stated or settings.analysis.vehicle == "stated"
    return not states_wheel and any(not a.record.of_rim and a.train is None for a in log.axles)


def with_any_wheel(logs: Sequence[AlignedLog], settings: Settings) -> Settings:
    """The settings; with wheels of any railway vehicle where a log does not show the diameter."""
    if not any(is_wheel_unknown(log, settings) for log in logs):
        return settings
    axles = tuple(x._replace(vehicle=_any_wheel(x.vehicle)) for x in settings.vehicle.axles)
    return replace(settings, vehicle=replace(_any_wheel(settings.vehicle), axles=axles))


def _any_wheel(vehicle: Vehicle) -> Vehicle:
    radii = (Parameter(R.value, ANY_WHEEL * R.value) for R in vehicle.wheel_radius)
    return replace(vehicle, wheel_radius=tuple(radii))
