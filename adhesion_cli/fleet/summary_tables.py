"""The summary of a fleet as tables of text, for the screen and for a page."""

from collections.abc import Callable, Sequence
from datetime import datetime
from math import inf, nan

from ..core.finding import catalogue
from ..results.report.campaign import Bar, Bars, Campaign
from ..results.text_tables import DASH, TitledTable, bounded_number, energy_text, number, slip_text
from .summary import Distribution, FleetSummary, SlidApplication, StopGroup

_OF_SPREAD = (
    "number: brake applications, counted per axle. slid: those with a slide. 5 %, median, 95 %: "
    "percentiles of the mean adhesion coefficient of each brake application. median slid: the "
    "median of those with a slide. ±: median expanded uncertainty (95 %) of one of these "
    "coefficients. Most of it is that of the vehicle, the same in all of them."
)
_OF_SLIDES = (
    "One row per brake application. at: begin of its first slide after the start of the log. km: "
    "place of that on the line. km/h: speed where braking began. slid and [m]: time and distance "
    "of all its slides. kJ: energy of friction between wheel and rail."
)
_OF_STOPS = (
    "valid: whole stops. Distance and response time are medians of these; 5 %, median, 95 %: "
    "percentiles of their mean deceleration."
)
_SPEEDS = "Mean adhesion coefficient by mean speed of the application"
_STOPS = "Stops of the train by nominal speed"
_WORST = "Worst slides (distance times largest slip)"
_FINDINGS = "Findings on the data"
DAYS = 14  # that a summary shows
PLACES = 20  # kilometres that a summary shows
_DAY = 86_400_000.0  # [ms]
_BAND = 40.0  # width of the fastest speed band in a figure; it has no upper end [km/h]
_Place = tuple[str, float, float]  # what a bar is called, where it begins and ends


def head(fleet: FleetSummary) -> str:
    """How many logs and brake applications there are."""
    counts = fleet.logs
    return (
        f"{sum(counts.values())} logs: {counts['ok']} ok, {counts['damaged']} damaged, "
        f"{counts['error']} failed; {fleet.applications} brake applications of an axle"
    )


def tables(fleet: FleetSummary) -> list[TitledTable]:
    """Adhesion by speed, settings and day, the worst slides, the findings; those with rows."""
    days = fleet.by_day
    places = fleet.by_km_and_hour
    timed = places if any(x.group["hour"] is not None for x in places) else []
    scope = f", last {DAYS} of {len(days)} days" if len(days) > DAYS else ""
    speeds = [{"speed [km/h]": _speeds(row), **_spread(row)} for row in fleet.by_speed]
    vehicles = [
        {"settings": row.group["settings"], "vehicle": row.group["stated"], **_spread(row)}
        for row in fleet.by_settings
    ]
    newest_days = [{**row.group, **_spread(row)} for row in days[-DAYS:]]
    slid = list(map(_slid, fleet.worst_slides))
    if all(row["km"] == DASH for row in slid):
        slid = [{name: cell for name, cell in row.items() if name != "km"} for row in slid]
    codes = [
        {"finding": x.code, "severity": x.severity, "example": x.example, "logs": str(x.logs)}
        for x in fleet.findings
    ]
    settings = {row.group["settings"]: float(i) for i, row in enumerate(fleet.by_settings)}

    def by_settings(row: Distribution) -> _Place:
        name = row.group["settings"]
        return name, settings[name], settings[name] + 1.0

    of_speed = _bars(fleet.by_speed, "mean speed of the brake application [km/h]", _by_speed)
    of_settings = _bars(fleet.by_settings, "settings", by_settings)
    of_days = _bars(days, "day of the log's start (UTC), every day", _by_day)
    of_km = _bars(fleet.by_km, "position on the line [km]", _by_km)
    by_km = [{"km": str(row.group["km"]), **_spread(row)} for row in _most_slides(fleet.by_km)]
    by_hour = list(map(_km_and_hour, _most_slides(timed)))
    all_tables = (
        TitledTable(_SPEEDS, speeds, figure=of_speed, note=_OF_SPREAD),
        TitledTable(
            "By settings", vehicles, 2, figure=of_settings and of_settings._replace(named=True)
        ),
        TitledTable(f"By day{scope}", newest_days, figure=of_days and of_days._replace(dated=True)),
        TitledTable(f"By kilometre{_scope(fleet.by_km)}", by_km, figure=of_km),
        TitledTable(f"By kilometre, day and hour (UTC){_scope(timed)}", by_hour, 3),
        TitledTable(_STOPS, list(map(_stopped, fleet.stops)), note=_OF_STOPS),
        TitledTable(_WORST, slid, note=_OF_SLIDES),
        TitledTable(_FINDINGS, codes, 3),
    )
    return [table for table in all_tables if table.rows]


def campaign(name: str, fleet: FleetSummary) -> Campaign:
    """The page of a folder of results; `name` is that of the folder."""
    page_tables = [*(_on_page(table, fleet) for table in tables(fleet)), *lists(fleet)]
    codes = list(dict.fromkeys(_all_codes(fleet)))
    origin = {
        "Evaluated by": ", ".join(f"adhesion {v}" for v in fleet.evaluated.versions),
        "Results written (UTC)": " to ".join(dict.fromkeys(fleet.evaluated.days)),
        "Settings": "; ".join(": ".join(row.group.values()) for row in fleet.by_settings),
    }
    return Campaign(name, verdict(fleet), head(fleet), page_tables, codes, origin)


def verdict(fleet: FleetSummary) -> str:
    """How often a wheel slid, and how many logs cannot be trusted, in one line."""
    logs, applications = fleet.logs, fleet.applications
    slid = f"A wheel slid in {fleet.with_slides} of {applications} brake applications of an axle."
    return (
        f"{slid if applications else 'No brake application.'} Of {sum(logs.values())} logs, "
        f"{logs['error']} failed, {logs['damaged']} damaged, {fleet.in_doubt} in doubt."
    )


