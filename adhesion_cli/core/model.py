"""The data model: channels, logs, axle records, vehicles, results.

Data only, SI only. Times are int64 nanoseconds as the log states them: since 1970 where the log
has a calendar (`Log.absolute`), since an unknown start otherwise.
"""

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_type_hints

import numpy as np
from numpy.typing import NDArray

from .errors import UserError
from .finding import Finding, Severity

Floats = NDArray[np.float64]
Times = NDArray[np.int64]
Bools = NDArray[np.bool_]
Regions = NDArray[np.int8]
Number = float | None  # None: not known

Z95 = 1.959963984540054  # coverage factor of 95 % for a normal distribution

NOT_MEASURED = "made"  # in the provenance of a result: the train speed was not measured
AS_INPUT = "input"  # there: one channel for all axles, which every axle's input holds as it was
RECOVERED = "adhesion.recovered"  # metadata of a file made from a damaged one: what was damaged

Meaning = Literal[
    "time",
    "pressure",
    "wheel_speed",
    "train_speed",
    "clamping_force",
    "truth",
    "true_slip",
    "ed_force",
    "traction_force",
    "brake_command",
    "emergency",
    "brake_pipe",
    "vent_valve",
    "hold_valve",
    "wsp_active",
    "sanding",
    "magnetic_brake",
    "retarder",
    "load_pressure",
    "reservoir_pressure",
    "distance",
    "position",
    "latitude",
    "longitude",
    "gradient",
    "temperature",
]

# Brakes of which it is known only whether they act.
OTHER_BRAKES: tuple[Meaning, Meaning] = ("magnetic_brake", "retarder")
MOTOR_FORCES: tuple[Meaning, Meaning] = ("ed_force", "traction_force")
_MEASURED: tuple[Meaning, ...] = ("pressure", "clamping_force", "wheel_speed", "train_speed")
# What an analysis takes; channels of another meaning are only named.
INPUTS: frozenset[Meaning | None] = frozenset(
    (*_MEASURED, "truth", "true_slip", *MOTOR_FORCES, *OTHER_BRAKES)
)
MOTOR_TOLERANCE = 0.05  # 1 sigma of a force that a converter calculates from its currents, a share
# States, 0 or 1 mostly: they need no unit. Stops, report and viewer show them.
STATES: tuple[Meaning, ...] = (
    "brake_command",
    "emergency",
    "vent_valve",
    "hold_valve",
    "wsp_active",
    "sanding",
)
# Where the train was; read as well, where the log has them.
PLACES: tuple[Meaning, ...] = ("position", "distance", "latitude", "longitude")


@dataclass(frozen=True, slots=True)
class Quantity:
    """Unit, range and meaning of a number, for `Annotated`."""

    unit: str
    text: str
    minimum: float = 0.0
    maximum: float = float("inf")
    symbol: str = ""  # the papers' letter, spelled out: another name users may write
    optional: bool = False  # NaN says that it is not known

    @property
    def range(self) -> str:
        """The values allowed, with their unit."""
        unit = "" if self.unit == "-" else f" {self.unit}"
        if self.maximum == float("inf"):
            return f"from {self.minimum:g}{unit}"
        return f"{self.minimum:g} to {self.maximum:g}{unit}"

    def check(self, name: str, value: float) -> float:
        """The value, if it is in the range; else, and for NaN, a UserError with name and range."""
        if not self.minimum <= value <= self.maximum:
            raise UserError(f"{name} = {value:g} is out of range", f"{self.text}: {self.range}", 2)
        return value


def fraction(text: str) -> Quantity:
    """A share, from 0 to 1."""
    return Quantity("-", text, 0.0, 1.0)


NOT_IN_JSON: Mapping[str, bool] = {"in_json": False}  # metadata of a field for programs only


def quantities(annotated: type) -> dict[str, Quantity]:
    """The `Quantity` of each annotated field."""
    hints = get_type_hints(annotated, include_extras=True)
    return {
        name: q
        for name, hint in hints.items()
        for q in get_args(hint)[1:]
        if isinstance(q, Quantity)
    }


