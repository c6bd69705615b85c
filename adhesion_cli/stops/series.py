"""Stops as a test series: statistics of groups, differences, limits, wheel slide protection.

Each stop has an uncertainty of its own, and a part that is the same in every stop: one wheel
diameter, one radar, one track. That part does not average out. The expanded uncertainty of a mean
is

    U² = (t s / √n)² + U_common²

with the standard deviation s of the stops, and t of n − 1 degrees of freedom for 95 %. Where the
own uncertainty U of the stops is larger than t s, their errors do not scatter, as of a command that
is always read half a cycle late: √(U² − t² s²) is then in U_common, too. Of a difference between
groups, only the difference of the common parts counts: the errors have the same sign in both. But
what only does not scatter may be another error in the other group.

A limit is kept, or broken, where the interval mean ± U lies wholly on one side of it; else it is
not decided. Nor is one of a quantity that no valid stop of the group has. Each stop is judged, too,
by its own interval.

Sources: JCGM 100, 4.2, 5.2. JCGM 106, 8.3 (guarded acceptance, guard band U). Outliers: F. E.
Grubbs, Technometrics 11 (1969), two-sided, 5 % for all quantities of a group together (Bonferroni):
of twenty groups of sound stops, one has an outlier. Extension and K_wet: SUBSET-040, 4.4.1.5.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np

from ..core.model import Floats, Number, Quantity
from ..core.physics import NORMAL_PRESSURE
from ..core.summary import AxleStop, Measured, StopSummary, largest_slip

QUANTITIES = {  # of a stop, with the heading of its column and the unit
    "initial_speed_mps": ("v0", "m/s"),
    "distance_m": ("distance", "m"),
    "duration_s": ("time", "s"),
    "delay_s": ("delay", "s"),
    "response_time_s": ("response", "s"),
    "mean_deceleration": ("a", "m/s²"),
    "equivalent_deceleration": ("a equiv.", "m/s²"),
    "jerk": ("jerk", "m/s³"),
    "corrected_distance_m": ("level", "m"),
    "coefficient": ("µ", "-"),
}
_OF_VEHICLE = ("coefficient",)  # each group may have a vehicle of its own
# C and D of λ = C/s − D, by the nominal speed [km/h]
BRAKED_WEIGHT = {
    100: (61300.0, 8.9), 120: (91633.0, 11.6), 140: (130995.0, 11.6), 150: (152640.0, 11.6),
    160: (176714.0, 11.6), 180: (228219.0, 11.6), 200: (287620.0, 11.6),
}  # fmt: skip
_FEWEST = 3  # stops that show an outlier or a drift
_NEAR_SPEED = 3.0  # of the speed of a limit [km/h]
_LEVEL = 0.05  # of the tests for outliers of a group, all together
_SAME_SPEED = 0.1  # mean speeds of dry and wet stops that differ by less can be compared
Verdict = Literal["pass", "fail", "undecided"]
_UNDECIDED: Verdict = "undecided"
LimitKind = Literal["max", "min"]
_KINDS: tuple[LimitKind, ...] = ("max", "min")


@dataclass(frozen=True, slots=True)
class SeriesStop:
    """A stop of a series."""

    log: Annotated[str, Quantity("", "path of the log")]
    group: Annotated[str, Quantity("", "group of the series")]
    label: Annotated[str | None, Quantity("", "label of the plan")]
    stop: StopSummary
    vehicle_in_doubt: Annotated[bool, Quantity("", "that the log contradicts its vehicle")] = False

    def measured(self, quantity: str) -> Measured | None:
        """A quantity of a stop that is valid."""
        value: Measured | None = getattr(self.stop, quantity)
        return value if self.stop.valid else None


class Statistic(NamedTuple):
    """One quantity over the stops of a group."""

    n: Annotated[int, Quantity("", "stops that have it")]
    mean: Annotated[float, Quantity("", "mean")]
    sd: Annotated[Number, Quantity("", "standard deviation of one stop; null for one stop")]
    u95: Annotated[float, Quantity("", "expanded uncertainty of the mean (95 %)")]
    common_u95: Annotated[float, Quantity("", "the part of it that is the same in every stop")]
    scatter: Annotated[float, Quantity("-", "range over mean")]
    outliers: Annotated[
        tuple[int, ...],
        Quantity("", "stops of the series, from 1, that Grubbs' test rejects (5 % of groups)"),
    ]
    drift: Annotated[Number, Quantity("", "change from stop to stop, by a line")]
    drift_u95: Annotated[Number, Quantity("", "its expanded uncertainty")]
    steady_u95: Annotated[
        float, Quantity("", "the part of common_u95 that is of each stop, but does not scatter")
    ] = 0.0

    @property
    def series_u95(self) -> float:
        """The part of the uncertainty whose error is the same in all groups of the series."""
        return math.sqrt(max(self.common_u95**2 - self.steady_u95**2, 0.0))


class Group(NamedTuple):
    """A group of stops."""

    name: str
    n: int  # valid stops
    statistics: Mapping[str, Statistic]  # by quantity, those that a stop has


class GroupDifference(NamedTuple):
    """A quantity of one group less that of another."""

    from_group: str
    to_group: str
    quantity: str
    value: float  # later less earlier
    u95: float
    distinguishable: bool
    share: float  # of the earlier value


class GroupLimit(NamedTuple):
    """A limit that the user states, or names the rule of."""

    quantity: str
    highest: float | None
    lowest: float | None
    source: str = ""  # the published rule that states it; "": the user
    group: str = ""  # whose it is; "": of every group
    speed: float = 0.0  # [km/h] of the stops that it is for; 0: any

    def is_for(self, group: Group) -> bool:
        """Whether the stops of a group must keep it."""
        if self.group not in ("", group.name):
            return False
        v0 = group.statistics.get("initial_speed_mps")
        return not self.speed or bool(
            v0
            and abs(3.6 * v0.mean - self.speed) < _NEAR_SPEED
            and 3.6 * v0.scatter * v0.mean < 2.0 * _NEAR_SPEED
        )


class LimitVerdict(NamedTuple):
    """Whether a group keeps a limit."""

    group: Annotated[str, Quantity("", "group")]
    quantity: Annotated[str, Quantity("", "quantity")]
    limit: Annotated[float, Quantity("", "the limit")]
    kind: Annotated[LimitKind, Quantity("", "whether it is the highest or the lowest")]
    value: Annotated[Number, Quantity("", "mean of the group; null where no valid stop has it")]
    u95: Annotated[Number, Quantity("", "its expanded uncertainty")]
    verdict: Annotated[Verdict, Quantity("", "by the interval, guard band U")]
    source: Annotated[str, Quantity("", "rule that states the limit; empty: the plan")] = ""
    stops_pass: Annotated[int, Quantity("", "valid stops that keep it, each by its interval")] = 0
    stops_fail: Annotated[int, Quantity("", "those that do not")] = 0
    stops_undecided: Annotated[int, Quantity("", "those whose interval holds the limit")] = 0


class WspSummary(NamedTuple):
    """Wet stops against dry ones."""

    group: Annotated[str, Quantity("", "the wet group")]
    dry: Annotated[str, Quantity("", "the dry group")]
    extension: Annotated[Number, Quantity("-", "of the deceleration distance, wet over dry, − 1")]
    extension_u95: Annotated[Number, Quantity("-", "its expanded uncertainty")]
    k_wet: Annotated[Number, Quantity("-", "100 / (100 + extension in %)")]
    k_wet_u95: Annotated[Number, Quantity("-", "its expanded uncertainty")]
    axles: Annotated[
        tuple[AxleStop, ...],
        Quantity("", "largest slip, locks and energy; all valve actions; else means of the stops"),
    ]
    air_nl: Annotated[
        Number, Quantity("l", "normal litres of a stop, mean; null without reservoir and volume")
    ] = None
    sanding_s: Annotated[Number, Quantity("s", "mean sanding in a stop; null: no channel")] = None
    vehicle_in_doubt: Annotated[
        bool, Quantity("", "whether a log of a wet stop contradicts the vehicle that µ is of")
    ] = False


class StopSeries(NamedTuple):
    """The stops of a series, and what follows from them."""

    stops: tuple[SeriesStop, ...]
    groups: tuple[Group, ...]
    differences: tuple[GroupDifference, ...]
    limits: tuple[LimitVerdict, ...]
    wsp: tuple[WspSummary, ...]


def group_stops(stops: Sequence[SeriesStop]) -> list[Group]:
    """The groups of a series, in the order in which their first stops stand."""
    groups = []
    for name in dict.fromkeys(s.group for s in stops):
        numbers = [n for n, s in enumerate(stops, 1) if s.group == name and s.stop.valid]
        members = [stops[n - 1] for n in numbers]
        columns = {quantity: [s.measured(quantity) for s in members] for quantity in QUANTITIES}
        tests = sum(any(x is not None for x in measured) for measured in columns.values())
        level = _LEVEL / max(tests, 1)
        statistics = {
            quantity: statistic._replace(outliers=tuple(numbers[i] for i in statistic.outliers))
            for quantity, measured in columns.items()
            if (statistic := _statistic(measured, level))
        }
        groups.append(Group(name, len(members), statistics))
    return groups


def _statistic(measured: Sequence[Measured | None], level: float = _LEVEL) -> Statistic | None:
    """Statistics of the stops that have a quantity; None where none has it.

    Outliers, by a test of this level, are places in what was measured, from 0.
    """
    places = [i for i, x in enumerate(measured, 1) if x is not None]
    known_values = [x for x in measured if x is not None]
    if not known_values:
        return None
    values = np.array([x.value for x in known_values])
    n, mean = len(values), float(np.mean(values))
    common = float(np.mean([x.common_u95 for x in known_values]))  # of one sign in all
    own_square = float(np.mean([x.u95**2 - x.common_u95**2 for x in known_values]))
    scatter = float(np.ptp(values)) / abs(mean) if mean else 0.0
    if n == 1:
        return Statistic(1, mean, None, known_values[0].u95, common, scatter, (), None, None)
    sd = float(np.std(values, ddof=1))
    scattered = _student(n - 1) * sd
    steady = math.sqrt(max(own_square - scattered**2, 0.0))
    common = math.hypot(common, steady)
    u95 = math.hypot(scattered / math.sqrt(n), common)
    outliers = tuple(places[i] - 1 for i in _outliers(values, level))
    drift, drift_u95 = _drift(np.array(places, dtype=np.float64), values)
    return Statistic(n, mean, sd, u95, common, scatter, outliers, drift, drift_u95, steady)


def _student(freedom: float, share: float = 0.975) -> float:
    from scipy.special import stdtrit  # scipy.stats takes half a second to import

    return float(stdtrit(freedom, share))


def _outliers(values: Floats, level: float) -> list[int]:
    """Places of the values that Grubbs' test rejects at a level, one after the other."""
    places, rejected = list(range(len(values))), list[int]()
    while (n := len(places)) >= _FEWEST:
        x = values[places]
        sd = float(np.std(x, ddof=1))
        k = int(np.argmax(np.abs(x - np.mean(x))))
        quantile = _student(n - 2, 1.0 - level / (2.0 * n))
        limit = (n - 1) / math.sqrt(n) * math.sqrt(quantile**2 / (n - 2 + quantile**2))
        if not sd or abs(x[k] - np.mean(x)) <= limit * sd:
            break
        rejected.append(places.pop(k))
    return sorted(rejected)


