"""Brakes a train in the computer: scenario → true signals → what a logger would have written.

One car body of mass M = Σ m shared by every wheelset, each with its own brake cylinder; (1) per
wheelset with Polach's adhesion force (3):

    M v̇ = −Σ F_i,    ω̇_i = a (F_i − φK_i) while the wheel turns.

A wheel that stands is held by its brake up to φK; a train that stands stays (level track, F = 0).
The equations are stiff: near adhesion the slip settles within 1/(a R ∂F/∂Δv), 2 ms at 20 m/s and
20 µs at walking pace. They are integrated by the two-stage, L-stable, stiffly accurate SDIRK
method of order 2 (R. Alexander, SIAM J. Numer. Anal. 14 (1977) 1006-1021, γ = 1 − 1/√2), whose
last stage is the new state: F in the output satisfies (3) at the sample it stands beside. Steps
end at every jump or kink of the brake demand, of a rail that changes with time, and of the valves.
"""

import math
import tomllib
import types
import typing
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields, is_dataclass, replace
from decimal import Decimal
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from . import physics
from .errors import UserError, unknown
from .model import Floats, Parameter, Quantity, Times, Vehicle
from .rail import SLOWEST, Condition, Contact, Patch, condition, creep_force
from .read.units import UNITS, Dimension

INF = math.inf
GAMMA = 1.0 - math.sqrt(0.5)  # makes the method L-stable and of order 2
STANDSTILL = 1e-3  # a braked train slower than this stands [m/s]
APPLY, HOLD, VENT = 0, 1, 2  # valves of the wheel slide protection

Signal = Literal["pressure", "clamping_force", "wheel_speed", "train_speed", "truth", "slip"]


# --- scenario -----------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Train:
    """The train at the start, and where its axles run."""

    speed: Annotated[float, Quantity("m/s", "speed at the start", 0.0, 150.0)] = 20.0
    axles: Annotated[int, Quantity("-", "number of braked wheelsets under the car body", 1, 64)] = 1
    positions: Annotated[
        tuple[float, ...], Quantity("m", "distance of each axle behind the first", 0.0, 1000.0)
    ] = ()
    cleaning: Annotated[
        tuple[float, ...],
        Quantity(
            "-",
            "friction f0 under each axle over f0 of the rail: earlier wheels clean it",
            0.0,
            20.0,
        ),
    ] = ()


@dataclass(frozen=True, slots=True)
class Command:
    """One change of the brake demand: a step, or a ramp from the demand before."""

    at: Annotated[float, Quantity("s", "when the change starts", 0.0)]
    pressure: Annotated[float | None, Quantity("Pa", "cylinder pressure asked for", 0.0, 2e6)] = (
        None
    )
    clamping_force: Annotated[
        float | None, Quantity("N", "clamping force K asked for, instead of a pressure", 0.0, 1e6)
    ] = None
    ramp: Annotated[float, Quantity("s", "duration of the change", 0.0)] = 0.0


@dataclass(frozen=True, slots=True)
class Brake:
    """Brake demand and how the cylinder follows it: later, with a lag, no faster than its rate."""

    command: tuple[Command, ...] = ()
    dead_time: Annotated[float, Quantity("s", "from demand to first flow", 0.0, 10.0)] = 0.0
    fill_time: Annotated[float, Quantity("s", "time constant of filling", 0.0, 20.0)] = 0.0
    vent_time: Annotated[float, Quantity("s", "time constant of venting", 0.0, 20.0)] = 0.0
    fill_rate: Annotated[float, Quantity("Pa/s", "fastest filling", 0.0)] = INF
    vent_rate: Annotated[float, Quantity("Pa/s", "fastest venting", 0.0)] = INF


