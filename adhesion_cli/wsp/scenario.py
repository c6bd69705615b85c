"""Scenarios of the simulator: the keys of their TOML, checked once; all SI."""

import inspect
import math
import types
import typing
from collections.abc import Iterator
from dataclasses import dataclass, field, is_dataclass, replace
from itertools import chain, pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple

from ..core import toml
from ..core.errors import UserError, unknown
from ..core.model import Parameter, Quantity, Vehicle
from ..core.physics import has_fade
from ..core.toml import Table
from ..core.units import UNITS, Dimension
from ..rail.creep_law import Condition, Contact, condition

INF = math.inf

Signal = Literal["pressure", "clamping_force", "wheel_speed", "train_speed", "truth", "slip"]

_NAME_HINT = "name a scenario TOML, or one of the bundled scenarios"
_BUNDLED = Path(__file__).parent / "scenarios"
_UNITS: dict[Signal, tuple[tuple[Dimension, ...], str]] = {
    "pressure": (("pressure",), "bar, kPa, Pa"),
    "clamping_force": (("force",), "N, kN"),
    "wheel_speed": (("speed", "angular speed", "count"), "km/h, m/s, rad/s, rpm, count"),
    "train_speed": (("speed", "acceleration"), "km/h, m/s; m/s2 of an accelerometer"),
    "truth": (("force",), "N, kN"),
    "slip": ((), "none"),
}


@dataclass(frozen=True, slots=True)
class ScenarioTrain:
    """The train at the start, and where its axles run."""

    speed: Annotated[float, Quantity("m/s", "speed at the start", 0.0, 150.0)] = 20.0
    axles: Annotated[int, Quantity("-", "braked wheelsets under the car body", 1, 64)] = 1
    positions: Annotated[
        tuple[float, ...], Quantity("m", "distance of each axle behind the first", 0.0, 1000.0)
    ] = ()
    cleaning: Annotated[
        tuple[float, ...],
        Quantity("-", "f0 under each axle over that of the rail: wheels clean it", 1e-3, 20.0),
    ] = ()


@dataclass(frozen=True, slots=True)
class Command:
    """One change of the brake demand: a step, or a ramp from the demand before."""

    at: Annotated[float, Quantity("s", "when the change starts")]
    pressure: Annotated[float | None, Quantity("Pa", "cylinder pressure", 0.0, 2e6)] = None
    clamping_force: Annotated[
        float | None, Quantity("N", "clamping force K, instead of a pressure", 0.0, 1e6)
    ] = None
    ramp: Annotated[float, Quantity("s", "duration of the change")] = 0.0


@dataclass(frozen=True, slots=True)
class ScenarioBrake:
    """Brake demand and how the cylinder follows it: later, with a lag, no faster than its rate."""

    command: tuple[Command, ...] = ()
    dead_time: Annotated[float, Quantity("s", "from demand to first flow", 0.0, 10.0)] = 0.0
    fill_time: Annotated[float, Quantity("s", "time constant of filling", 0.0, 20.0)] = 0.0
    vent_time: Annotated[float, Quantity("s", "time constant of venting", 0.0, 20.0)] = 0.0
    fill_rate: Annotated[float, Quantity("Pa/s", "fastest filling")] = INF
    vent_rate: Annotated[float, Quantity("Pa/s", "fastest venting")] = INF