def _drift(runs: Floats, values: Floats) -> tuple[float | None, float | None]:
    """Slope over the runs, and its expanded uncertainty."""
    n = len(values)
    if n < _FEWEST:
        return None, None
    (slope, _), covariance = np.polyfit(runs, values, 1, cov=True)
    return float(slope), _student(n - 2) * math.sqrt(covariance[0, 0])


def differences(groups: Sequence[Group], pairs: Iterable[tuple[str, str]]) -> list[GroupDifference]:
    """What the second group of each pair has more than the first, quantity by quantity."""
    by_name = {group.name: group for group in groups}
    rows = []
    for from_group, to_group in pairs:
        a, b = by_name[from_group].statistics, by_name[to_group].statistics
        for quantity in QUANTITIES:
            if quantity in a and quantity in b:
                pair = a[quantity], b[quantity]
                rows += [_difference(from_group, to_group, quantity, *pair)]
    return rows


def _difference(
    from_group: str, to_group: str, quantity: str, a: Statistic, b: Statistic
) -> GroupDifference:
    """The difference of two means. Source: Welch and Satterthwaite, JCGM 100, G.4."""
    variances, freedom = [], []
    for x in (a, b):
        if x.sd is None:
            own_sigma = math.sqrt(max(x.u95**2 - x.common_u95**2, 0.0)) / 2.0
            variances.append(own_sigma**2)
            freedom.append(50.0)  # of one stop, whose uncertainty is a tolerance
        else:
            variances.append(x.sd**2 / x.n)
            freedom.append(x.n - 1.0)
    variance = sum(variances)
    weights = sum(v * v / f for v, f in zip(variances, freedom, strict=True))
    effective = variance**2 / weights if weights else math.inf
    factor = _student(effective) if math.isfinite(effective) else 1.96
    value = b.mean - a.mean
    common = b.series_u95 - a.series_u95
    if quantity in _OF_VEHICLE:
        common = math.hypot(a.series_u95, b.series_u95)
    u95 = math.hypot(factor * math.sqrt(variance), common, a.steady_u95, b.steady_u95)
    share = value / a.mean if a.mean else 0.0
    return GroupDifference(from_group, to_group, quantity, value, u95, abs(value) > u95, share)