@dataclass(frozen=True, slots=True)
class Column:
    """One scalar series: time stamps [ns], values, and which of them may be used; shape (n,).

    A column of words has the number of each cell's word in `words`.
    """

    t: Times
    value: Floats
    valid: Bools
    words: tuple[str, ...] = ()


def pieces(starts: tuple[int, ...], n: int) -> tuple[slice, ...]:
    """The stretches of n samples that start so; none where there is no sample."""
    stops = (*starts[1:], n)
    return tuple(slice(a, b) for a, b in zip(starts, stops, strict=True)) if n else ()


class Parameter(NamedTuple):
    """A vehicle parameter: value and 1-sigma tolerance, both SI."""

    value: float
    tolerance: float

    @property
    def share(self) -> float:
        """The tolerance over the value; 0 of a value of 0."""
        return self.tolerance / self.value if self.value else 0.0


@dataclass(frozen=True, slots=True)
class Channel:
    """One scalar series of a log with its meaning, in SI, and the reason for that meaning."""

    name: str  # topic or column header, as in the log
    field: str  # place inside a message, "" in a CSV
    meaning: Meaning | None
    axle: int | None
    unit: str  # unit in the log; `data` is SI
    reason: str
    data: Column
    rows: int = 0  # samples in the log; `data` holds those that may be used
    starts: tuple[int, ...] = (0,)  # first index of each piece; the clock was set back between two
    gap_ns: int = 0  # a longer interval between samples is a gap
    step: float = 0.0  # quantisation step, SI; 0 where none shows
    rate_hz: float | None = None
    gaps: int = 0
    duplicates: int = 0
    backward: int = 0
    row_of: tuple[str, str] = ("", "")  # topic or signal, and device; one for channels of one row
    is_rate: bool = False  # `data` is the rate of what it means [SI/s]: a train's acceleration
    label: str = ""  # a name that the log gives to an element of a list
    period_step: float = 0.0  # of 1/speed, where a timer counts whole ticks from pulse to pulse
    first_unit: str = ""  # of a result: the unit in the log that it was made of, where it matters
    zero: Parameter = Parameter(0.0, 0.0)  # of a pressure's sensor, taken off `data` [Pa]
    delay: Parameter | None = None  # of a train speed, as stated [s]
    tolerance: float = 0.0  # 1 sigma of an ED or traction force, as a share
    levels: tuple[str, ...] = ()  # of a state in words: the word of 0, of 1, ...
    # samples of `data` that its recorder did not write, as the value held [ns]
    held: Times = dataclasses.field(default_factory=lambda: np.empty(0, np.int64), repr=False)

    @property
    def pieces(self) -> tuple[slice, ...]:
        """The stretches of its samples between two jumps of the clock; none without a sample."""
        return pieces(self.starts, len(self.data.t))

    @property
    def measured_in(self) -> str:
        """Unit in which it was logged first: it shows what the sensor measures."""
        return self.first_unit or self.unit

    @property
    def coarsest(self) -> float:
        """The largest quantisation step of any value, SI."""
        return max(self.step, self.period_step * float(np.max(self.data.value, initial=0.0)) ** 2)

    @property
    def title(self) -> str:
        """Name and field, for people."""
        return f"{self.name} {self.field}".strip()


@dataclass(frozen=True, slots=True)
class Log:
    """A log as read: its channels and everything that was found on the way."""

    path: str
    format: str
    sha256: str
    absolute: bool  # times count from 1970
    rows_read: int
    channels: tuple[Channel, ...]
    findings: tuple[Finding, ...]
    account: str = ""  # losses of the MCAP, see RECOVERED
    # by key in [channels] the option that takes a channel without a meaning for what is missing
    proposals: Mapping[str, str] = field(default_factory=dict)

    def find(self, meaning: Meaning, axle: int) -> Channel | None:
        """The axle's channel, else the one without an axle: a train may have one pressure."""
        candidates = [c for c in self.channels if c.meaning == meaning and len(c.data.t)]
        return next((c for wanted in (axle, None) for c in candidates if c.axle == wanted), None)

    def start_ns(self) -> int:
        """First time stamp of any channel that an analysis takes, else of any channel [ns]."""
        channels = [c for c in self.channels if c.meaning in INPUTS] or list(self.channels)
        return min((int(c.data.t.min()) for c in channels if len(c.data.t)), default=0)


