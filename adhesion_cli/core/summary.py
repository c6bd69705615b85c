"""The numbers of one analysed log, as JSON, tables, pages and Python have them: one class each.

Names are those of the JSON. None is what the log does not show.
"""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal, NamedTuple, Protocol

from . import finding, model
from .model import NOT_IN_JSON, Z95, Floats, Number, Quantity

# The definition that tables, JSON and pages repeat.
JERK = (
    "largest jerk from the command to 5 km/h: second derivative of third-degree polynomials over "
    "1 s, of a speed smoothed by second-degree polynomials over 1 s (Savitzky-Golay), less the "
    "excess by noise; not known with fewer than 4 readings a second"
)
HIGHEST = "highest mean over `analysis.peak_time`; null: its interval holds both µ = 0 and µ = 0.1"
U95, OF_BOUND = "expanded uncertainty (95 %)", "null of a lower bound"
SLIP_U95 = f"{U95} of the largest slip; {OF_BOUND}"
SLIDE_SPAN = "from 1 % of slip to 1 % of slip, with more than 5 % for 0.1 s or more between"


class MeanAndHighest(NamedTuple):
    """Mean and highest value, each with its expanded uncertainty (95 %)."""

    mean: Annotated[float, Quantity("", "mean over the brake application")]
    mean_u95: Annotated[float, Quantity("", "its expanded uncertainty (95 %)")]
    max: Annotated[Number, Quantity("", HIGHEST)]
    max_u95: Annotated[float, Quantity("", "its expanded uncertainty (95 %)")]


class Contribution(NamedTuple):
    """What one quantity contributes to the uncertainty of a force."""

    quantity: Annotated[str, Quantity("", "a vehicle parameter, or `noise` of speed and pressure")]
    value: Annotated[Number, Quantity("", "as used; null for the noise")]
    unit: Annotated[str, Quantity("", "unit of `value` and `u`")]
    type: Annotated[Literal["A", "B"], Quantity("", "A: by samples. B: tolerance of the vehicle")]
    u: Annotated[float, Quantity("", "standard uncertainty")]
    sensitivity: Annotated[float, Quantity("N per unit", "∂F/∂q, mean over the samples")]
    contribution_n: Annotated[float, Quantity("N", "standard uncertainty of F by it")]
    share: Annotated[float, Quantity("-", "of the variance of F, with half of each correlation")]


class Coverage(NamedTuple):
    """The uncertainty of the mean force."""

    u_n: Annotated[float, Quantity("N", "combined standard uncertainty")]
    k: Annotated[float, Quantity("-", "coverage factor of 95 %")]
    degrees_of_freedom: Annotated[Number, Quantity("-", "Welch and Satterthwaite; null: no noise")]


PositionSource = Annotated[
    Literal["position", "distance", "coordinates"] | None,
    Quantity("", "what shows it; distance, coordinates: way since the start of the log"),
]


class SlideSummary(NamedTuple):
    """One slide of one axle."""

    start_s: Annotated[float, Quantity("s", "begin, after the start of the log")]
    duration_s: Annotated[float, Quantity("s", SLIDE_SPAN)]
    distance_m: Annotated[float, Quantity("m", "distance of the train in it")]
    max_slip: Annotated[Number, Quantity("-", "largest slip above 10 km/h; null if slower")]
    energy_j: Annotated[Number, Quantity("J", "friction between wheel and rail")]
    at_least: Annotated[bool, Quantity("", "whether time, distance, slip, energy are lower bounds")]
    peak_mu: Annotated[
        Number,
        Quantity("-", "highest adhesion coefficient of the rail under it; null if not shown"),
    ] = None
    peak_mu_ci: Annotated[tuple[float, float] | None, Quantity("-", "its 95 % interval")] = None
    utilisation: Annotated[
        Number, Quantity("-", "adhesion used over the highest, in its brake application")
    ] = None
    time: Annotated[str | None, Quantity("", "of its begin, ISO 8601; null: no calendar")] = None
    position_km: Annotated[Number, Quantity("km", "place at its begin; null: not known")] = None
    latitude: Annotated[Number, Quantity("°", "north positive, at its begin")] = None
    longitude: Annotated[Number, Quantity("°", "east positive, at its begin")] = None
    duration_u95_s: Annotated[Number, Quantity("s", f"{U95} of its duration; {OF_BOUND}")] = None
    max_slip_u95: Annotated[Number, Quantity("-", SLIP_U95)] = None