def judge(
    stops: Sequence[SeriesStop], groups: Iterable[Group], limits: Sequence[GroupLimit]
) -> list[LimitVerdict]:
    """Each limit against each group, and against each of its stops."""
    return [
        _verdict(stops, group, limit, kind, bound)
        for group in groups
        for limit in limits
        if limit.is_for(group)
        for kind, bound in zip(_KINDS, (limit.highest, limit.lowest), strict=True)
        if bound is not None
    ]


def _verdict(
    stops: Sequence[SeriesStop], group: Group, limit: GroupLimit, kind: LimitKind, bound: float
) -> LimitVerdict:
    members = (s.measured(limit.quantity) for s in stops if s.group == group.name)
    verdicts = [_decide(x.value, x.u95, kind, bound) for x in members if x]
    mean, u95, verdict = None, None, _UNDECIDED
    if x := group.statistics.get(limit.quantity):
        mean, u95, verdict = x.mean, x.u95, _decide(x.mean, x.u95, kind, bound)
    return LimitVerdict(
        group=group.name,
        quantity=limit.quantity,
        limit=bound,
        kind=kind,
        value=mean,
        u95=u95,
        verdict=verdict,
        source=limit.source,
        stops_pass=verdicts.count("pass"),
        stops_fail=verdicts.count("fail"),
        stops_undecided=verdicts.count(_UNDECIDED),
    )