class FrictionTable(NamedTuple):
    """φ over the speed and, where it depends on that, over the clamping force.

    Between its points φ is a straight line of both; beyond them it stays as at the last one.
    """

    speed: tuple[float, ...]  # of the wheel's rim, rising [m/s]
    clamping_force: tuple[float, ...]  # K of an axle, rising [N]; empty: φ is the same for all
    value: tuple[tuple[float, ...], ...]  # φ, a row for each K, in it a number for each speed

    @property
    def reference(self) -> float:
        """φ in the middle of the table: a vehicle's `friction` as stated."""
        row = self.value[len(self.value) // 2]
        return row[len(row) // 2]

    @property
    def middle(self) -> tuple[float, float]:
        """The speed [m/s] and clamping force [N] of `reference`; 0 where φ does not depend on K."""
        K = self.clamping_force
        return self.speed[len(self.speed) // 2], K[len(K) // 2] if K else 0.0

    def at(self, rim: Any, K: Any) -> Any:
        """φ at rim speeds [m/s] and clamping forces of an axle [N]; numbers or shape (n,)."""
        if not self.clamping_force:
            return np.interp(rim, self.speed, self.value[0])
        place = np.interp(K, self.clamping_force, np.arange(len(self.value)))
        return sum(
            np.clip(1.0 - np.abs(place - i), 0.0, 1.0) * np.interp(rim, self.speed, row)
            for i, row in enumerate(self.value)
        )

    def scaled(self, factors: Iterable[float]) -> "FrictionTable":
        """The table with each speed's column times a factor."""
        columns = tuple(factors)
        rows = (tuple(x * f for x, f in zip(row, columns, strict=True)) for row in self.value)
        return self._replace(value=tuple(rows))


def without_motors(K: Floats, motor_clamping: Floats | None) -> Floats:
    """K without the motors' part, never below zero, (n,) [N]."""
    if motor_clamping is None:
        return K
    friction = K - motor_clamping
    rounding = 1e-9 * np.maximum(np.abs(K), np.abs(motor_clamping))
    return np.where(friction > rounding, friction, 0.0)


def columns_at(x: Any, rows: slice | NDArray[np.int64] | Bools) -> dict[str, Any]:
    """The columns of a dataclass at some rows, by name."""
    columns = ((f.name, getattr(x, f.name)) for f in fields(x))
    return {name: column[rows] for name, column in columns if isinstance(column, np.ndarray)}


class SpeedsAlone(NamedTuple):
    """The speeds of an axle and its train where the brake is not known, (n,) each."""

    t: Times
    wheel_speed: Floats  # [rad/s]
    train_speed: Floats  # NaN where not known [m/s]


@dataclass(frozen=True, slots=True)
class AxleRecord:
    """One axle on one time axis, the wheel speed's; columns of shape (n,), SI.

    Within a segment t rises strictly and every used value is finite; nothing may cross from one
    segment to the next.
    """

    axle: int
    t: Times
    clamping_force: Floats  # K of the last sample: what an online estimator may see
    clamping_force_smooth: Floats  # K interpolated at t: for the offline reference only
    wheel_speed: Floats  # y
    segments: tuple[slice, ...]
    wheel_speed_step: float = 0.0  # quantisation step of y [rad/s]
    pressure: Floats | None = None
    train_speed: Floats | None = None  # NaN where not known
    truth: Floats | None = None  # true adhesion force [N], NaN where not known
    true_slip: Floats | None = None  # NaN where not known
    clamping_force_step: float = 0.0  # quantisation step of K [N]
    train_speed_interval: float = 0.0  # between the train speed's own samples [s]
    train_speed_step: float = 0.0  # quantisation step of the train speed [m/s]
    train_speed_sigma: Floats | None = None  # standard uncertainty, if it was integrated [m/s]
    # its delay, removed from the stamps [s]; None: not known
    train_speed_late: Parameter | None = None
    train_speed_made: bool = False  # estimated from the axles: wrong where all creep or slide
    pressure_late: Parameter = Parameter(0.0, 0.0)  # delay against the wheel speed, not removed [s]
    of_totals: bool = False  # the wheel speed was logged as a total of pulses or as an angle
    of_rim: bool = False  # the wheel speed was logged as ωR and divided by the vehicle's R
    saturated: Bools | None = None  # the pressure is at the end of its sensor's range
    pressure_zero: Parameter = Parameter(0.0, 0.0)  # was taken off the pressure [Pa]
    creepage_doubt: float = 0.0  # 1 sigma of its brake force, as a share: creepage contradicts it
    wheel_period_step: float = 0.0  # of 1/y, where y is from the period of pulses [s/rad]
    # the part of K that is the motors': their force at the rim over φ, traction below zero [N]
    motor_clamping: Floats | None = None  # of the last sample
    motor_clamping_smooth: Floats | None = None  # interpolated at t
    motor_sigma: Floats | None = None  # standard uncertainty of their force at the rim [N]
    traction_known: bool = False  # whether a motor that drives is in it, too
    speeds_alone: SpeedsAlone | None = None  # at times that are none of the record's

    def __len__(self) -> int:
        return len(self.t)

    @property
    def wheel_speed_steps(self) -> Floats:
        """Quantisation step of each y, shape (n,) [rad/s]."""
        return np.maximum(self.wheel_speed_step, self.wheel_period_step * self.wheel_speed**2)

    @property
    def friction_clamping(self) -> Floats:
        """K of the friction brake alone, of the last sample, (n,) [N]."""
        return without_motors(self.clamping_force, self.motor_clamping)

    @property
    def friction_clamping_smooth(self) -> Floats:
        """The same, interpolated at t, (n,) [N]."""
        return without_motors(self.clamping_force_smooth, self.motor_clamping_smooth)

    def extract(self, s: slice) -> "AxleRecord":
        """An uninterrupted part as a separate record."""
        return replace(self, segments=(slice(0, s.stop - s.start),), **columns_at(self, s))


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


class Wheelset(NamedTuple):
    """The constants of (1) for one axle, as the estimators take them.

    Plain floats, for numba.
    """

    a: float  # R / I [1/(kg m)]
    phi: float  # pad friction coefficient φ [-]
    rolling: float  # F / (φK) while rolling, 1 / (1 + I/(m R²)) [-]
    radius: float  # R [m]
    inertia: float  # I [kg m²]
    mass: float  # m [kg]


class Load(NamedTuple):
    """The mass of an axle by its load pressure: a straight line through two points."""

    pressure: tuple[float, float]  # rising [Pa]
    axle_mass: tuple[float, float]  # [kg]
    tolerance: float  # 1 sigma of the mass [kg]

    def mass(self, pressure: float) -> Parameter:
        """The mass of an axle at a pressure [Pa]."""
        (p0, p1), (m0, m1) = self.pressure, self.axle_mass
        return Parameter(m0 + (m1 - m0) * (pressure - p0) / (p1 - p0), self.tolerance)

    def reaches(self, pressure: float, beyond: float) -> bool:
        """Whether a pressure [Pa] is at most so far outside of the points, as a share of theirs."""
        low, high = self.pressure
        margin = beyond * (high - low)
        return low - margin <= pressure <= high + margin


@dataclass(frozen=True, slots=True)
class Vehicle:
    """The braked wheelset; defaults are the paper's vehicle, tolerances are standard uncertainties.

    The paper states no tolerances. The program's are: brake friction and return spring 10 %,
    inertia and mass 5 %, efficiency 3 %, radius 1 % (wear), dimensions 0.1 %.
    """

    wheel_radius: Annotated[
        tuple[Parameter, ...], Quantity("m", "wheel radius R, one or one per axle", 0.1, 1.0, "R")
    ] = (Parameter(0.42, 0.0042),)
    wheelset_inertia: Annotated[
        Parameter, Quantity("kg m²", "moment of inertia I of the wheelset", 1.0, 5000.0, "I")
    ] = Parameter(145.0, 7.25)
    axle_mass: Annotated[
        Parameter, Quantity("kg", "braked mass m per axle", 100.0, 50000.0, "m")
    ] = Parameter(4797.0, 239.85)
    friction: Annotated[
        Parameter, Quantity("-", "friction coefficient φ of pad or shoe", 0.01, 1.0, "phi")
    ] = Parameter(0.3, 0.03)
    discs: Annotated[
        Parameter,
        Quantity("-", "number n of clamping forces per axle: discs times pads", 0.05, 64.0, "n"),
    ] = Parameter(2.0, 0.0)
    efficiency: Annotated[
        Parameter, Quantity("-", "efficiency η of the caliper", 0.1, 1.0, "eta")
    ] = Parameter(0.97, 0.0291)
    lever_ratio: Annotated[
        Parameter, Quantity("-", "lever ratio i of the caliper", 0.05, 50.0, "i")
    ] = Parameter(1.0, 0.0)
    radius_ratio: Annotated[
        Parameter, Quantity("-", "friction radius over wheel radius", 0.05, 2.0)
    ] = Parameter(1.0, 0.0)
    cylinder_diameter: Annotated[
        Parameter, Quantity("m", "piston diameter d of the brake cylinder", 0.01, 1.0, "d")
    ] = Parameter(0.1295, 0.00013)
    spring_force: Annotated[
        Parameter,
        Quantity("N", "return spring force of the brake cylinder", 0.0, 50000.0, "F_spring"),
    ] = Parameter(1450.0, 145.0)
    friction_fade: Annotated[
        Parameter,
        Quantity("s/m", "share by which φ changes per m/s, from `calibrate`", -0.03, 0.03),
    ] = Parameter(0.0, 0.0)
    friction_speed: Annotated[
        Parameter, Quantity("m/s", "speed at which φ is `friction`", 0.0, 200.0)
    ] = Parameter(0.0, 0.0)
    friction_lag: Annotated[
        Parameter,
        Quantity("s", "by which pads may lag the pressure; behind valves usually 0.04", 0.0, 0.5),
    ] = Parameter(0.0, 0.0)
    correlation: tuple[tuple[str, str, float], ...] = ()  # of the errors of two parameters
    friction_table: FrictionTable | None = None  # `friction` is φ in its middle, and scales it
    load: Load | None = None  # shows the axle mass where the log has a load pressure
    # Where axles differ in more than the radius: each with its own values. The fields above are
    # then those of the mean axle, see `core.mean_axle`.
    axles: tuple["CarAxle", ...] = ()

    def of_axle(self, axle: int) -> "Vehicle":
        """The vehicle whose every axle is as this one, from 1; a UserError for one not stated."""
        if not self.axles:
            is_single = len(self.wheel_radius) == 1
            return self if is_single else replace(self, wheel_radius=(self.radius(axle),))
        for car_axle in self.axles:
            if car_axle.number == axle:
                return car_axle.vehicle
        last_axle = self.axles[-1]
        if last_axle.car:
            text = f"axle {axle} of the log is in no car"
            hint = f"add it to axles = [...] of its [car.NAME], such as [car.{last_axle.car}]"
        else:
            text = f"[vehicle] has lists for {last_axle.number} axles, the log has an axle {axle}"
            hint = "state one value for all axles, or lists with one for each"
        raise UserError(text, hint, code=2)

    def covariance(self, a_terms: Mapping[str, Any], b_terms: Mapping[str, Any]) -> Any:
        """Covariance of two quantities by the tolerances. Source: JCGM 100, 5.2.2.

        `a_terms` has, by a parameter's name, the tolerance times the sensitivity, numbers or
        arrays. `b_terms` has those of the other quantity; `a_terms` again gives the variance.
        """
        # In the order of the names: sums of floats in another order have other last bits.
        total = sum(
            (a_terms[name] * b_terms[name] for name in a_terms if name in b_terms), start=0.0
        )
        for a, b, share in self.correlation:
            for i, j in ((a, b), (b, a)):
                if i in a_terms and j in b_terms:
                    total = total + share * a_terms[i] * b_terms[j]
        return total

    def radius(self, axle: int) -> Parameter:
        """Wheel radius of an axle, numbered from 1; a UserError where only others are stated."""
        if self.axles:
            return self.of_axle(axle).wheel_radius[0]
        count = len(self.wheel_radius)
        if 1 < count < axle:
            option = f"--set vehicle.wheel_diameter={2.0 * self.wheel_radius[0].value:g}"
            raise UserError(
                f"vehicle.wheel_radius has {count} values, the log has an axle {axle}",
                f"state one for all axles, as {option} does, or a list with one for each",
                code=2,
            )
        return self.wheel_radius[axle - 1 if count > 1 else 0]


class CarAxle(NamedTuple):
    """An axle with its own values."""

    number: int  # in the train, from 1
    car: str  # name of its car, "" where lists per axle state it
    vehicle: Vehicle  # with one wheel radius


class Train(NamedTuple):
    """How the rest of the train brakes, which slows with the axles of the log."""

    alike: Annotated[
        float,
        Quantity("-", "1 sigma of the other axles' brake force per mass, as a share", 0.0, 10.0),
    ] = 0.05
    unbraked_mass: Annotated[
        float, Quantity("kg", "rolls along without a brake, beside the axles of the log", 0.0, 1e7)
    ] = 0.0

    def braked_share(self, vehicle: Vehicle, axles: int) -> float:
        """Share of the mass that the brakes of so many axles slow, which is braked itself."""
        braked_mass = axles * vehicle.axle_mass.value
        return braked_mass / (braked_mass + self.unbraked_mass)


class Track(NamedTuple):
    """The line that a log was made on."""

    gradient: Parameter = Parameter(0.0, 5e-4)  # uphill positive [-]
    stated: bool = False  # whether `gradient` has a stated value
    # place [m] from which each gradient [-] holds, along rising places
    profile: tuple[tuple[float, float], ...] = ()
    position: str = ""  # the channel of the place, "" by its meaning
    # by a pattern of the log's name, where logs were made on several lines
    gradients_of_logs: tuple[tuple[str, Parameter], ...] = ()


class DifferingStop(NamedTuple):
    """A brake application whose deceleration the brake of all stops does not explain."""

    start: float  # [s]
    stop: float  # [s]
    share: float  # its deceleration over the expected one


class SpeedEffect(NamedTuple):
    """How the brake force per pressure changes with the speed, as one log shows it."""

    ratio: float  # at the low speed over that at the high one
    sigma: float  # 1 sigma of its logarithm, by the gradient
    low: float  # [m/s]
    high: float  # [m/s]


class CarBrake(NamedTuple):
    """What the brake of a car does per bar; a train of equal axles is one car."""

    name: str  # "" without cars
    axles: tuple[int, ...]  # their numbers; empty where every axle is alike
    force: Parameter  # at the rim of an axle [N]
    deceleration: Parameter  # of the car, all of its axles braked and rolling [m/s²]
    # Speed [m/s] and clamping force [N] that both are for, where friction is a table.
    state: tuple[float, float] | None = None


VehicleSource = Literal["stated", "default", "log"]


@dataclass(frozen=True, slots=True)
class IdentifiedVehicle:
    """The vehicle that a run uses, and where it is from."""

    vehicle: Vehicle
    source: VehicleSource  # of the prior: stated, the default, or none: the log alone
    # brake force at the rim of the log's first axle [N]; None where K is logged
    force_per_bar: Parameter | None
    stated_force_per_bar: Parameter | None = None  # the same as stated, or of the default
    stops: int = 0  # brake applications of the logs that were evidence
    logs: int = 0  # the logs that have them
    known: bool = True  # whether the adhesion force can be known
    factor: float | None = None  # the log's brake force over the stated one, where that is used
    # where the log and what is stated differ by 2 to 4 sigma: the log's force over that, and sigmas
    doubt: tuple[float, float] | None = None
    # stops that the brake of all does not explain, after the start of the log, by its path
    differing_stops: Mapping[str, tuple[DifferingStop, ...]] = field(default_factory=dict)
    speed_effects: Mapping[str, SpeedEffect] = field(default_factory=dict)  # by the path
    differing: tuple[str, ...] = ()  # paths of logs that brake otherwise than all together
    other_brake: bool = False  # whether a brake without a pressure in the logs slows the train, too
    mean_axle: tuple[Vehicle, Vehicle] | None = None  # as stated, and as identified
    cars: tuple[CarBrake, ...] = ()  # as stated; empty where K is logged
    unstated: tuple[str, ...] = ()  # parameters that scale the brake, where others are stated
    # brake force of its logs over that of the first logs, where logs named together have several
    factor_of_logs: float = 1.0
    motor_mass: Parameter | None = None  # of an axle, by the forces of motors in the logs [kg]
    carried: bool = False  # whether it is that of a result file, as an earlier run had it


class LogBrake(NamedTuple):
    """The brake that the deceleration of one log shows, whatever vehicle is stated."""

    deceleration_per_bar: Annotated[Number, Quantity("m/s²", "per bar, while rolling; null with K")]
    ratio: Annotated[float, Quantity("-", "the log's brake force over that of the vehicle used")]
    sigma: Annotated[float, Quantity("-", "standard uncertainty of both, as a share")]
    pressure_bar: Annotated[Number, Quantity("bar", "mean pressure above the begin of the brake")]
    speed_mps: Annotated[float, Quantity("m/s", "mean speed of the braking that shows it")]


@dataclass(frozen=True, slots=True)
class Nis:
    """Normalised innovation squared of a filter, mean over the log: 1 if its model is right."""

    mean: Annotated[float, Quantity("", "mean over the log")]
    low: Annotated[float, Quantity("", "lower limit of the mean if the model is right (95 %)")]
    high: Annotated[float, Quantity("", "its upper limit; correlated innovations are counted")]


@dataclass(frozen=True, slots=True)
class Reference:
    """Offline adhesion force of one axle; columns of shape (n,) [N]."""

    method: str
    source: str
    force: Floats
    sigma: Floats  # standard uncertainty by noise
    tolerance: Floats  # standard uncertainty by the vehicle's tolerances
    saturated: Bools | None = None  # the true pressure and force are higher by an unknown amount
    runout: float = 0.0  # largest run-out that was removed, share of the wheel speed
    pulses: float = math.inf  # pulses while a slide may change, if they are few
    averaged: float = 0.0  # probability that the speed is the mean over its interval
    mass: Floats | None = None  # covariance of the force with ln m, by the tolerances [N]
    nis: Nis | None = None  # of the forward filter, None where the method has none
    impulse: Floats | None = None  # 1 sigma of I ω/R at one time, by the speed's noise [N s]
    clamping: Floats | None = None  # the part of `sigma` that the noise of K has [N]
    pad_lag: float = 0.0  # by which the pads lag the pressure, as the slides show it [s]
    brake: Floats | None = None  # brake force at the rim, as measured [N]

    @property
    def half_width(self) -> Floats:
        """Half-width of the 95 % band, noise and vehicle tolerances [N]."""
        return Z95 * np.hypot(self.sigma, self.tolerance)

    @property
    def lower(self) -> Floats:
        """Lower edge of the 95 % band [N]."""
        return self.force - self.half_width

    @property
    def upper(self) -> Floats:
        """Upper edge of the 95 % band [N], NaN where the pressure is saturated."""
        upper = self.force + self.half_width
        return upper if self.saturated is None else np.where(self.saturated, np.nan, upper)

    def rows(self, selection: slice | NDArray[np.int64]) -> "Reference":
        """Some rows of it."""
        return replace(self, **columns_at(self, selection))


@dataclass(frozen=True, slots=True)
class Score:
    """How well one estimate follows truth or reference on one axle.

    `blocks` is for programs only. It has, for each stretch of time, the mean square error [N²], and
    by how much the target's own noise moves that, 1 sigma.
    """

    algo: Annotated[str, Quantity("", "name of the estimator")]
    against: Annotated[Literal["truth", "reference"], Quantity("", "what it is compared with")]
    rmse_n: Annotated[Number, Quantity("N", "root mean square error")] = None
    bias_n: Annotated[Number, Quantity("N", "mean error")] = None
    max_error_n: Annotated[Number, Quantity("N", "largest error, with its sign")] = None
    lag_s: Annotated[Number, Quantity("s", "delay behind the target")] = None
    gain: Annotated[Number, Quantity("-", "changes of the estimate over the target's")] = None
    response_s: Annotated[Number, Quantity("s", "time to 95 % of a step")] = None
    ripple_n: Annotated[Number, Quantity("N", "what moves quicker than 0.5 s, rms")] = None
    relative: Annotated[Number, Quantity("-", "rmse over the least rmse")] = None
    band_n: Annotated[Number, Quantity("N", "median half-width of its own 95 % band")] = None
    within: Annotated[Number, Quantity("-", "share of samples where it holds the target")] = None
    nis: Annotated[Nis | None, Quantity("-", "normalised innovation squared")] = None
    alike: Annotated[bool | None, Quantity("", "whether only noise tells it from the best")] = None
    blocks: tuple[Floats, Floats] | None = field(
        default=None, compare=False, repr=False, metadata=NOT_IN_JSON
    )


class Event(NamedTuple):
    """An event, such as a slide; in a list of all that happened a finding is one, too."""

    t: int  # [ns]
    code: str  # stable, kebab-case
    message: str
    until: int | None = None  # where it lasts [ns]
    axle: int | None = None
    severity: Severity = "info"


@dataclass(frozen=True, slots=True)
class AxleResult:
    """Everything computed for one axle."""

    record: AxleRecord
    reference: Reference
    estimates: dict[str, Floats]  # F̂ by algorithm [N], shape (n,)
    scores: tuple[Score, ...]
    applications: tuple[slice, ...]  # brake applications found in the record
    slip: Floats | None = None  # s, NaN below the speed limit
    slip_noise: Floats | None = None  # standard uncertainty by noise, NaN below the speed limit
    radius_share: float = 0.0  # 1 sigma of the wheel's radius against the train speed, as a share
    slope: Floats | None = None  # dμ/ds, NaN where not observable
    slope_confidence: Floats | None = None  # 0 not observable, 1 certain
    region: Regions | None = None  # index into `slope.REGIONS`
    events: tuple[Event, ...] = ()  # slides and changes of region
    sigmas: Mapping[str, Floats] = field(default_factory=dict)  # of estimators that have one [N]

    def sigma(self, algo: str) -> Floats:
        """1 sigma of an estimate, by itself where it has one, else by the reference [N], (n,)."""
        return self.sigmas.get(algo, self.reference.sigma)

    def error(self, algo: str, rows: slice | NDArray[np.int64] = slice(None)) -> Floats:
        """Estimate minus truth or reference, whichever it is scored against [N], of these rows."""
        against = {s.algo: s.against for s in self.scores}.get(algo, "reference")
        target = self.record.truth if against == "truth" else self.reference.force
        assert target is not None  # only a known truth is scored against
        return self.estimates[algo][rows] - target[rows]


@dataclass(frozen=True, slots=True)
class Result:
    """One analysed log."""

    log: Log
    identified: IdentifiedVehicle
    axles: tuple[AxleResult, ...]
    findings: tuple[Finding, ...]
    settings: dict[str, Any]  # every parameter used, as TOML would hold it
    sources: tuple[str, ...] = field(default=())  # literature of the methods used
    brake: LogBrake | None = None  # by the deceleration of this log alone
    track: Track = field(default_factory=Track)  # the line as stated

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle that was used."""
        return self.identified.vehicle

    @property
    def other_brakes(self) -> list[Finding]:
        """The findings of brakes that act and are not in the clamping force."""
        return [f for f in self.findings if f.code == "other-brake"]

    def brake_ns(self) -> int:
        """Start of the first brake application, else of the log [ns]."""
        begun = [int(a.record.t[a.applications[0].start]) for a in self.axles if a.applications]
        return min(begun, default=self.log.start_ns())

    def shared_train(self) -> Channel | None:
        """The speed or acceleration of the train that all axles have in common."""
        train, *other_trains = (self.log.find("train_speed", a.record.axle) for a in self.axles)
        return train if all(channel is train for channel in other_trains) else None

    def inputs_hold(self, train: Channel) -> bool:
        """Whether the record of every axle has this speed of the train as it was logged."""
        return not train.is_rate and all(
            np.array_equal(r.t, train.data.t)
            and r.train_speed is not None
            and np.array_equal(r.train_speed, train.data.value)
            for r in (a.record for a in self.axles)
        )