class _HasSlip(Protocol):
    @property
    def max_slip(self) -> float | None: ...
    @property
    def max_slip_u95(self) -> float | None: ...


def largest_slip(rows: Iterable[_HasSlip]) -> tuple[float, float | None] | tuple[None, None]:
    """The largest slip of what has one, and its expanded uncertainty [-]."""
    slips = [(x.max_slip, x.max_slip_u95) for x in rows if x.max_slip is not None]
    return max(slips, key=lambda slip: slip[0], default=(None, None))


class Measured(NamedTuple):
    """A measured quantity with its expanded uncertainty (95 %)."""

    value: Annotated[float, Quantity("", "measured value")]
    u95: Annotated[float, Quantity("", "its expanded uncertainty (95 %)")]
    common_u95: Annotated[float, Quantity("", "the part that is the same in every stop")] = 0.0


@dataclass(frozen=True, slots=True, kw_only=True)
class BrakeApplication:
    """One brake application of one axle."""

    axle: Annotated[int, Quantity("", "number, from 1")] = field(default=0, metadata=NOT_IN_JSON)
    start_s: Annotated[float, Quantity("s", "begin, after the start of the log")]
    end_s: Annotated[float, Quantity("s", "end, after the start of the log")]
    from_mps: Annotated[Number, Quantity("m/s", "speed at the start: the train's, else the rim's")]
    to_mps: Annotated[Number, Quantity("m/s", "the same speed at the end")]
    force_n: Annotated[MeanAndHighest | None, Quantity("N", "adhesion force; null: no reference")]
    coefficient: Annotated[MeanAndHighest | None, Quantity("-", "adhesion coefficient µ")]
    slides: Annotated[int, Quantity("", "number of slides that begin in it")]
    slide_list: Annotated[tuple[SlideSummary, ...], Quantity("", "each slide")]
    slide_s: Annotated[float, Quantity("s", "duration of all slides together")]
    slide_distance_m: Annotated[float, Quantity("m", "distance of the train in them")]
    max_slip: Annotated[Number, Quantity("-", "largest slip above 10 km/h; null without a slide")]
    max_slip_u95: Annotated[Number, Quantity("-", SLIP_U95)] = None
    slide_energy_j: Annotated[Number, Quantity("J", "friction energy; null where F is not known")]
    slide_energy_u95_j: Annotated[
        Number,
        Quantity("J", "its expanded uncertainty (95 %), by F, also that of locks"),
    ] = None
    locked_s: Annotated[Number, Quantity("s", "time in which the wheel is locked")] = None
    longest_lock_s: Annotated[Number, Quantity("s", "the longest such time at once")] = None
    at_least: Annotated[
        bool,
        Quantity(
            "",
            "duration, distance, slip and energy of its slides, not their number, are lower bounds:"
            " the train speed is estimated or may be late",
        ),
    ]
    utilisation: Annotated[
        Number, Quantity("-", "mean adhesion in the slides over the highest that the rail gives")
    ]
    utilisation_ci: Annotated[tuple[float, float] | None, Quantity("-", "its 95 % interval")]
    budget: Annotated[
        tuple[Contribution, ...] | None,
        Quantity("", "contributions to the uncertainty of the mean force"),
    ]
    coverage: Annotated[Coverage | None, Quantity("", "the combined uncertainty of the mean force")]
    other_brake: Annotated[
        bool, Quantity("", "whether another brake acts, whose force is not in force and µ")
    ] = False
    slip_unknown_s: Annotated[float, Quantity("s", "no train speed: slides may be hidden")] = 0.0
    time: Annotated[str | None, Quantity("", "of the start, ISO 8601; null: no calendar")] = None
    position_km: Annotated[Number, Quantity("km", "place at the start; null: not known")] = None
    position_from: PositionSource = None
    latitude: Annotated[Number, Quantity("°", "north positive, at the start")] = None
    longitude: Annotated[Number, Quantity("°", "east positive, at the start")] = None
    slide_start_s: Annotated[Number, Quantity("s", "begin of its first slide, as start_s")] = None
    slide_position_km: Annotated[Number, Quantity("km", "place there, as position_km")] = None
    ed_share: Annotated[
        Measured | None, Quantity("-", "share of the ED brake in the brake work; null without one")
    ] = None

    @property
    def kilometre(self) -> float | None:
        """Its place on the line [km]; None where only the way since the log's start is known."""
        return self.position_km if self.position_from == "position" else None