def lists(fleet: FleetSummary) -> list[TitledTable]:
    """Failed logs with error and hint, and those whose numbers are doubtful; those with rows."""
    failed = [{k: str(v) for k, v in row.items()} for row in fleet.failed]
    check = [
        {"log": row.log, "severity": row.severity, "finding": _title(row.code), "what": row.message}
        for row in fleet.to_check
    ]
    all_lists = (
        TitledTable("Failed logs", failed, 3),
        TitledTable(
            "Damaged logs and suspect units", check, 4, links=_links(fleet), marked="severity"
        ),
        TitledTable("Damaged or missing results", [{"log": log} for log in fleet.lost], 1),
    )
    return [table for table in all_lists if table.rows]


def _on_page(table: TitledTable, fleet: FleetSummary) -> TitledTable:
    """A table as the page has it: with titles of findings, and marks of doubtful logs."""
    if table.title == _FINDINGS:
        rows = [{**row, "finding": _title(row["finding"])} for row in table.rows]
        return table._replace(rows=rows, links=_links(fleet))
    if table.title == _WORST:
        doubt = {row.log: _title(row.code) for row in reversed(fleet.to_check)}
        rows = [{**row, "doubtful": doubt.get(row["log"], "")} for row in table.rows]
        if any(row["doubtful"] for row in rows):
            return table._replace(rows=rows, links=_links(fleet), marked="doubtful")
    return table


def _title(code: str) -> str:
    entry = catalogue().get(code)
    return entry.title if entry else code


def _links(fleet: FleetSummary) -> dict[str, str]:
    """Places of the explanations, by title."""
    return {_title(code): f"#finding-{code}" for code in _all_codes(fleet)}


def _all_codes(fleet: FleetSummary) -> list[str]:
    return [x.code for x in fleet.findings] + [x.code for x in fleet.to_check]


def _speeds(row: Distribution) -> str:
    lower, upper = row.group.values()
    return f"{lower:.0f} to {upper:.0f}" if upper else f"from {lower:.0f}"


def _spread(row: Distribution) -> dict[str, str]:
    return {
        "number": str(row.applications),
        "slid": str(row.with_slides),
        "5 %": number(row.p5, 3),
        "median": number(row.median, 3),
        "95 %": number(row.p95, 3),
        "median slid": number(row.median_with_slides, 3),
        "±": number(row.u95, 3),
    }


def _by_speed(row: Distribution) -> _Place:
    lower, upper = row.group.values()
    upper = upper or lower + _BAND
    return f"{lower:g} to {upper:g}", lower, upper


def _by_day(row: Distribution) -> _Place | None:
    if (day := row.group["day"]) == "unknown":
        return None
    noon = 1e3 * datetime.fromisoformat(f"{day}T12:00:00Z").timestamp()
    return day, noon - _DAY / 2, noon + _DAY / 2


def _by_km(row: Distribution) -> _Place:
    km = row.group["km"]
    return f"{km} to {km + 1}", km, km + 1.0


def _bars(
    rows: Sequence[Distribution], label: str, place: Callable[[Distribution], _Place | None]
) -> Bars | None:
    """The figure of the rows that have a place; None if there is nothing to compare in it."""
    bars = []
    for row in rows:
        if row.median is not None and (name_and_place := place(row)):
            values = row.p5, row.median, row.p95, row.median_with_slides
            lower, middle, upper, slid = (nan if x is None else x for x in values)
            bars.append(Bar(*name_and_place, lower, middle, upper, slid, row.applications))
    return Bars(label, bars) if len(bars) > 1 else None


def _most_slides(rows: Sequence[Distribution]) -> list[Distribution]:
    """Places, those with the most slides first and then those with the lowest adhesion."""

    def severity(row: Distribution) -> tuple[int, float]:
        return -row.with_slides, inf if row.p5 is None else row.p5

    return sorted(rows, key=severity)[:PLACES]


def _scope(rows: Sequence[Distribution]) -> str:
    """How many of the places a table has."""
    return f", {PLACES} of {len(rows)}, most slides first" if len(rows) > PLACES else ""


def _km_and_hour(row: Distribution) -> dict[str, str]:
    km, day, hour = row.group.values()
    clock = DASH if hour is None else f"{hour:02d}"
    return {"km": str(km), "day": day, "hour": clock, **_spread(row)}


def _stopped(row: StopGroup) -> dict[str, str]:
    return {
        "speed [km/h]": f"{row.nominal_speed_kmh:g}",
        "stops": str(row.stops),
        "valid": str(row.valid),
        "distance [m]": number(row.distance_median_m, 0),
        "a 5 % [m/s²]": number(row.deceleration_p5, 2),
        "median": number(row.deceleration_median, 2),
        "95 %": number(row.deceleration_p95, 2),
        "response [s]": number(row.response_median_s, 2),
    }


def _slid(row: SlidApplication) -> dict[str, str]:
    return {
        "log": row.log,
        "axle": str(row.axle),
        "at [s]": number(row.slide_start_s, 1),
        "km": number(row.slide_position_km if row.position_from == "position" else None, 3),
        "km/h": number(row.from_mps and 3.6 * row.from_mps, 0),
        "slid [s]": bounded_number(row.slide_s, 1, row.at_least),
        "[m]": bounded_number(row.slide_distance_m, 0, row.at_least),
        "max slip [%]": slip_text(row.max_slip, row.at_least),
        "kJ": energy_text(row.slide_energy_j, row.slide_energy_u95_j, row.at_least),
    }