def _decide(value: float, u95: float, kind: LimitKind, bound: float) -> Verdict:
    """Whether the interval of a value keeps or breaks a limit. Source: JCGM 106, 8.3."""
    excess = value - bound if kind == "max" else bound - value
    if excess + u95 <= 0.0:
        return "pass"
    return "fail" if excess - u95 > 0.0 else _UNDECIDED


def compare_wet(stops: Sequence[SeriesStop], dry: str, wet: str, volume: float = 0.0) -> WspSummary:
    """Wet stops against dry ones: extension of the deceleration distance, and the axles.

    The deceleration distance is that after the equivalent response time. Where slides hide the
    response of a wet stop, that of the dry ones stands for it. Where the groups stop from other
    speeds, there is no extension. `volume` is that of the reservoir [l]; 0: not known.
    """
    of_dry, of_wet = ([s.stop for s in stops if s.group == n and s.stop.valid] for n in (dry, wet))
    responses = [s.response_time_s.value for s in of_dry if s.response_time_s]
    response = float(np.mean(responses)) if responses else 0.0
    lengths = [_statistic([_braked_length(s, response) for s in x]) for x in (of_dry, of_wet)]
    extension = u95 = k_wet = k_wet_u95 = None
    if lengths[0] and lengths[1] and wet_speeds(stops, dry, wet) is None:
        ratio = lengths[1].mean / lengths[0].mean
        extension, k_wet = ratio - 1.0, 1.0 / ratio
        statistics = [x for x in lengths if x]
        own_shares = [math.sqrt(max(x.u95**2 - x.series_u95**2, 0.0)) / x.mean for x in statistics]
        common = [x.series_u95 / x.mean for x in statistics]  # of one sign in both
        u95 = ratio * math.hypot(*own_shares, common[1] - common[0])
        k_wet_u95 = u95 / ratio**2
    axles = sorted({a.axle for s in of_wet for a in s.axles})
    rows = tuple(_wsp_axle(of_wet, x) for x in axles)
    drops = [s.reservoir_drop_pa for s in of_wet if s.reservoir_drop_pa is not None]
    air = volume * float(np.mean(drops)) / NORMAL_PRESSURE if drops and volume else None
    sanding = [s.sanding_s for s in of_wet if s.sanding_s is not None]
    sanded = float(np.mean(sanding)) if sanding else None
    in_doubt = any(s.vehicle_in_doubt for s in stops if s.group == wet and s.stop.valid)
    of_ratio = extension, u95, k_wet, k_wet_u95
    return WspSummary(wet, dry, *of_ratio, rows, air, sanded, in_doubt)