CommandSource = Literal["channel", "brake_pipe", "pressure", "deceleration"]


class AxleStop(NamedTuple):
    """One axle in one stop."""

    axle: Annotated[int, Quantity("", "number, from 1")]
    max_slip: Annotated[Number, Quantity("-", "largest slip above 10 km/h; null without rim speed")]
    locked_s: Annotated[Number, Quantity("s", "time in which the wheel is locked")]
    longest_lock_s: Annotated[Number, Quantity("s", "the longest such time at once")]
    valve_actions: Annotated[int, Quantity("", "releases of the brake by the WSP")]
    slip_bands: Annotated[
        tuple[float, ...] | None,
        Quantity("-", "shares of the time above 10 km/h with slip to 5, 10, 20, 50 and 100 %"),
    ] = None
    initial_coefficient: Annotated[
        Number, Quantity("-", "mean adhesion coefficient of 0.1 s at the begin of the first slide")
    ] = None
    initial_coefficient_u95: Annotated[Number, Quantity("-", "its expanded uncertainty (95 %)")] = (
        None
    )
    utilisation: Annotated[
        Number, Quantity("-", "mean adhesion in the slides over the highest that the rail gives")
    ] = None
    utilisation_ci: Annotated[tuple[float, float] | None, Quantity("-", "its 95 % interval")] = None
    energy_j: Annotated[Number, Quantity("J", "friction energy of wheel and rail in slides")] = None
    lock_energy_j: Annotated[
        Number, Quantity("J", "the same of the longest lock: heat in one place of the tread")
    ] = None
    valves_from: Annotated[
        Literal["valves", "pressure"] | None,
        Quantity("", "what shows the valve actions: valve channels, or falls of the pressure"),
    ] = None
    vented_s: Annotated[
        Number, Quantity("s", "time in which the vent valve is open; null without its channel")
    ] = None
    rolling_u95: Annotated[
        Number,
        Quantity("-", "expanded uncertainty of the share with slip to 5 %, by the speeds (95 %)"),
    ] = None
    at_least: Annotated[
        bool, Quantity("", "whether slip and energy are lower bounds: the train speed may be wrong")
    ] = False
    max_slip_u95: Annotated[Number, Quantity("-", SLIP_U95)] = None


class StopContribution(NamedTuple):
    """What one source of error contributes to the uncertainty of a stop."""

    source: Annotated[str, Quantity("", "of the error")]
    common: Annotated[bool, Quantity("", "whether it is the same in every stop of a series")]
    distance_m: Annotated[float, Quantity("m", "change of the distance by 1 standard uncertainty")]
    deceleration: Annotated[float, Quantity("m/s²", "of the equivalent deceleration, else mean")]