@dataclass(frozen=True, slots=True)
class Section:
    """The rail from a place (or time) on."""

    at: Annotated[float, Quantity("m or s", "where the section starts")]
    condition: Condition | str
    scale: Annotated[float, Quantity("-", "factor on f0", 1e-3, 20.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Film:
    """Equal patches on top of the sections, as leaves leave them."""

    condition: Condition | str
    first: Annotated[float, Quantity("m or s", "where the first patch starts")]
    length: Annotated[float, Quantity("m or s", "length of a patch")]
    pitch: Annotated[float, Quantity("m or s", "from patch to patch")]
    count: Annotated[int, Quantity("-", "number of patches", 1, 10000)] = 1
    scale: Annotated[float, Quantity("-", "factor on f0", 1e-3, 20.0)] = 1.0


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

    def changes(self) -> list[tuple[float, Condition | str, float]]:
        """(place, condition, factor on f0) of every change, film laid over the sections."""
        base = [(x.at, x.condition, x.scale) for x in self.section]
        if self.film is None:
            return base
        film = self.film
        starts = [film.first + k * film.pitch for k in range(film.count)]
        spans = [(start, start + film.length) for start in starts]
        stretches = [x for x in base if not any(a <= x[0] <= b for a, b in spans)]
        for start, stop in spans:
            *_, section = (x for x in base if x[0] <= stop)
            stretches += [(start, film.condition, film.scale), (stop, *section[1:])]
        return sorted(stretches, key=lambda x: x[0])


class Wsp(NamedTuple):
    """A simple wheel slide protection that knows the true slip; real ones do better."""

    hold_slip: Annotated[float, Quantity("-", "slip that stops applying", 0.0, 1.0)] = 0.08
    vent_slip: Annotated[float, Quantity("-", "slip that dumps air", 0.0, 1.0)] = 0.15
    vent_time: Annotated[float, Quantity("s", "time constant of its dump valve", 0.0, 5.0)] = 0.15
    period: Annotated[float, Quantity("s", "time between decisions", 1e-4, 1.0)] = 0.02
    slowest: Annotated[float, Quantity("m/s", "off below this train speed", 0.0, 20.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Antiskid:
    """Sensors and valves of a WSP controller; ours, illustrative."""

    # Measured, as by a radar, or estimated from the axles (`reference_speed`).
    train_speed: Literal["measured", "axles"] = "measured"
    period: Annotated[float, Quantity("s", "time between decisions", 1e-3, 0.1)] = 0.01
    delay: Annotated[float, Quantity("s", "age of what the sensors say", 0.0, 1.0)] = 0.01
    wheel_noise: Annotated[float, Quantity("rad²/s²", "variance of wheel speed")] = 1e-5
    pressure_noise: Annotated[float, Quantity("Pa²", "variance of cylinder pressure")] = 1e6
    train_noise: Annotated[float, Quantity("m²/s²", "variance of train speed")] = 4e-4
    dead_time: Annotated[float, Quantity("s", "from command to flow", 0.0, 1.0)] = 0.02
    vent_time: Annotated[float, Quantity("s", "time constant of venting", 1e-3, 5.0)] = 0.25
    fill_rate: Annotated[float, Quantity("Pa/s", "fastest filling", 1e3, 1e8)] = 3e5
    volume: Annotated[float, Quantity("m³", "cylinders and pipes of an axle", 1e-6, 1.0)] = 2e-3
    friction: Annotated[float, Quantity("-", "φ as the unit takes it, over the true", 0.5, 2.0)] = (
        1.0
    )
    radius: Annotated[
        tuple[float, ...], Quantity("-", "wheel radius, likewise, one or one per axle", 0.9, 1.1)
    ] = (1.0,)
    mass: Annotated[float, Quantity("-", "axle mass, likewise", 0.5, 2.0)] = 1.0


@dataclass(frozen=True, slots=True)
class Rig:
    """A roller rig: constant speed, slip rising evenly from 0, the brake is whatever holds it."""

    slip: Annotated[float, Quantity("-", "slip at the end of the sweep", 0.0, 0.99)]


@dataclass(frozen=True, slots=True)
class Sensor:
    """One kind of channel of the log, on one or all axles; numbers in SI but `resolution`."""

    signal: Signal
    unit: str = ""
    rate: Annotated[float, Quantity("Hz", "samples per second", 1e-3, 1e5)] = 100.0
    axles: Annotated[tuple[int, ...], Quantity("-", "axles that have it; empty: all", 1, 64)] = ()
    noise_variance: Annotated[float, Quantity("SI²", "variance of each sample's noise")] = 0.0
    resolution: Annotated[float, Quantity("log's unit", "step the value is rounded to")] = 0.0
    offset: Annotated[float, Quantity("SI", "added to the true value", -INF)] = 0.0
    delay: Annotated[float, Quantity("s", "how late the time stamp is", 0.0, 10.0)] = 0.0
    jitter: Annotated[
        float, Quantity("s", "largest error of the time stamp, evenly distributed", 0.0, 10.0)
    ] = 0.0
    loss: Annotated[float, Quantity("-", "share of samples that never arrive", 0.0, 0.99)] = 0.0
    gaps: Annotated[
        tuple[tuple[float, float], ...], Quantity("s", "[start, end] of drop-outs")
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
    """Everything a simulation depends on."""

    name: str
    description: str
    duration: Annotated[float, Quantity("s", "simulated time", 1e-3, 1e6)]
    rail: Rail
    sensor: tuple[Sensor, ...] = ()
    train: ScenarioTrain = field(default_factory=ScenarioTrain)
    brake: ScenarioBrake = field(default_factory=ScenarioBrake)
    vehicle: Vehicle = field(default_factory=Vehicle)
    contact: Contact = field(default_factory=Contact)
    wsp: Wsp | None = None
    antiskid: Antiskid = field(default_factory=Antiskid)  # of `adhesion antiskid`, not the log's
    rig: Rig | None = None
    dt: Annotated[float, Quantity("s", "step of integration and dense output", 1e-6, 0.02)] = 1e-3
    seed: Annotated[int, Quantity("-", "seed of the sensor noise", 0)] = 0

    def with_train_speed(self, source: Literal["measured", "axles"] | None) -> "Scenario":
        """The same with another source of the WSP's train speed; None: with its own."""
        antiskid = replace(self.antiskid, train_speed=source or self.antiskid.train_speed)
        return replace(self, antiskid=antiskid)


def scenarios() -> dict[str, str]:
    """The bundled scenarios: name and one line on each."""
    paths = sorted(_BUNDLED.glob("*.toml"))
    return {path.stem: toml.read(path, _NAME_HINT)["description"] for path in paths}


def load(name_or_path: str | Path) -> Scenario:
    """A bundled scenario by name, or one from a TOML file.

    Raises:
        UserError: no such scenario, unreadable TOML, unknown key, value of a wrong type or out of
            range, parts that contradict each other.
    """
    path = Path(name_or_path)
    if path.suffix != ".toml":
        path = _BUNDLED / f"{name_or_path}.toml"
        if not path.exists():
            raise unknown("scenario", str(name_or_path), list(scenarios()))
    s: Scenario = _table(Scenario, {"name": path.stem, **toml.read(path, _NAME_HINT)}, path.name)
    for is_invalid, text, hint in chain(_of_train(s), _of_rail(s), _of_sensors(s)):
        if is_invalid:
            raise UserError(f"{path.name}: {text}", hint, code=2)
    return s


def _table(kind: Any, table: Table, place: str) -> Any:
    hints = typing.get_type_hints(kind, include_extras=True)
    for key in table:
        if key not in hints:
            raise unknown(f"key in {place}:", key, list(hints))
    for name, p in inspect.signature(kind).parameters.items():
        if p.default is p.empty and name not in table:
            raise UserError(f"{place}: {name} is missing", f"add {name} = …", code=2)
    return kind(**{key: _value(hints[key], v, f"{place}: {key}") for key, v in table.items()})


def _value(kind: Any, value: Any, place: str, quantity: Quantity | None = None) -> Any:
    """`value` from a TOML as the annotated type `kind`, checked."""
    origin, args = typing.get_origin(kind), typing.get_args(kind)
    if origin is Annotated:
        return _value(args[0], value, place, args[1])
    if origin is types.UnionType:  # T | None, and TOML has no None; or a table | its name
        named = args[-1] is str and not isinstance(value, dict)
        return _value(args[-1 if named else 0], value, place, quantity)
    if origin is Literal:
        if value not in args:
            raise unknown(f"value of {place}:", str(value), list(args))
        return value
    if origin is tuple:
        items = value if isinstance(value, list) else [value]
        inner = args[:1] * len(items) if args[-1] is Ellipsis else args
        if len(inner) == len(items):
            return tuple(_value(k, v, place, quantity) for k, v in zip(inner, items, strict=True))
    return _single(kind, value, place, quantity)


def _single(kind: Any, value: Any, place: str, quantity: Quantity | None) -> Any:
    """A table, a vehicle parameter, a text or a number."""
    if is_dataclass(kind) or kind in (Condition, Wsp):
        if isinstance(value, dict):
            return _table(kind, value, place)
    elif kind is Parameter:  # of the vehicle; a simulation has no tolerances
        return Parameter(_value(float, value, place, quantity), 0.0)
    elif kind is str:
        if isinstance(value, str):
            return value
    elif kind in (int, float) and isinstance(value, (int, kind)) and not isinstance(value, bool):
        assert quantity is not None
        return kind(quantity.check(place, value))
    wanted = {str: "a text", int: "a whole number", float: "a number", Parameter: "a number"}
    text = wanted.get(kind, "a table, or a list of that length")
    raise UserError(f"{place} = {value!r} is not {text}", "see the bundled scenarios", code=2)


_Checks = Iterator[tuple[object, str, str]]  # true where it is wrong; what is, and the remedy


def _of_train(s: Scenario) -> _Checks:
    n = s.train.axles
    for key, values, minimum in (
        ("[train] positions", s.train.positions, 0),
        ("[train] cleaning", s.train.cleaning, 0),
        ("[vehicle] wheel_radius", s.vehicle.wheel_radius, 1),
        ("[antiskid] radius", s.antiskid.radius, 1),
    ):
        hint = f"{n} values, or {'one' if minimum else 'none'}"
        yield len(values) not in (minimum, n), f"{key} is not one per axle", hint
    yield s.vehicle.axles != (), "[vehicle] a simulated train has equal axles", "leave out axles"
    brake = has_fade(s.vehicle) or s.vehicle.correlation != ()
    yield brake, "[vehicle] a simulated brake has one friction", "leave out what `calibrate` adds"
    yield s.rig and n != 1, "[rig] tests one axle", "leave [train] axles at 1"
    command_end = 0.0
    for c in s.brake.command:
        name, neither = f"brake command at {c.at:g} s", c.pressure is None
        yield neither == (c.clamping_force is None), name, "one of pressure and clamping_force"
        yield c.at < command_end, f"{name} comes before the last has ended", "order them"
        command_end = c.at + c.ramp


def _of_rail(s: Scenario) -> _Checks:
    first_section = s.rail.section[:1]
    is_invalid = not first_section or first_section[0].at != 0.0
    yield is_invalid, "[[rail.section]] the first does not start at 0", "at = 0.0"
    changes = s.rail.changes()
    for _, name, _ in changes:
        condition(name)
    too_close = any(b[0] - a[0] < s.rail.blend for a, b in pairwise(changes))
    yield too_close, "[rail] sections or film closer than blend", "order them, or shorten blend"


def _of_sensors(s: Scenario) -> _Checks:
    for x in s.sensor:
        name, (dimensions, usual) = f"[[sensor]] {x.signal}", _UNITS[x.signal]
        unit = UNITS.get(x.unit.lower())
        is_invalid = unit.dimension not in dimensions if unit else x.unit or dimensions
        yield is_invalid, f"{name}: unit {x.unit!r} does not fit", f"such as {usual}"
        is_invalid = x.teeth > 0 if x.signal != "wheel_speed" else x.unit == "count" and not x.teeth
        yield is_invalid, f"{name}: pulses need a wheel with teeth", "teeth = 100"
        hint = "less than half of 1/rate"
        yield x.jitter >= 0.5 / x.rate, f"{name}: jitter reaches the next sample", hint
        unknown_axle = any(axle > s.train.axles for axle in x.axles)
        yield unknown_axle, f"{name}: no such axle", f"1 to {s.train.axles}"
