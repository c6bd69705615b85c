"""Stops of the whole train, and their statistics, as rows of text."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path

from ..core.summary import AxleStop, StopSummary
from ..core.text import by_uncertainty, enumerated
from ..stops import series
from ..stops.axle_stops import SLIP_BANDS
from ..stops.measure import SPEED_GAP
from ..stops.series import QUANTITIES, SeriesStop, StopSeries
from . import text_tables
from .text_tables import DASH, ED, TitledTable, number, with_u95

_NOTE = (
    "One row per stop of the whole train, from the command to standstill, with expanded "
    "uncertainties (95\N{NO-BREAK SPACE}%)."
)
_OF_COLUMNS = {
    "a [m/s²]": "a: mean deceleration v0²/(2s).",
    "a equiv.": "a equiv. [m/s²]: without the response time, which is delay and half of the "
    "build-up. With a slow build-up it is some percent above every deceleration of the train.",
    "level [m]": "level: distance on level track from the nominal speed.",
    "p [bar]": "p: full pressure of the brake cylinders, mean of the axles.",
}
_OF_GROUPS = (
    "Means of the valid stops with expanded uncertainties (95\N{NO-BREAK SPACE}%). sd: standard "
    "deviation of one stop; common: the part of the uncertainty that is the same in every stop and "
    "does not average out; scatter: range over mean; drift: change from stop to stop; outliers: "
    "stops that Grubbs' test rejects, two-sided. It also rejects a sound stop in about one of 20 "
    "groups. µ is computed with one brake force for all stops of a group. So a friction that "
    "changes from stop to stop does not show in sd and drift of µ, but in those of a equiv."
)
_OF_WIDE_INTERVALS = (
    " Of two or three stops the intervals are wide: more stops of the group narrow them."
)
_EQUIVALENT = "equivalent_deceleration"
_OF_RESPONSE = (
    "Means of the axles. dead time: from the command to the first rise of a cylinder. delay: from "
    "the command to the start share of the full brake (10 %, or `stops.start_share`). build-up: "
    "from there to 95 %. response: delay and half of the build-up."
)
_OF_NO_RESPONSE = (
    " No response: a slide or its protection acts in the build-up, or another brake does and the "
    "speed does not show the response."
)
_OF_LIMITS = (
    "pass, fail: the whole interval keeps or breaks the limit; else undecided (JCGM 106). stops: "
    "the same of each stop by its own interval."
)
_NO_VALUE = "no value"
_OF_NO_VALUE = f"{_NO_VALUE}: no valid stop of the group has the quantity."
_OF_LAMBDA = (
    "λ = C/s − D by constants of a secondary source, for the distance on level track from the "
    "nominal speed. They agree with SUBSET-026, A.3.7 within 1 % at 160 to 200 km/h and 6 % at "
    "140 km/h, not at 100 to 120 km/h. -: no constants for that nominal speed."
)
_OF_BUDGET = (
    "Change of the distance by one standard uncertainty of each source. *: the same in every stop. "
    "The gradient changes the distance on level track only."
)
_OF_WSP = (
    "max slip, locked, energy: the largest of the stops; valve actions: of all stops. initial µ: "
    "mean over 0.1 s from the begin of the first slide, mean of the stops, with expanded "
    "uncertainty (95\N{NO-BREAK SPACE}%). used: mean µ of the slides over the highest that the "
    "rail gives; its 95\N{NO-BREAK SPACE}% interval holds noise, tolerances of the vehicle, and "
    "other shapes of the slip-adhesion curve. -: no slide, or the slides do not show it. ≥: at "
    "least, since the train speed may be wrong. energy: its relative uncertainty, which is not "
    "shown, is at least that of µ. slip a–b %: share of the time above 10 km/h with a slip of a "
    "to b %, in %. All below 5 % is in the first. Its uncertainty is that by noise and delay of "
    "the speeds, and at least 1\N{NO-BREAK SPACE}%."
)
_OF_DOUBT = (
    f"{text_tables.DOUBT}: the log contradicts its vehicle. µ, initial µ and energy may be wrong "
    "with it. The findings say more."
)
_OF_EQUIVALENT = (
    "A limit of a equiv. may be kept by a train that never decelerates so hard: compare a, its "
    "mean deceleration."
)
_NO_JERK = (
    "No jerk: the speed has fewer than 4 readings a second there, the stop is shorter than 2 s, or "
    "all wheels slide."
)
_FEW_STOPS = 4  # of a group: Student's factor is 4.3 or more below
_SAME_BRAKING = 1.1  # full pressures of a group that differ by a larger factor are reported
_WSP = "Wheel slide protection"
_COMMAND = {
    "channel": "a command channel",
    "brake_pipe": "the fall of the brake pipe",
    "pressure": "the first rise of a cylinder pressure",
    "deceleration": "the begin of the deceleration",
}
_OF_DEAD_TIME = (
    " The time from the command to the first rise is in the uncertainty; `stops.dead_time` states "
    "a measured one."
)
_BY_SPEED = (
    " Response where another brake acts, or other cars brake later: by the deceleration, where the "
    "line of the speed at established deceleration meets the speed at the command."
)
_SPEED = {"train": "the train speed", "axles": "the axles, as no train speed is logged"}
_OF_GAPS = "; where that is missing for some time, of wheels that roll"
_BOTH_SPEEDS = "the train speed; where none is logged, the axles"


OF_ED = "ED: share of the electrodynamic brake in the brake work; the air brake has the rest."
SHORT = (
    "at [s]",
    "clock",
    "km",
    "v0 [km/h]",
    "distance [m]",
    "a [m/s²]",
    "a equiv.",
    "response [s]",
    "level [m]",
    ED,
)


def short_row(s: StopSummary) -> dict[str, str]:
    """The figures of a stop that a first screen has room for."""
    return {name: cell for name, cell in stop_row(s).items() if name in SHORT}


def stop_row(s: StopSummary) -> dict[str, str]:
    """A stop: when, from which speed, distance, deceleration, response."""
    return {
        "at [s]": number(s.start_s, 1),
        **text_tables.when_and_where(s.time, s.kilometre),
        "v0 [km/h]": with_u95(s.initial_speed_mps, 3.6, 1),
        "distance [m]": with_u95(s.distance_m, 1.0, 1),
        "time [s]": with_u95(s.duration_s, 1.0, 2),
        "p [bar]": number(s.pressure_bar, 2),
        "a [m/s²]": with_u95(s.mean_deceleration, 1.0, 3),
        "a equiv.": with_u95(s.equivalent_deceleration, 1.0, 3),
        "response [s]": with_u95(s.response_time_s, 1.0, 2),
        "jerk [m/s³]": with_u95(s.jerk, 1.0, 2),
        "level [m]": with_u95(s.corrected_distance_m, 1.0, 1),
        "µ": text_tables.coefficient_text(s.coefficient, s.other_brake),
        **({ED: with_u95(s.ed_share, 100.0, 0)} if s.ed_share else {}),
    }


def describe_columns(rows: Sequence[Mapping[str, str]]) -> str:
    """What the columns of a table of stops mean."""
    notes = [text for name, text in _OF_COLUMNS.items() if any(name in row for row in rows)]
    return " ".join([_NOTE, *notes])


def describe_sources(stops: Sequence[StopSummary]) -> str:
    """What showed command and speed of the stops."""
    commands = " or ".join(_COMMAND[x] for x in dict.fromkeys(s.command_from for s in stops))
    sources = {s.speed_from for s in stops}
    speeds = _BOTH_SPEEDS if len(sources) > 1 else "".join(_SPEED[x] for x in sources)
    nominal = ", ".join(f"{v:g}" for v in sorted({s.nominal_speed_kmh for s in stops}))
    ed = f" {OF_ED}" if any(s.ed_share for s in stops) else ""
    dead_time = _OF_DEAD_TIME * any(s.command_from == "pressure" for s in stops)
    by_speed = _BY_SPEED * any(s.response_from == "deceleration" for s in stops)
    nominal_text = f"Nominal speed: {nominal} km/h."
    is_filled = any(x.source == SPEED_GAP and x.distance_m for s in stops for x in s.budget)
    speeds += _OF_GAPS * is_filled
    return f"Command: {commands}.{dead_time} Speed: {speeds}. {nominal_text}{by_speed}{ed}"


def describe_reasons(stops: Sequence[StopSummary]) -> str:
    """Why stops have no distance; "" where all have one."""
    reasons = dict.fromkeys(str(stop.reason) for stop in stops if not stop.valid)
    return f"Without a distance: no whole stop ({', '.join(reasons)})." if reasons else ""


def series_tables(x: StopSeries, braked_weight: bool, budget: bool) -> list[TitledTable]:
    """The tables of a series with rows; those of `braked_weight` and `budget` on request."""
    stops = x.stops
    in_order = [s.stop for s in stops]
    rows = _series_rows(stops)
    notes = [describe_columns(rows), describe_sources(in_order), *_remarks(stops)]
    note = "\n".join(filter(None, [*notes, text_tables.describe_cells(rows)]))
    of_groups = _OF_GROUPS if any(g.n > 1 for g in x.groups) else ""
    of_groups += _OF_WIDE_INTERVALS * any(1 < g.n < _FEW_STOPS for g in x.groups)
    tables = [
        TitledTable("Stops", rows, [*rows[0]].index("at [s]") if rows else 2, note),
        _response_table(stops),
        TitledTable("Statistics", _group_rows(x.groups), 2, of_groups),
        TitledTable("Differences", _difference_rows(x.differences), 3),
        TitledTable("Limits", _limit_rows(x), 3, _limits_note(x)),
        *map(_wsp_table, x.wsp),
    ]
    if braked_weight:
        tables.append(TitledTable("Braked weight", _braked_weight_rows(stops), 2, _OF_LAMBDA))
    if budget:
        rows = _budget_rows(stops)
        tables.append(TitledTable("Uncertainty of the distance", rows, 2, _OF_BUDGET))
    return [table for table in tables if table.rows or table.title == _WSP]


def _series_rows(stops: Sequence[SeriesStop]) -> list[dict[str, str]]:
    has_logs = len({s.log for s in stops}) > 1
    is_mixed = len({s.stop.command_from for s in stops}) > 1
    rows = [
        {"stop": str(i)}
        | ({"log": Path(s.log).name} if has_logs else {})
        | {"group": s.group}
        | ({"command": s.stop.command_from.replace("_", " ")} if is_mixed else {})
        | stop_row(s.stop)
        for i, s in enumerate(stops, 1)
    ]
    for row, s in zip(rows, stops, strict=True):
        row["µ"] = text_tables.doubted(row["µ"], s.vehicle_in_doubt)
    return text_tables.non_empty(rows)


def _response_table(stops: Sequence[SeriesStop]) -> TitledTable:
    """Delay and build-up of each stop that has them."""
    rows = [
        {
            "stop": str(i),
            "group": s.group,
            "dead time [s]": with_u95(s.stop.dead_time_s, 1.0, 2),
            "delay [s]": with_u95(s.stop.delay_s, 1.0, 2),
            "build-up [s]": with_u95(s.stop.build_up_s, 1.0, 2),
            "response [s]": with_u95(s.stop.response_time_s, 1.0, 2),
        }
        for i, s in enumerate(stops, 1)
        if s.stop.delay_s
    ]
    is_undefined = any(row["response [s]"] == DASH for row in rows)
    note = _OF_RESPONSE + _OF_NO_RESPONSE * is_undefined
    return TitledTable("Response of the brakes", text_tables.non_empty(rows), 2, note)


def _remarks(stops: Sequence[SeriesStop]) -> list[str]:
    """What must be known of a stop: that it is none, its slides, a distance by another formula."""
    sentences = []
    for i, s in enumerate(stops, 1):
        if not s.stop.valid:
            sentences.append(f"Stop {i} is not valid: {s.stop.reason}.")
        if events := _describe_slides(s.stop):
            sentences.append(f"Stop {i}: {events}.")
        level, energy = s.measured("corrected_distance_m"), s.measured("energy_distance_m")
        between = level.value - energy.value if level and energy else 0.0
        if level and energy and 7.0 * between**2 > 3.0 * level.u95**2:  # U² has 4/3 of its square
            text = with_u95(energy, 1.0, 1)
            sentences.append(f"Stop {i}: {text} m on level track without its response time.")
    if any(s.stop.valid and s.stop.jerk is None for s in stops):
        sentences.append(_NO_JERK)
    labels = dict.fromkeys((s.group, s.label) for s in stops if s.label)
    sentences += [f"Group {group}: {label}." for group, label in labels]
    for group in dict.fromkeys(s.group for s in stops):
        sentences += _describe_mixture(group, [s.stop for s in stops if s.group == group])
    if any(s.vehicle_in_doubt and s.stop.coefficient for s in stops):
        sentences.append(_OF_DOUBT)
    return sentences


def _describe_mixture(group: str, stops: Sequence[StopSummary]) -> Iterator[str]:
    """What differs between the valid stops of a group, so that a mean says little."""
    valid = [stop for stop in stops if stop.valid]
    bar = [x.pressure_bar for x in valid if x.pressure_bar and not x.slides] or [0.0]
    if max(bar) > _SAME_BRAKING * min(bar):
        yield (
            f"Group {group} mixes stops of {min(bar):.2f} to {max(bar):.2f} bar: its means are "
            "of different brakings."
        )
    speeds = [f"{v:g}" for v in sorted({x.nominal_speed_kmh for x in valid})]
    if len(speeds) > 1:
        yield (
            f"Group {group} mixes nominal speeds of {enumerated(speeds)} km/h: its means are of "
            "different stops."
        )
    if len({x.command_from for x in valid}) > 1:
        yield (
            f"Group {group} mixes commands that are shown in different ways (column command): its "
            "times and distances begin at different moments, and all are as uncertain as the worst."
        )


def _describe_slides(stop: StopSummary) -> str:
    """Slides and sanding of a stop; "" without them."""
    events = []
    if stop.slides:
        text = f"{stop.slides} slide{'s' * (stop.slides > 1)}"
        if slid := [a for a in stop.axles if a.max_slip is not None]:
            a = max(slid, key=lambda a: a.max_slip or 0.0)
            slip = text_tables.slip_text(a.max_slip, any(x.at_least for x in slid), a.max_slip_u95)
            text += f", largest slip {slip} % (axle {a.axle})"
        locks = {a.axle: a.longest_lock_s for a in stop.axles if a.longest_lock_s}
        if locks:
            axle = max(locks, key=lambda axle: locks[axle])
            text += f", a wheel of axle {axle} locked for {locks[axle]:.1f} s"
        events.append(text)
    if stop.sanding_s:
        events.append(f"sand for {stop.sanding_s:.1f} s")
    return "; ".join(events)


def _group_rows(groups: Sequence[series.Group]) -> list[dict[str, str]]:
    rows = []
    for group in groups:
        if group.n == 1:
            rows.append({"group": group.name, "quantity": "one stop", "n": "1"})
            continue
        for quantity, x in group.statistics.items():
            name, factor = _named(quantity)
            row = {
                "group": group.name,
                "quantity": name,
                "n": str(x.n),
                "mean": with_u95((x.mean, x.u95), factor),
                "sd": _uncertainty(x.sd and factor * x.sd),
                "common": _uncertainty(factor * x.common_u95),
                "scatter [%]": number(100.0 * x.scatter if x.n > 1 else None, 1),
                "drift": with_u95((x.drift, x.drift_u95), factor) if x.drift_u95 else DASH,
                "outliers": ", ".join(map(str, x.outliers)) or "-",
            }
            rows.append(row)
    return [{name: row.get(name, DASH) for name in text_tables.columns_of(rows)} for row in rows]


def _uncertainty(x: float | None) -> str:
    """An uncertainty alone, with the digits that it has behind a value."""
    return DASH if x is None else by_uncertainty(0.0, x)[1]


def _difference_rows(differences: Sequence[series.GroupDifference]) -> list[dict[str, str]]:
    rows = []
    for x in differences:
        name, factor = _named(x.quantity)
        change = with_u95((x.value, x.u95), factor)
        differs = "yes" if x.distinguishable else "not distinguishable"
        row = {"from": x.from_group, "to": x.to_group, "quantity": name, "change": change}
        rows.append(row | {"[%]": number(100.0 * x.share, 1), "differs": differs})
    return rows


def _limits_note(x: StopSeries) -> str:
    has_equivalent = any(verdict.quantity == _EQUIVALENT for verdict in x.limits)
    has_all = all(verdict.value is not None for verdict in x.limits)
    notes = _OF_LIMITS, "" if has_all else _OF_NO_VALUE, _OF_EQUIVALENT if has_equivalent else ""
    return " ".join(filter(None, notes))


def _limit_rows(series: StopSeries) -> list[dict[str, str]]:
    """Each limit with its verdict; one of the equivalent deceleration with the mean one."""
    means = {group.name: group.statistics.get("mean_deceleration") for group in series.groups}
    rows = []
    for x in series.limits:
        name, unit = QUANTITIES[x.quantity]
        row = {"group": x.group, "quantity": f"{name} [{unit}]", "limit": f"{x.kind} {x.limit:g}"}
        row["mean"] = _NO_VALUE if x.value is None else with_u95((x.value, x.u95))
        if x.quantity == _EQUIVALENT and (mean := means.get(x.group)):
            row["a [m/s²]"] = with_u95((mean.mean, mean.u95))
        row |= {"verdict": x.verdict, "stops": _describe_stops(x)}
        rows.append(row | ({"limit of": x.source} if x.source else {}))
    return text_tables.non_empty(rows)


def _describe_stops(x: series.LimitVerdict) -> str:
    """How many stops keep a limit, and how many do not."""
    counts = {"pass": x.stops_pass, "fail": x.stops_fail, "undecided": x.stops_undecided}
    return ", ".join(f"{n} {verdict}" for verdict, n in counts.items() if n) or DASH


def _wsp_table(x: series.WspSummary) -> TitledTable:
    """The axles of the wet stops below their extension, in one sentence."""
    head = f"WSP, group {x.group} against {x.dry}: "
    if x.extension is None or x.extension_u95 is None:
        head += "extension not known: dry or wet stops are missing, or their speeds differ."
    else:
        extension, u95 = by_uncertainty(100.0 * x.extension, 100.0 * x.extension_u95, 1)
        head += f"extension of the deceleration distance {extension} ± {u95} %, "
        head += f"K_wet {with_u95((x.k_wet, x.k_wet_u95), 1.0, 3)} (SUBSET-040, 4.4.1.5)."
    if x.air_nl is not None:
        head += f" Air: {x.air_nl:.0f} Nl in a stop, by the reservoir."
    if x.sanding_s is not None:
        head += f" Sanding: {x.sanding_s:.1f} s in a stop."
    rows = _wsp_rows(x)
    notes = [head, *([_OF_WSP, text_tables.describe_cells(rows)] if rows else [])]
    return TitledTable(_WSP, rows, 1, "\n".join(filter(None, notes)))


def _wsp_rows(x: series.WspSummary) -> list[dict[str, str]]:
    return [
        {
            "axle": str(a.axle),
            "max slip [%]": text_tables.slip_text(a.max_slip, a.at_least, a.max_slip_u95),
            "locked [s]": number(a.locked_s, 2),
            "longest": number(a.longest_lock_s, 2),
            "lock [kJ]": number(a.lock_energy_j and 1e-3 * a.lock_energy_j, 1),
            "valve actions": str(a.valve_actions),
            "initial µ": text_tables.doubted(_initial(a), x.vehicle_in_doubt),
            "used [%]": text_tables.share_with_interval(a.utilisation, a.utilisation_ci),
            "energy [kJ]": text_tables.bounded_number(
                a.energy_j and 1e-3 * a.energy_j, 0, a.at_least
            ),
            **_bands(a),
        }
        for a in x.axles
    ]


def _initial(a: AxleStop) -> str:
    """The initial adhesion with its uncertainty; a dash without a slide."""
    value, u95 = a.initial_coefficient, a.initial_coefficient_u95
    return DASH if value is None or u95 is None else text_tables.coefficient_text((value, u95))


def _bands(a: AxleStop) -> dict[str, str]:
    shares = [number(100.0 * x, 0) for x in a.slip_bands or ()] or [DASH] * len(SLIP_BANDS)
    if a.slip_bands and a.rolling_u95 is not None:
        shares[0] = with_u95((a.slip_bands[0], max(a.rolling_u95, 0.01)), 100.0)
    limits = [f"{100.0 * x:g}" for x in (0.0, *SLIP_BANDS)]
    return {
        f"slip {lower}–{upper} %": share
        for (lower, upper), share in zip(pairwise(limits), shares, strict=True)
    }


def _braked_weight_rows(stops: Sequence[SeriesStop]) -> list[dict[str, str]]:
    rows = []
    for i, s in enumerate(stops, 1):
        level = s.measured("corrected_distance_m")
        value = level and series.braked_weight_percentage(s.stop.nominal_speed_kmh, level)
        rows.append({"stop": str(i), "group": s.group, "λ [%]": with_u95(value, 1.0, 0)})
    return rows


def _budget_rows(stops: Sequence[SeriesStop]) -> list[dict[str, str]]:
    """What each source of error adds to the distance of each stop; a star: one for all."""
    sources = {
        c.source: f"{c.source}{'*' * c.common} [m]"
        for s in stops
        for c in s.stop.budget
        if abs(c.distance_m) > 0.0
    }
    rows = []
    for i, s in enumerate(stops, 1):
        if s.stop.valid:
            errors = {c.source: c.distance_m for c in s.stop.budget}
            cells = {head: number(errors.get(x), 2) for x, head in sources.items()}
            rows.append({"stop": str(i), "group": s.group} | cells)
    return rows


def _named(quantity: str) -> tuple[str, float]:
    """The heading of a quantity, and the factor to its unit: speeds are km/h."""
    name, unit = QUANTITIES[quantity]
    return (f"{name} [km/h]", 3.6) if unit == "m/s" else (f"{name} [{unit}]", 1.0)