def wet_speeds(
    stops: Sequence[SeriesStop], dry: str, wet: str
) -> tuple[list[float], list[float]] | None:
    """The speeds of two groups [km/h], of their valid stops; None where they can be compared.

    These are the nominal speeds. Where both groups have the same one, they are the mean speeds, if
    these differ by more than `_SAME_SPEED`.
    """
    of_groups = [[s.stop for s in stops if s.group == n and s.stop.valid] for n in (dry, wet)]
    of_dry, of_wet = (sorted({s.nominal_speed_kmh for s in x}) for x in of_groups)
    if not of_dry or not of_wet:
        return None
    if of_dry != of_wet or len(of_dry) > 1:
        return of_dry, of_wet
    speeds = [[s.initial_speed_mps.value for s in x if s.initial_speed_mps] for x in of_groups]
    if not all(speeds):
        return None
    dry_mean, wet_mean = (3.6 * float(np.mean(x)) for x in speeds)
    if abs(wet_mean / dry_mean - 1.0) < _SAME_SPEED:
        return None
    return [round(dry_mean, 1)], [round(wet_mean, 1)]


def braked_weight_percentage(nominal_speed: float, distance: Measured) -> Measured | None:
    """λ [%] by a stopping distance [m] from a nominal speed [km/h]; None for another speed.

    Source: constants as quoted by secondary literature on UIC 544-1, which is not public.
    """
    if (constants := BRAKED_WEIGHT.get(round(nominal_speed))) is None:
        return None
    quotient = constants[0] / distance.value
    u95, common_u95 = (quotient * x / distance.value for x in distance[1:])
    return Measured(quotient - constants[1], u95, common_u95)


def _braked_length(stop: StopSummary, response: float) -> Measured | None:
    """Distance after the response time over that of the same speed squared [s²].

    Where slides hide the response of the stop, that of others stands for it. Both begin at the same
    command, so what the dead time before it may be does not count.
    """
    if stop.distance_m is None or stop.initial_speed_mps is None:
        return None
    if a := stop.equivalent_deceleration:
        scale = 0.5 / a.value**2
        return Measured(0.5 / a.value, scale * a.u95, scale * a.common_u95)
    s, v0 = stop.distance_m, stop.initial_speed_mps.value
    dead_time = sum(2.0 * c.distance_m for c in stop.budget if c.source == "dead time")
    u95, common = (math.sqrt(max(x**2 - dead_time**2, 0.0)) / v0**2 for x in s[1:])
    own_response = stop.response_time_s.value if stop.response_time_s else response
    return Measured((s.value - v0 * own_response) / v0**2, u95, common)


def _wsp_axle(stops: Sequence[StopSummary], axle: int) -> AxleStop:
    rows = [a for s in stops for a in s.axles if a.axle == axle]

    def values(name: str) -> list[float]:
        return [x for a in rows if (x := getattr(a, name)) is not None]

    initial = _statistic(
        [
            Measured(a.initial_coefficient, u95, u95)  # one vehicle: its errors are common
            for a in rows
            if a.initial_coefficient is not None and (u95 := a.initial_coefficient_u95) is not None
        ]
    )
    utilisation, utilisation_ci = _mean_utilisation(rows)
    bands = [a.slip_bands for a in rows if a.slip_bands]
    largest: dict[str, Any] = {name: max(values(name), default=None) for name in _LARGEST}
    slip, slip_u95 = largest_slip(rows)
    return AxleStop(
        axle=axle,
        valve_actions=sum(a.valve_actions for a in rows),
        slip_bands=tuple(np.mean(bands, axis=0).tolist()) if bands else None,
        initial_coefficient=initial and initial.mean,
        initial_coefficient_u95=initial and initial.u95,
        utilisation=utilisation,
        utilisation_ci=utilisation_ci,
        valves_from=rows[0].valves_from,
        rolling_u95=float(np.mean(errors)) if (errors := values("rolling_u95")) else None,
        at_least=any(a.at_least for a in rows),
        max_slip=slip,
        max_slip_u95=slip_u95,
        **largest,
    )


_LARGEST = ("locked_s", "longest_lock_s", "energy_j", "lock_energy_j", "vented_s")


def _mean_utilisation(
    rows: Sequence[AxleStop],
) -> tuple[float, tuple[float, float]] | tuple[None, None]:
    """Mean utilisation of an axle's stops, with its 95 % interval.

    The errors of the stops are taken as common; the scatter between the stops adds to them.
    """
    utilisations = [(a.utilisation, *a.utilisation_ci) for a in rows if a.utilisation_ci]
    if not utilisations:
        return None, None
    values, lowers, uppers = np.array(utilisations).T
    mean, n = float(np.mean(values)), len(utilisations)
    scatter = _student(n - 1) * float(np.std(values, ddof=1)) / math.sqrt(n) if n > 1 else 0.0
    lower, upper = float(np.mean(values - lowers)), float(np.mean(uppers - values))
    interval = mean - math.hypot(lower, scatter), mean + math.hypot(upper, scatter)
    return mean, (max(interval[0], 0.0), min(interval[1], 1.0))