@dataclass(frozen=True, slots=True, kw_only=True)
class StopSummary:
    """One stop of the whole train."""

    start_s: Annotated[float, Quantity("s", "command time, after the start of the log")]
    end_s: Annotated[float, Quantity("s", "standstill, after the start of the log")]
    command_from: Annotated[
        CommandSource,
        Quantity("", "what shows the command time; pressure: the first rise of a cylinder"),
    ]
    speed_from: Annotated[
        Literal["train", "axles"], Quantity("", "source of the speed; axles: estimated from them")
    ]
    nominal_speed_kmh: Annotated[float, Quantity("km/h", "nominal speed: the nearest, or stated")]
    time: Annotated[str | None, Quantity("", "of the command, ISO 8601; null: no calendar")] = None
    position_m: Annotated[Number, Quantity("m", "place on the line at the command")] = None
    position_from: PositionSource = None
    latitude: Annotated[Number, Quantity("°", "north positive, at the command")] = None
    longitude: Annotated[Number, Quantity("°", "east positive, at the command")] = None

    @property
    def kilometre(self) -> float | None:
        """Its place on the line [km]; None where only the way since the log's start is known."""
        of_line = self.position_m is not None and self.position_from == "position"
        return self.position_m / 1e3 if of_line and self.position_m is not None else None

    valid: Annotated[bool, Quantity("", "whether it is a whole stop")]
    reason: Annotated[str | None, Quantity("", "why it is not valid")] = None
    pressure_bar: Annotated[
        Number, Quantity("bar", "full pressure of the brake cylinders, mean of the axles")
    ] = None
    initial_speed_mps: Annotated[Measured | None, Quantity("m/s", "speed at the command")]
    distance_m: Annotated[Measured | None, Quantity("m", "distance from command to standstill")]
    duration_s: Annotated[Measured | None, Quantity("s", "time from command to standstill")]
    delay_s: Annotated[Measured | None, Quantity("s", "until the start share, mean of the axles")]
    dead_time_s: Annotated[
        Measured | None,
        Quantity("s", "from a logged command to the first rise of a cylinder, part of the delay"),
    ] = None
    build_up_s: Annotated[
        Measured | None, Quantity("s", "from the start share to 95 %; null as the response time")
    ] = None
    response_time_s: Annotated[
        Measured | None,
        Quantity("s", "equivalent: delay and half of the build-up; null under slides"),
    ]
    response_from: Annotated[
        Literal["brakes", "deceleration"] | None,
        Quantity("", "what shows the response; deceleration: another brake acts, or other cars do"),
    ] = None
    mean_deceleration: Annotated[Measured | None, Quantity("m/s²", "v0² / (2 s)")]
    equivalent_deceleration: Annotated[
        Measured | None, Quantity("m/s²", "v0² / (2 (s − v0 t_e)), without the response time")
    ]
    jerk: Annotated[Measured | None, Quantity("m/s³", JERK)]
    corrected_distance_m: Annotated[
        Measured | None, Quantity("m", "distance on level track from the nominal speed")
    ]
    energy_distance_m: Annotated[
        Measured | None,
        Quantity("m", "the same by the energy alone, s · 3.933ρV_n²/(3.933ρV² − is)"),
    ] = None
    coefficient: Annotated[
        Measured | None, Quantity("-", "adhesion coefficient, mean over all axles and the stop")
    ] = None
    other_brake: Annotated[
        bool, Quantity("", "whether another brake acts, whose force is not in the coefficient")
    ] = False
    slides: Annotated[int, Quantity("", "number of slides of all axles")] = 0
    max_slip: Annotated[Number, Quantity("-", "largest slip of any axle; null: no slide")] = None
    max_slip_u95: Annotated[Number, Quantity("-", SLIP_U95)] = None
    sanding_s: Annotated[Number, Quantity("s", "time of sanding; null without its channel")] = None
    reservoir_drop_pa: Annotated[
        Number, Quantity("Pa", "fall of the reservoir's pressure; null without its channel")
    ] = None
    ed_share: Annotated[
        Measured | None,
        Quantity("-", "share of the ED brake in the brake work of all axles; null without one"),
    ] = None
    axles: tuple[AxleStop, ...] = ()
    budget: tuple[StopContribution, ...] = ()
    # times after the command [s] and the smoothed speed then [m/s], for figures
    speed: tuple[Floats, Floats] | None = field(
        default=None, compare=False, repr=False, metadata=NOT_IN_JSON
    )