@dataclass(frozen=True, slots=True)
class Section:
    """The rail from a place (or time) on."""

    at: Annotated[float, Quantity("m or s", "where the section starts", 0.0)]
    condition: str
    scale: Annotated[float, Quantity("-", "factor on f0", 0.0, 20.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Film:
    """Equal patches on top of the sections, as leaves leave them."""

    condition: str
    first: Annotated[float, Quantity("m or s", "where the first patch starts", 0.0)]
    length: Annotated[float, Quantity("m or s", "length of a patch", 0.0)]
    pitch: Annotated[float, Quantity("m or s", "from patch to patch", 0.0)]
    count: Annotated[int, Quantity("-", "number of patches", 1, 10000)] = 1
    scale: Annotated[float, Quantity("-", "factor on f0", 0.0, 20.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Wave:
    """f0 swings about its value: f0 (1 + amplitude sin 2πz/period)."""

    amplitude: Annotated[float, Quantity("-", "relative amplitude", 0.0, 0.99)]
    period: Annotated[float, Quantity("m or s", "length of one swing", 1e-3)]


@dataclass(frozen=True, slots=True)
class Rail:
    """The rail along the distance run by each axle, or along time."""

    section: tuple[Section, ...]
    along: Literal["distance", "time"] = "distance"
    blend: Annotated[
        float, Quantity("m or s", "length over which one condition turns into the next", 1e-6)
    ] = 0.1
    film: Film | None = None
    wave: Wave | None = None


@dataclass(frozen=True, slots=True)
class Wsp:
    """A simple wheel slide protection that knows the true slip; real ones do better."""

    hold_slip: Annotated[float, Quantity("-", "slip from which the pressure is held", 0.0, 1.0)] = (
        0.08
    )
    vent_slip: Annotated[
        float, Quantity("-", "slip from which the cylinder is vented", 0.0, 1.0)
    ] = 0.15
    vent_time: Annotated[
        float, Quantity("s", "time constant of venting through its valve", 0.0, 5.0)
    ] = 0.15
    period: Annotated[float, Quantity("s", "time between decisions", 1e-4, 1.0)] = 0.02
    slowest: Annotated[float, Quantity("m/s", "train speed below which it is off", 0.0, 20.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Rig:
    """A roller rig: the rail runs at constant speed, slip rises evenly from 0, the brake is whatever holds it."""

    slip: Annotated[float, Quantity("-", "slip at the end of the sweep", 0.0, 0.99)]


@dataclass(frozen=True, slots=True)
class Sensor:
    """One kind of channel of the log, on one or all axles."""

    signal: Signal
    unit: str = ""
    rate: Annotated[float, Quantity("Hz", "samples per second", 1e-3, 1e5)] = 100.0
    axles: Annotated[tuple[int, ...], Quantity("-", "axles that have it; empty: all", 1, 64)] = ()
    noise_variance: Annotated[
        float, Quantity("SI²", "variance of the white noise on each sample", 0.0)
    ] = 0.0
    resolution: Annotated[
        float, Quantity("unit of the log", "step to which the value is rounded", 0.0)
    ] = 0.0
    offset: Annotated[float, Quantity("SI", "added to the true value", -INF)] = 0.0
    delay: Annotated[
        float, Quantity("s", "transport delay: the time stamp is that much late", 0.0, 10.0)
    ] = 0.0
    jitter: Annotated[
        float, Quantity("s", "largest error of the time stamp, evenly distributed", 0.0, 10.0)
    ] = 0.0
    loss: Annotated[float, Quantity("-", "share of samples that never arrive", 0.0, 0.99)] = 0.0
    gaps: Annotated[
        tuple[tuple[float, float], ...], Quantity("s", "[start, end] of drop-outs", 0.0)
    ] = ()
    teeth: Annotated[
        int, Quantity("-", "teeth of a pulse counter read at `rate`; 0: none", 0, 100000)
    ] = 0
    diameter_error: Annotated[
        float,
        Quantity("-", "true wheel diameter over the one the logger assumes, less 1", -0.2, 0.2),
    ] = 0.0


@dataclass(frozen=True, slots=True)
class Scenario:
    """Everything a simulation depends on; SI."""

    name: str
    description: str
    duration: Annotated[float, Quantity("s", "simulated time", 1e-3, 1e6)]
    rail: Rail
    sensor: tuple[Sensor, ...] = ()
    train: Train = Train()
    brake: Brake = Brake()
    vehicle: Vehicle = Vehicle()
    contact: Contact = Contact()
    wsp: Wsp | None = None
    rig: Rig | None = None
    dt: Annotated[
        float, Quantity("s", "step of integration and of the dense output", 1e-6, 0.02)
    ] = 1e-3
    seed: Annotated[int, Quantity("-", "seed of the sensor noise", 0)] = 0


def scenarios() -> dict[str, str]:
    """The bundled scenarios: name and one line on each."""
    return {path.stem: _toml(path)["description"] for path in sorted(_bundled().glob("*.toml"))}


def load(name_or_path: str | Path) -> Scenario:
    """A bundled scenario by name, or one from a TOML file.

    Raises:
        UserError: no such scenario, unreadable TOML, unknown key, value of a wrong type or out of
            range, parts that contradict each other.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = _bundled() / f"{name_or_path}.toml"
        if not path.exists():
            raise unknown("scenario", str(name_or_path), list(scenarios()))
    table = {"name": path.stem, **_toml(path)}
    if "vehicle" in table:
        table["vehicle"] = _vehicle(table["vehicle"], f"{path}: [vehicle]")
    scenario: Scenario = _parsed(Scenario, table, str(path))
    _check(scenario, str(path))
    return scenario


def _bundled() -> Path:
    return Path(__file__).parent / "scenarios"


def _toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as e:
        raise UserError(f"{path}: cannot be read: {e.strerror}", "name a scenario TOML") from e
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as e:
        raise UserError(f"{path}: not a TOML file: {e}", "see `adhesion simulate --help`") from e


def _parsed(kind: Any, value: Any, where: str, quantity: Quantity | None = None) -> Any:
    """`value` from a TOML as the annotated type `kind`, checked."""
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        return _parsed(args[0], value, where, args[1])
    if origin is types.UnionType:
        return _parsed(args[0], value, where, quantity)  # T | None, and TOML has no None
    if isinstance(value, kind if origin is None else ()) and is_dataclass(kind):
        return value
    if is_dataclass(kind) and isinstance(value, dict):
        return _table(kind, value, where)
    if origin is tuple and isinstance(value, list):
        inner = args[:1] * len(value) if args[-1] is Ellipsis else args
        if len(inner) == len(value):
            return tuple(_parsed(k, v, where, quantity) for k, v in zip(inner, value, strict=True))
    if origin is Literal:
        if value in args:
            return value
        raise unknown(f"value of {where}:", str(value), list(args))
    if kind is str and isinstance(value, str):
        return value
    if kind in (int, float) and isinstance(value, (int, kind)) and not isinstance(value, bool):
        assert quantity is not None
        return kind(_in_range(value, quantity, where))
    wanted = "a table" if is_dataclass(kind) else "a list" if origin is tuple else kind.__name__
    raise UserError(f"{where}: {value!r} is not {wanted}", "see the bundled scenarios", code=2)


def _table(kind: Any, table: Mapping[str, Any], where: str) -> Any:
    hints = typing.get_type_hints(kind, include_extras=True)
    for key in table:
        if key not in hints:
            raise unknown(f"key in {where}:", key, list(hints))
    for f in fields(kind):
        if f.default is MISSING and f.name not in table:
            raise UserError(f"{where}: {f.name} is missing", f"add {f.name} = …", code=2)
    return kind(**{key: _parsed(hints[key], v, f"{where} {key}") for key, v in table.items()})


def _in_range(value: float, q: Quantity, where: str) -> float:
    if not q.low <= value <= q.high:
        hint = f"{q.text}, from {q.low:g} to {q.high:g} {q.unit}"
        raise UserError(f"{where} = {value:g} is out of range", hint, code=2)
    return value


def _vehicle(table: Any, where: str) -> Vehicle:
    """The vehicle of a scenario: plain numbers, since a simulation has no tolerances."""
    hints = typing.get_type_hints(Vehicle, include_extras=True)
    changed: dict[str, Any] = {}
    for key, value in table.items():
        if key not in hints:
            raise unknown(f"key in {where}:", key, list(hints))
        q: Quantity = typing.get_args(hints[key])[1]
        listed = key == "wheel_radius" and isinstance(value, list)
        numbers = value if listed else [value]
        if not all(isinstance(x, (int, float)) for x in numbers):
            raise UserError(f"{where} {key}: {value!r} is not a number", "SI, as 0.42", code=2)
        parameters = tuple(
            Parameter(_in_range(float(x), q, f"{where} {key}"), 0.0) for x in numbers
        )
        changed[key] = parameters if key == "wheel_radius" else parameters[0]
    return replace(Vehicle(), **changed)


def _check(s: Scenario, where: str) -> None:
    """Refuse parts that contradict each other."""

    def refuse(place: str, what: str, hint: str) -> UserError:
        return UserError(f"{where}: {place}: {what}", hint, code=2)

    for key in ("positions", "cleaning"):
        if len(getattr(s.train, key)) not in (0, s.train.axles):
            raise refuse(
                f"[train] {key}", f"not one per axle ({s.train.axles})", "state all or none"
            )
    if len(s.vehicle.wheel_radius) not in (1, s.train.axles):
        raise refuse(
            "[vehicle] wheel_radius", f"not one per axle ({s.train.axles})", "state one or all"
        )
    end = 0.0
    for c in s.brake.command:
        if (c.pressure is None) == (c.clamping_force is None):
            raise refuse(
                "[[brake.command]]", "one of pressure and clamping_force", "state just one"
            )
        if c.at < end:
            raise refuse(
                "[[brake.command]]",
                f"at = {c.at:g} lies before the end of the last",
                "order them by time",
            )
        end = c.at + c.ramp
    places = [p for p, _, _ in _sections(s.rail)]
    if not places or places[0] != 0.0:
        raise refuse("[[rail.section]]", "no section starts at 0", "add at = 0.0")
    if min(np.diff(places), default=INF) < s.rail.blend:
        raise refuse(
            "[rail]",
            f"sections or film patches closer than blend = {s.rail.blend:g}",
            "shorten blend, or order them",
        )
    if s.rig and s.train.axles != 1:
        raise refuse("[rig]", "a roller rig has one axle", "axles = 1")
    for sensor in s.sensor:
        expected = _DIMENSIONS[sensor.signal]
        unit = UNITS.get(sensor.unit.lower())
        if (unit.dimension if unit else None) not in expected:
            good = [
                u for u in _USUAL_UNITS if (UNITS[u.lower()].dimension if u else None) in expected
            ]
            raise refuse(
                f"[[sensor]] {sensor.signal}",
                f"unit {sensor.unit!r} does not fit",
                f"such as {', '.join(map(repr, good))}",
            )
        if (
            sensor.teeth
            and sensor.signal != "wheel_speed"
            or sensor.unit == "count"
            and not sensor.teeth
        ):
            raise refuse(
                f"[[sensor]] {sensor.signal}",
                "a pulse counter needs teeth, and a wheel",
                "teeth = 100",
            )
        if sensor.jitter >= 0.5 / sensor.rate:
            raise refuse(
                f"[[sensor]] {sensor.signal}",
                "jitter reaches the next sample",
                "below half of 1/rate",
            )
        if any(axle > s.train.axles for axle in sensor.axles):
            raise refuse(
                f"[[sensor]] {sensor.signal}", f"axles beyond {s.train.axles}", "count from 1"
            )


# --- plant --------------------------------------------------------------------------------------


class _Line(NamedTuple):
    """A straight piece of (15): K = per_pascal · p − at_zero, never negative."""

    per_pascal: float
    at_zero: float


class _Plant(NamedTuple):
    """What the loop needs of train, brake and valves; arrays of shape (axles,)."""

    radius: Floats
    a: float  # R / I of a radius of 1 m [1/(kg m²)]
    phi: float
    mass: float  # of the train
    line: _Line
    patch: Patch
    positions: Floats
    cleaning: Floats
    fill_time: float
    vent_time: float
    fill_rate: float
    vent_rate: float
    valve_period: float  # inf: no wheel slide protection
    valve_time: float
    hold_slip: float
    vent_slip: float
    valve_slowest: float


class _Track(NamedTuple):
    """Rail condition as straight lines between knots."""

    timed: bool  # knots are times, not places
    knots: Floats  # (k,), the last one at infinity
    values: Floats  # (k, 5), fields of `Condition`
    amplitude: float
    period: float


def _line(vehicle: Vehicle) -> _Line:
    """(15) as a straight line, read off well above the spring force."""
    high = 1e9
    K = physics.clamping_force(np.array([high, 2.0 * high]), vehicle)
    per_pascal = float(K[1] - K[0]) / high
    return _Line(per_pascal, per_pascal * high - float(K[0]))


def _demand(s: Scenario) -> tuple[Floats, Floats]:
    """Knots of the demanded pressure at the cylinder: times [s] and pressures [Pa]."""
    line = _line(s.vehicle)
    t, p = [-1.0], [0.0]
    for c in s.brake.command:
        K = c.clamping_force
        goal = c.pressure if K is None else (K + line.at_zero) / line.per_pascal if K > 0 else 0.0
        assert goal is not None
        start = c.at + s.brake.dead_time
        t += [start, start + c.ramp]
        p += [p[-1], goal]
    return np.array([*t, INF]), np.array([*p, p[-1]])


def _sections(rail: Rail) -> list[tuple[float, str, float]]:
    """(place, condition, factor on f0) of every change, film patches laid over the sections."""
    base = [(x.at, x.condition, x.scale) for x in rail.section]
    if rail.film is None:
        return base
    film = rail.film
    starts = [film.first + k * film.pitch for k in range(film.count)]
    changes = [x for x in base if not any(a <= x[0] <= a + film.length for a in starts)]
    for a in starts:
        below = [x for x in base if x[0] <= a + film.length]
        changes.append((a, film.condition, film.scale))
        changes += [(a + film.length, *x[1:]) for x in below[-1:]]
    return sorted(changes)


def _track(rail: Rail) -> _Track:
    knots, values = [], []
    for place, name, scale in _sections(rail):
        c = condition(name)
        row = c._replace(f0=c.f0 * scale)
        if knots:
            knots.append(place)
            values.append(values[-1])
        knots.append(place + rail.blend if knots else place)
        values.append(row)
    wave = rail.wave or Wave(0.0, 1.0)
    knots, values = [*knots, INF], [*values, values[-1]]
    return _Track(
        rail.along == "time", np.array(knots), np.array(values), wave.amplitude, wave.period
    )


def _plant(s: Scenario) -> _Plant:
    n, m = s.train.axles, s.vehicle.axle_mass.value
    wsp = s.wsp or Wsp()
    return _Plant(
        radius=np.array([s.vehicle.radius(axle).value for axle in range(1, n + 1)]),
        a=1.0 / s.vehicle.wheelset_inertia.value,
        phi=s.vehicle.friction.value,
        mass=n * m,
        line=_line(s.vehicle),
        patch=s.contact.patch(m * physics.G),
        positions=np.array(s.train.positions or [0.0] * n),
        cleaning=np.array(s.train.cleaning or [1.0] * n),
        fill_time=s.brake.fill_time,
        vent_time=s.brake.vent_time,
        fill_rate=s.brake.fill_rate,
        vent_rate=s.brake.vent_rate,
        valve_period=wsp.period if s.wsp else INF,
        valve_time=wsp.vent_time,
        hold_slip=wsp.hold_slip,
        vent_slip=wsp.vent_slip,
        valve_slowest=wsp.slowest,
    )


# --- integration --------------------------------------------------------------------------------

_SOON = 1e-10  # events this close count as one [s]
_TIGHT = 1e-11  # last Newton correction [m/s]
_PATIENCE = 60  # Newton iterations


def _rail_at(track: _Track, z: float, j: int, cleaning: float) -> tuple[Condition, int]:
    """Rail condition at place or time `z`, and the knot before it; `j` is a knot no later."""
    while track.knots[j + 1] <= z:
        j += 1
    part = max(0.0, (z - track.knots[j]) / (track.knots[j + 1] - track.knots[j]))
    a, b = track.values[j], track.values[j + 1]
    f0 = a[2] + part * (b[2] - a[2])
    f0 *= cleaning * (1.0 + track.amplitude * math.sin(2.0 * math.pi * z / track.period))
    return Condition(
        a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]), f0,
        a[3] + part * (b[3] - a[3]), a[4] + part * (b[4] - a[4]),
    ), j  # fmt: skip


def _filled(
    p: float, c0: float, c1: float, h: float, lag: float, fill_rate: float, vent_rate: float
) -> float:
    """Cylinder pressure after `h`, the demand going straight from c0 to c1; exact but for limits."""
    if h == 0.0:
        return c0 if lag == 0.0 and fill_rate == vent_rate == math.inf else p
    late = (c1 - c0) / h * lag  # how far a lag trails a ramp
    p1 = c1 if lag == 0.0 else c1 - late + (p - c0 + late) * math.exp(-h / lag)
    return min(max(p1, p - vent_rate * h), p + fill_rate * h)


def _stage(
    plant: _Plant, rails: list[Condition], friction: Floats, h: float,
    v_from: float, w_from: Floats, v: float, w: Floats, work: Floats,
) -> float:  # fmt: skip
    """Implicit stage: v = v_from − h ΣF/M, w = max(0, w_from + h R² (F − B)/I), w rim speeds.

    Newton's method with the Jacobian's arrow shape used; F falls so steeply about zero sliding that
    an iterate never crosses it but starts again from there, where F is steepest and it cannot
    overshoot. `v` and `w` are the first guess; `w` becomes the answer.

    Returns:
        v, or NaN where the iteration did not converge.
    """
    e = h / plant.mass
    for _ in range(_PATIENCE):
        residual, slope = v - v_from, 1.0
        for i in range(len(w)):
            F, D = creep_force(v - w[i], v, rails[i], plant.patch)
            c = h * plant.a * plant.radius[i] ** 2
            g = w[i] - w_from[i] - c * (F - friction[i])
            if w[i] <= 0.0 and g >= 0.0:  # the brake holds it
                g, c = 0.0, 0.0
            work[i, 0], work[i, 1], work[i, 2] = g, c, D
            residual += e * (F + D * g / (1.0 + c * D))
            slope += e * D / (1.0 + c * D)
        dv = -residual / slope
        largest = abs(dv)
        for i in range(len(w)):
            g, c, D = work[i, 0], work[i, 1], work[i, 2]
            rim = w[i] + (c * D * dv - g) / (1.0 + c * D)
            if (v - w[i]) * (v + dv - rim) < 0.0:
                rim = v + dv
            rim = max(rim, 0.0)
            largest = max(largest, abs(rim - w[i]))
            w[i] = rim
        v += dv
        if largest < _TIGHT:
            return v
    return math.nan


def _integrate(
    plant: _Plant, track: _Track, demand_t: Floats, demand_p: Floats, v: float, dt: float,
    pressure: Floats, wheel_speed: Floats, force: Floats, speed: Floats, distance: Floats,
) -> float:  # fmt: skip
    """Fills the columns, shape (n, axles) and (n,); returns NaN, or the time [s] Newton failed."""
    n, axles = pressure.shape
    p, friction = np.zeros(axles), np.zeros(axles)
    w, w_new, w_from = np.full(axles, v), np.zeros(axles), np.zeros(axles)
    before = np.full(axles, v)
    valve = np.zeros(axles, np.int64)
    knot = np.zeros(axles, np.int64)
    work = np.zeros((axles, 3))
    rails = [Condition(0.0, 0.0, 0.0, 0.0, 0.0) for _ in range(axles)]
    x, segment, decisions, timed_knot = 0.0, 0, 0, 0
    for k in range(n):
        t, end = k * dt, (k + 1) * dt
        first = True
        while first or t < end - _SOON:
            while demand_t[segment + 1] <= t + _SOON:
                segment += 1
            while track.knots[timed_knot + 1] <= t + _SOON:
                timed_knot += 1
            if t >= decisions * plant.valve_period - _SOON:
                decisions += 1
                for i in range(axles):
                    slipping = v - w[i] if v > plant.valve_slowest else 0.0
                    valve[i] = APPLY
                    if slipping > plant.hold_slip * v:
                        valve[i] = HOLD
                    if slipping > plant.vent_slip * v and w[i] <= before[i]:
                        valve[i] = VENT
                    before[i] = w[i]
            span = demand_t[segment + 1] - demand_t[segment]
            rise = (demand_p[segment + 1] - demand_p[segment]) / span
            c0 = demand_p[segment] + rise * (t - demand_t[segment])
            for i in range(axles):
                if valve[i] == APPLY:
                    p[i] = _filled(p[i], c0, c0, 0.0, max(plant.fill_time, plant.vent_time), plant.fill_rate, plant.vent_rate)
            if first:
                first = False
                speed[k], distance[k] = v, x
                for i in range(axles):
                    z = t if track.timed else x - plant.positions[i]
                    rail, knot[i] = _rail_at(track, z, knot[i], plant.cleaning[i])
                    pressure[k, i], wheel_speed[k, i] = p[i], w[i] / plant.radius[i]
                    if v > 0.0:
                        force[k, i] = creep_force(v - w[i], v, rail, plant.patch)[0]
            stop = min(end, demand_t[segment + 1])
            if decisions * plant.valve_period < stop:
                stop = decisions * plant.valve_period
            if track.timed and track.knots[timed_knot + 1] < stop:
                stop = track.knots[timed_knot + 1]
            h = stop - t
            v_old, v_from, v_new = v, v, v
            for i in range(axles):
                w_from[i], w_new[i] = w[i], w[i]
            braked = 0.0
            for stage in range(2):
                part = GAMMA if stage == 0 else 1.0
                c1 = c0 + rise * part * h
                x_new = x + part * h * v_new
                braked = 0.0
                for i in range(axles):
                    p1 = p[i]
                    if valve[i] == VENT:
                        p1 = _filled(p[i], 0.0, 0.0, part * h, plant.valve_time, math.inf, math.inf)
                    elif valve[i] == APPLY:
                        lag = plant.fill_time if c1 > p[i] else plant.vent_time
                        p1 = _filled(p[i], c0, c1, part * h, lag, plant.fill_rate, plant.vent_rate)
                    K = max(plant.line.per_pascal * p1 - plant.line.at_zero, 0.0)  # (15)
                    friction[i] = plant.phi * K
                    braked += friction[i]
                    if stage == 1:
                        p[i] = p1
                    z = t + part * h if track.timed else x_new - plant.positions[i]
                    rails[i], knot[i] = _rail_at(track, z, knot[i], plant.cleaning[i])
                if v_old > 0.0:
                    v_new = _stage(plant, rails, friction, GAMMA * h, v_from, w_from, v_new, w_new, work)
                    if math.isnan(v_new):
                        return t
                if stage == 0:  # both stages share f of the first
                    v_from = v + (1.0 - GAMMA) / GAMMA * (v_new - v)
                    for i in range(axles):
                        w_from[i] = w[i] + (1.0 - GAMMA) / GAMMA * (w_new[i] - w[i])
            if v_new < STANDSTILL and braked > 0.0:
                v_new = 0.0
                for i in range(axles):
                    w_new[i] = 0.0
            x += 0.5 * h * (v_old + v_new)
            v, t = v_new, stop
            for i in range(axles):
                w[i] = w_new[i]
    return math.nan


@dataclass(frozen=True)
class Simulation:
    """What was true: columns on one dense time axis, SI; shape (n,) or (n, axles)."""

    scenario: Scenario
    seed: int
    t: Times
    pressure: Floats  # brake cylinders [Pa]
    clamping_force: Floats  # K [N]
    wheel_speed: Floats  # ω [rad/s]
    adhesion_force: Floats  # F [N]
    train_speed: Floats  # v [m/s]
    distance: Floats  # run by the first axle [m]

    @cached_property
    def friction_force(self) -> Floats:
        """B [N]: φK while the wheel turns, what holds it (F) while it stands; ω̇ = a(F − B)."""
        phi = self.scenario.vehicle.friction.value
        return np.where(self.wheel_speed > 0.0, phi * self.clamping_force, self.adhesion_force)

    @cached_property
    def slip(self) -> Floats:
        """S [-], NaN below `rail.SLOWEST`."""
        vehicle, axles = self.scenario.vehicle, self.scenario.train.axles
        radius = np.array([vehicle.radius(axle).value for axle in range(1, axles + 1)])
        return physics.slip(self.train_speed[:, None], self.wheel_speed * radius, 1.0, SLOWEST)


def run(scenario: Scenario, seed: int | None = None, dt: float | None = None) -> Simulation:
    """The true signals of a scenario.

    Args:
        scenario: from `load`.
        seed: of the sensor noise, in place of the scenario's.
        dt: step of integration and output [s], in place of the scenario's.

    Raises:
        UserError: where the step is too long for the scenario.
    """
    from . import compiled

    dt = scenario.dt if dt is None else dt
    n = round(scenario.duration / dt) + 1
    shape = (n, scenario.train.axles)
    pressure, wheel_speed, force = np.zeros(shape), np.zeros(shape), np.zeros(shape)
    speed, distance = np.zeros(n), np.zeros(n)
    if scenario.rig:
        K = _swept(scenario, dt, wheel_speed, force, speed, distance)
        line = _line(scenario.vehicle)
        pressure[:] = np.where(K > 0.0, (K + line.at_zero) / line.per_pascal, 0.0)
    else:
        failed = compiled.function(_integrate)(
            _plant(scenario), _track(scenario.rail), *_demand(scenario), scenario.train.speed, dt,
            pressure, wheel_speed, force, speed, distance,
        )  # fmt: skip
        if not math.isnan(failed):
            raise UserError(f"{scenario.name}: no solution at {failed:g} s", "a shorter dt")
        K = physics.clamping_force(pressure, scenario.vehicle)
    t = np.round(np.arange(n) * (dt * 1e9)).astype(np.int64)
    seed = scenario.seed if seed is None else seed
    return Simulation(scenario, seed, t, pressure, K, wheel_speed, force, speed, distance)


def _swept(
    s: Scenario, dt: float, wheel_speed: Floats, force: Floats, speed: Floats, distance: Floats
) -> Floats:
    """Fills the columns of a roller rig; returns the K [N] that (1) asks for, shape (n, 1)."""
    assert s.rig is not None
    plant, track, n = _plant(s), _track(s.rail), len(speed)
    rate = s.rig.slip / ((n - 1) * dt)
    speed[:] = s.train.speed
    distance[:] = s.train.speed * dt * np.arange(n)
    j = 0
    for k in range(n):
        z = k * dt if track.timed else distance[k]
        rail, j = _rail_at(track, z, j, plant.cleaning[0])
        sliding = rate * k * dt * s.train.speed
        wheel_speed[k, 0] = (s.train.speed - sliding) / plant.radius[0]
        force[k, 0] = creep_force(sliding, s.train.speed, rail, plant.patch)[0]
    slowing = rate * s.train.speed / plant.radius[0]  # −ω̇
    return (force + slowing / (plant.a * plant.radius[0])) / plant.phi  # (1)


# --- sensors ------------------------------------------------------------------------------------

_DIMENSIONS: dict[Signal, tuple[Dimension | None, ...]] = {
    "pressure": ("pressure",),
    "clamping_force": ("force",),
    "wheel_speed": ("angular speed", "speed", "count"),
    "train_speed": ("speed",),
    "truth": ("force",),
    "slip": (None,),
}
_USUAL_UNITS = ("bar", "kPa", "Pa", "N", "kN", "rad/s", "rpm", "km/h", "m/s", "count", "")
_NAMES: dict[Signal, str] = {
    "pressure": "bc_pressure",
    "clamping_force": "clamping_force",
    "wheel_speed": "wheel_speed",
    "train_speed": "train_speed",
    "truth": "adhesion_force_true",
    "slip": "slip_true",
}


@dataclass(frozen=True, slots=True)
class Recording:
    """One channel as a logger would hold it: in its unit, with its own time stamps."""

    name: str
    signal: Signal
    axle: int | None
    unit: str
    t: Times  # [ns], rising strictly, shape (n,)
    value: Floats  # shape (n,); NaN where the signal does not exist
    decimals: int | None  # that the rounding leaves; None: not rounded

    def texts(self) -> list[str]:
        """Values as a log would print them; "" where there is none."""
        form = ".6g" if self.decimals is None else f".{self.decimals}f"
        return ["" if math.isnan(x) else format(x + 0.0, form) for x in self.value.tolist()]


def log(simulation: Simulation) -> list[Recording]:
    """What the scenario's sensors make of a simulation, the same for the same seed."""
    scenario, axles = simulation.scenario, simulation.scenario.train.axles
    recordings = []
    for number, sensor in enumerate(scenario.sensor):
        of = sensor.axles or tuple(range(1, axles + 1))
        for axle in (None,) if sensor.signal == "train_speed" else of:
            key = np.random.SeedSequence(simulation.seed, spawn_key=(number, axle or 0))
            random = np.random.Generator(np.random.PCG64(key))
            recordings.append(_recorded(simulation, sensor, axle, random))
    return recordings


def _recorded(
    simulation: Simulation, sensor: Sensor, axle: int | None, random: np.random.Generator
) -> Recording:
    scenario = simulation.scenario
    true = _true(simulation, sensor.signal, axle)
    dense = simulation.t * 1e-9
    at = np.arange(int(scenario.duration * sensor.rate * (1.0 + 1e-12)) + 1) / sensor.rate
    unit = UNITS.get(sensor.unit.lower())
    radius = scenario.vehicle.radius(axle or 1).value / (1.0 + sensor.diameter_error)
    if sensor.teeth:
        angle = np.concatenate(([0.0], np.cumsum((true[1:] + true[:-1]) * np.diff(dense) / 2.0)))
        turns = np.interp(at, dense, angle) / (2.0 * math.pi) + random.random()
        value = np.floor(turns * sensor.teeth)
        if sensor.unit != "count":
            at = at[1:]
            value = np.diff(value) * (2.0 * math.pi * sensor.rate / sensor.teeth)
    else:
        value = np.interp(at, dense, true) + sensor.offset
        noise = math.sqrt(sensor.noise_variance) * random.standard_normal(len(at))
        if sensor.signal in ("wheel_speed", "train_speed"):
            noise[value == sensor.offset] = 0.0  # what stands gives no noisy speed
        value += noise
    if unit:
        if sensor.signal == "wheel_speed" and unit.dimension == "speed":
            value = value * radius
        value = (value - unit.offset) / unit.factor
    decimals = None
    if sensor.resolution:
        value = np.round(value / sensor.resolution) * sensor.resolution
        decimals = max(0, -int(Decimal(repr(sensor.resolution)).normalize().as_tuple().exponent))
        value = np.round(value, decimals)
    stamp = at + sensor.delay + random.uniform(-sensor.jitter, sensor.jitter, len(at))
    kept = random.random(len(at)) >= sensor.loss
    for start, end in sensor.gaps:
        kept &= (stamp < start) | (stamp > end)
    name = _NAMES[sensor.signal]
    if axle is not None and scenario.train.axles > 1:
        name = f"{name}_{axle}"
    t = np.round(stamp * 1e9).astype(np.int64)
    return Recording(name, sensor.signal, axle, sensor.unit, t[kept], value[kept], decimals)


def _true(simulation: Simulation, signal: Signal, axle: int | None) -> Floats:
    """The dense true signal of one axle, SI, shape (n,)."""
    column: Floats = {
        "pressure": simulation.pressure,
        "clamping_force": simulation.clamping_force,
        "wheel_speed": simulation.wheel_speed,
        "train_speed": simulation.train_speed[:, None],
        "truth": simulation.adhesion_force,
        "slip": simulation.slip,
    }[signal]
    return column[:, (axle or 1) - 1]
