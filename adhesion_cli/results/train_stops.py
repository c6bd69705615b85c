"""The brake applications of all axles as stops of the train, and axles as groups of neighbours."""

from collections.abc import Iterable, Mapping, Sequence
from types import MappingProxyType

from ..core.summary import AxleSummary, BrakeApplication
from ..rail.highest import is_known
from . import text_tables
from .text_tables import DASH, number, slip_text, when_and_where

MANY_ROWS = 24  # brake applications of all axles: with more, a table has a row per stop
MANY_AXLES = 8  # with more, an overview has groups of axles
_GROUP = 4  # axles of a car


def slide_severity(a: BrakeApplication) -> tuple[float, ...]:
    """Longest lock, largest slip, time of the slides, mean µ: what makes an application worse."""
    mean = a.coefficient.mean if a.coefficient else 0.0
    return a.longest_lock_s or 0.0, a.max_slip or 0.0, a.slide_s, mean


def find_stops(axles: Iterable[AxleSummary]) -> list[list[BrakeApplication]]:
    """The stops of a log, in the order of time: brake applications that overlap, by their axles."""
    applications = sorted((a for axle in axles for a in axle.applications), key=lambda a: a.start_s)
    stops: list[list[BrakeApplication]] = []
    end = float("-inf")
    for a in applications:
        if a.start_s >= end:
            stops.append([])
            end = a.end_s
        stops[-1].append(a)
        end = max(end, a.end_s)
    return [sorted(stop, key=lambda a: (a.axle, a.start_s)) for stop in stops]


def train_stop_row(applications: Sequence[BrakeApplication]) -> dict[str, str]:
    """A stop: when, how fast, µ of its axles, and the slides of the worst one."""
    worst = max(applications, key=slide_severity)
    slid = [a for a in applications if a.slides]
    coefficients = [a.coefficient for a in applications if a.coefficient]
    mean = mean_range = DASH
    if coefficients:
        values = [x.mean for x in coefficients]
        u95 = max(x.mean_u95 for x in coefficients)  # mostly the vehicle's: one error in all
        value = sum(values) / len(values)
        mean = mean_range = text_tables.NOT_KNOWN
        if is_known(value, u95):
            mean, mean_range = text_tables.with_u95((value, u95), 1.0, 3), _range(values)
    first = min(applications, key=lambda a: a.start_s)
    return {
        "at [s]": number(first.start_s, 1),
        **when_and_where(first.time, first.kilometre),
        "for [s]": number(max(a.end_s for a in applications) - first.start_s, 1),
        "v [km/h]": "–".join(number(v and 3.6 * v, 0) for v in (worst.from_mps, worst.to_mps)),
        "µ mean": mean,
        "µ of axles": mean_range,
        "slid": f"{len({a.axle for a in slid})} of {len({a.axle for a in applications})}",
        "slid [s]": text_tables.bounded_number(worst.slide_s, 1, worst.at_least) if slid else DASH,
        "max slip [%]": _slip(worst) if slid else DASH,
        "axle": str(worst.axle) if slid else DASH,
    }


def _slip(a: BrakeApplication) -> str:
    return slip_text(a.max_slip, a.at_least, a.max_slip_u95)


def _range(values: Sequence[float]) -> str:
    """The lowest and the highest value, once where they are the same."""
    return "–".join(dict.fromkeys(number(f(values), 3) for f in (min, max)))


def group_numbers(
    numbers: Sequence[int], cars: Mapping[int, str] = MappingProxyType({})
) -> list[tuple[str, list[int]]]:
    """Axles by their cars; by fours, as on a car, where no car is stated. Names and numbers.

    >>> group_numbers(range(1, 7))
    [('1–4', [1, 2, 3, 4]), ('5–6', [5, 6])]
    >>> group_numbers([1, 2, 3], {1: "A", 2: "A", 3: "B"})
    [('A (1–2)', [1, 2]), ('B (3)', [3])]
    """
    groups: dict[str, list[int]] = {}
    for i, number_of_axle in enumerate(numbers):
        key = cars.get(number_of_axle) or f"\n{i // _GROUP}"  # no name has a new line
        groups.setdefault(key, []).append(number_of_axle)
    named = []
    for car, axles in groups.items():
        ends = "–".join(dict.fromkeys(str(axle) for axle in (axles[0], axles[-1])))
        named.append((ends if car.startswith("\n") else f"{car} ({ends})", axles))
    return named


def group_axles(
    axles: Sequence[AxleSummary], cars: Mapping[int, str] = MappingProxyType({})
) -> dict[str, list[AxleSummary]]:
    """The axles in the groups of `group_numbers`, by their names."""
    by_number = {axle.axle: axle for axle in axles}
    groups = group_numbers([*by_number], cars)
    return {name: [by_number[number] for number in numbers] for name, numbers in groups}


def group_row(name: str, axles: Sequence[AxleSummary]) -> dict[str, str]:
    """A group of axles over all brake applications."""
    applications = [a for axle in axles for a in axle.applications]
    coefficients = [a.coefficient for a in applications if a.coefficient]
    means = [x.mean for x in coefficients if is_known(x.mean, x.mean_u95)]
    slid = [a for a in applications if a.slides]
    row = {
        "axles": name,
        "brake applications": str(len(applications)),
        "µ mean": _range(means) if means else text_tables.NOT_KNOWN if coefficients else DASH,
        "with slides": str(len(slid)),
    }
    if not slid:
        return row | {"max slip [%]": DASH, "axle": DASH, "at [s]": DASH}
    worst = max(slid, key=slide_severity)
    return row | {
        "max slip [%]": _slip(worst),
        "axle": str(worst.axle),
        "at [s]": number(worst.start_s, 1),
        **when_and_where(worst.time),
    }


def choose_axles(axles: Sequence[AxleSummary]) -> tuple[int, ...]:
    """The axles that a page draws one by one: all, or of many the worst one of each group."""
    if len(axles) <= MANY_AXLES:
        return tuple(axle.axle for axle in axles)
    worst = [max(group, key=_axle_severity) for group in group_axles(axles).values()]
    worst.sort(key=_axle_severity, reverse=True)
    return tuple(sorted(axle.axle for axle in worst[:MANY_AXLES]))


def _axle_severity(axle: AxleSummary) -> tuple[float, ...]:
    return max(map(slide_severity, axle.applications), default=())