class ReferenceSummary(NamedTuple):
    """The offline reference of one axle."""

    method: Annotated[str, Quantity("", "name of the method")]
    sigma_n: Annotated[Number, Quantity("N", "median standard uncertainty by noise")]
    band_n: Annotated[Number, Quantity("N", "median half-width of the 95 % band")]
    nis: Annotated[model.Nis | None, Quantity("-", "normalised innovation squared")] = None


@dataclass(frozen=True, slots=True)
class CarSummary:
    """The brake of a car as stated; the whole train is one where all axles are alike."""

    name: Annotated[str, Quantity("", "name of the car, empty without cars")]
    axles: Annotated[tuple[int, ...], Quantity("", "numbers of its axles, empty for all")]
    force_per_bar_n: Annotated[float, Quantity("N", "brake force at the rail per bar and axle")]
    u95: Annotated[float, Quantity("N", "its expanded uncertainty (95 %)")]
    deceleration_per_bar: Annotated[
        float, Quantity("m/s²", "deceleration of the car per bar, all of its axles braked")
    ]
    speed_mps: Annotated[
        Number, Quantity("m/s", "speed that both are for, where friction is a table")
    ] = None
    clamping_force_n: Annotated[
        Number, Quantity("N", "clamping force of an axle that both are for, where friction has it")
    ] = None


@dataclass(frozen=True, slots=True)
class VehicleSummary:
    """The vehicle that the result is of, and where it is from."""

    source: Annotated[
        model.VehicleSource,
        Quantity("", "what the log adds to: stated, default; log: nothing but the log"),
    ]
    known: Annotated[bool, Quantity("", "whether force and µ can be known")]
    force_per_bar_n: Annotated[
        Number, Quantity("N", "as used: brake force at the rim of an axle per bar; null with K")
    ]
    u95: Annotated[Number, Quantity("N", "its expanded uncertainty (95 %)")]
    stated_force_per_bar_n: Annotated[Number, Quantity("N", "the same as stated, or by default")]
    stated_u95: Annotated[Number, Quantity("N", "its expanded uncertainty (95 %)")]
    stops: Annotated[int, Quantity("", "brake applications whose deceleration was used")] = 0
    logs: Annotated[int, Quantity("", "logs that they are of")] = 0
    contradicted_by: Annotated[
        Number,
        Quantity("-", "the log's brake force over the stated one, where it contradicts that"),
    ] = None
    other_brake: Annotated[
        bool, Quantity("", "whether a brake without a pressure in the log slows the train, too")
    ] = False
    cars: Annotated[
        tuple[CarSummary, ...], Quantity("", "the brake of each car as stated; none with K")
    ] = ()
    unstated: Annotated[
        tuple[str, ...],
        Quantity("", "parameters that scale the brake and lack, where others are stated"),
    ] = ()
    carried: Annotated[bool, Quantity("", "whether it is that of a result file")] = False


class AxleSummary(NamedTuple):
    """One axle."""

    axle: Annotated[int, Quantity("", "number, from 1")]
    reference: ReferenceSummary
    applications: tuple[BrakeApplication, ...]
    estimators: tuple[model.Score, ...]


class LogSummary(NamedTuple):
    """The log that was analysed."""

    path: Annotated[str, Quantity("", "path of the log, as it was named")]
    format: Annotated[str, Quantity("", "format of the log")]
    sha256: Annotated[str, Quantity("", "SHA-256 of its bytes")]
    start: Annotated[str | None, Quantity("", "ISO 8601, UTC; null without a calendar")]
    duration_s: Annotated[float, Quantity("s", "from the first to the last sample")]
    rows_read: Annotated[int, Quantity("", "rows or messages in the file")]
    rows_used: Annotated[int, Quantity("", "those that some axle's record holds")]


@dataclass(frozen=True, slots=True)
class ChannelSummary:
    """What a channel of the log was taken for."""

    name: Annotated[str, Quantity("", "topic or column header")]
    field: Annotated[str, Quantity("", "place inside a message")]
    meaning: Annotated[str | None, Quantity("", "what it measures; null where nobody knows")]
    axle: Annotated[int | None, Quantity("", "number; null for the whole train")]
    unit: Annotated[str, Quantity("", "unit in the log")]
    reason: Annotated[str, Quantity("", "why it was taken for that")]
    levels: Annotated[
        tuple[str, ...], Quantity("", "of a state in words: the word of 0, of 1 and so on")
    ] = dataclasses.field(default=(), kw_only=True)

    @property
    def title(self) -> str:
        """Name and field, for people."""
        return f"{self.name} {self.field}".strip()


@dataclass(frozen=True, slots=True)
class FindingSummary:
    """One thing about the data that the user must be able to know."""

    code: Annotated[str, Quantity("", "`adhesion explain CODE` explains it")]
    severity: Annotated[str, Quantity("", "info, warning or error")]
    channel: Annotated[str, Quantity("", "name in the log, or `axle N`")]
    count: Annotated[int, Quantity("", "number of samples, rows or messages")]
    first_s: Annotated[Number, Quantity("s", "when it first occurs; null where it has no time")]
    spans: Annotated[tuple[tuple[float, float], ...], Quantity("s", "begin, end of each stretch")]
    values: Annotated[
        Mapping[str, float],
        Quantity("", "numbers that the message quotes; the name ends with the unit"),
    ]
    names: Annotated[Mapping[str, str], Quantity("", "texts that the message quotes")]
    message: Annotated[str, Quantity("", "what is wrong, in one line")]
    hint: Annotated[str | None, Quantity("", "remedy, or null")]


@dataclass(frozen=True, slots=True)
class ResultSummary:
    """One analysed log."""

    log: LogSummary
    outputs: Annotated[Mapping[str, str], Quantity("", "the files written, by format")]
    vehicle: VehicleSummary
    axles: tuple[AxleSummary, ...]
    channels: tuple[ChannelSummary, ...]
    findings: tuple[FindingSummary, ...]
    brake: Annotated[
        model.LogBrake | None,
        Quantity("", "by the deceleration of this log alone; null if not shown"),
    ] = None
    stops: Annotated[tuple[StopSummary, ...], Quantity("", "stops of the whole train")] = ()


@dataclass(frozen=True, slots=True)
class FailedLog:
    """A log that has no result."""

    path: Annotated[str, Quantity("", "path of the log")]
    error: Annotated[str, Quantity("", "what is wrong, in one line")]
    hint: Annotated[str, Quantity("", "remedy")]
    sha256: str | None = None


class Constant(NamedTuple):
    """A constant of the creep law, with its 95 % interval."""

    value: Annotated[float, Quantity("", "the likeliest one")]
    ci: Annotated[tuple[float, float], Quantity("", "its 95 % interval")]


@dataclass(frozen=True, slots=True)
class SlipSummary:
    """Slip of one axle, and the rail under its slides."""

    log: Annotated[str, Quantity("", "path of the log")]
    axle: Annotated[int, Quantity("", "number, from 1")]
    peak_slip: Annotated[Number, Quantity("-", "slip at the peak of the curve; null if not shown")]
    peak_slip_ci: Annotated[tuple[float, float] | None, Quantity("-", "its 95 % interval")]
    peak_slip_below: Annotated[
        Number, Quantity("-", "slip below which the peak lies (97.5 %), where only that is known")
    ]
    peak_mu: Annotated[Number, Quantity("-", "the highest adhesion coefficient")]
    peak_mu_ci: Annotated[tuple[float, float] | None, Quantity("-", "its 95 % interval")]
    peak_speed_mps: Annotated[Number, Quantity("m/s", "train speed at which the peak is given")]
    slip_rmse: Annotated[Number, Quantity("-", "error against the log's true slip, rms")]
    train_speed_late_s: Annotated[Number, Quantity("s", "delay of the train speed, removed")]
    train_speed_late_sigma_s: Annotated[Number, Quantity("s", "its standard uncertainty")]
    regions: Annotated[Mapping[str, float], Quantity("-", "share of the braked time, by region")]
    utilisation: Annotated[Number, Quantity("-", "adhesion used over the highest, in the slides")]
    utilisation_ci: Annotated[tuple[float, float] | None, Quantity("-", "its 95 % interval")]
    slides: tuple[SlideSummary, ...]
    fit: Annotated[Mapping[str, Constant] | None, Quantity("", "of the creep law; null: no fit")]
    fit_curve: Annotated[str | None, Quantity("", "the creep law")]


@dataclass(frozen=True, slots=True)
class InspectedChannel(ChannelSummary):
    """A channel of a log, and how it was sampled."""

    rate_hz: Annotated[Number, Quantity("Hz", "usual rate")]
    rows: Annotated[int, Quantity("", "samples in the log")]
    valid: Annotated[int, Quantity("", "those that may be used")]
    gaps: Annotated[int, Quantity("", "longer intervals without a sample")]
    duplicates: Annotated[int, Quantity("", "samples that repeat a time stamp")]
    backward: Annotated[int, Quantity("", "samples older than one before them")]


@dataclass(frozen=True, slots=True, kw_only=True)
class InspectedLog:
    """What is in a log, whatever is wrong with it."""

    path: Annotated[str, Quantity("", "path of the log, as it was named")]
    format: Annotated[str | None, Quantity("", "format of the log")] = None
    status: Annotated[Literal["ok", "damaged", "error"], Quantity("", "whether it can be read")] = (
        "ok"
    )
    error: Annotated[str | None, Quantity("", "why it cannot be read")] = None
    hint: Annotated[str | None, Quantity("", "remedy")] = None
    rows_read: Annotated[int, Quantity("", "rows or messages in the file")] = 0
    start: Annotated[str | None, Quantity("", "ISO 8601, UTC; null without a calendar")] = None
    duration_s: Annotated[float, Quantity("s", "from the first to the last sample")] = 0.0
    time: Annotated[str, Quantity("", "which clock, and why")] = ""
    stated: Annotated[
        Mapping[str, object], Quantity("", "what was decided about the format, and why")
    ] = field(default_factory=dict)
    channels: tuple[InspectedChannel, ...] = ()
    findings: tuple[FindingSummary, ...] = ()


def summarise_finding(f: finding.Finding) -> FindingSummary:
    """A finding with its words."""
    return FindingSummary(
        f.code, f.severity, f.channel, f.count, f.first_s, f.spans, f.values, f.names, f.message,
        f.hint,
    )  # fmt: skip


def summarise_vehicle(x: model.IdentifiedVehicle) -> VehicleSummary:
    """A vehicle with the force of its brake, at 95 %."""
    forces = *_expanded(x.force_per_bar), *_expanded(x.stated_force_per_bar)
    cars = tuple(
        CarSummary(
            c.name, c.axles, *_expanded(c.force), c.deceleration.value, *(c.state or (None, None))
        )
        for c in x.cars
    )
    evidence = x.stops, x.logs, x.factor, x.other_brake
    return VehicleSummary(x.source, x.known, *forces, *evidence, cars, x.unstated, x.carried)


def _expanded(x: model.Parameter | None) -> tuple[Any, Any]:
    """A value and its expanded uncertainty (95 %); None for both where it is not known."""
    return (x.value, Z95 * x.tolerance) if x else (None, None)
