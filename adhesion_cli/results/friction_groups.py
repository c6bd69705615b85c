"""Whether several runs have one brake, by the deceleration that each log shows.

The adhesion of a wheel that rolls is the brake's force. Evaluated with one vehicle, runs with old
and with new pads have the same µ per bar, and a difference of µ is then wrong, even in its sign.
The deceleration per bar needs no vehicle. Runs that differ in it by more than its uncertainty
(95 %) are of different groups.
"""

import math
from collections.abc import Sequence
from pathlib import Path
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ..core.finding import Finding
from ..core.model import Z95, IdentifiedVehicle, LogBrake
from ..core.text import listed, shell_word, stem
from .text_tables import numbered

_FADE = 0.015  # 1 sigma of the change of any friction over speed, relative [s/m]
_LEAST_SURE = 2.0  # of the smallest sigma: a run with more, as one with slides, parts no others
_NAMED = 2  # logs of a group that are named
_BEGIN = 0.2  # 1 sigma of the pressure at which a brake begins [bar]


class GroupedRun(NamedTuple):
    """A run: the path of its log, and its brake, None where it stays in the first group."""

    log: str
    brake: LogBrake | None


def run_of_log(log: str, brake: LogBrake | None, vehicle: IdentifiedVehicle | None) -> GroupedRun:
    """A run, with its brake over that of the first logs: they may have another vehicle."""
    factor = vehicle.factor_of_logs if vehicle else 1.0
    return GroupedRun(log, brake and brake._replace(ratio=brake.ratio * factor))


class FrictionGroup(NamedTuple):
    """Runs with one brake."""

    places: tuple[int, ...]  # of the runs, the first is 1
    factor: float  # brake force per mass and bar over that of the first group
    u95: float  # its expanded uncertainty (95 %)


def group_by_friction(runs: Sequence[GroupedRun]) -> list[FrictionGroup]:
    """The groups of runs with one brake; that of the first run is the first."""
    known_brakes = [(place, run.brake) for place, run in enumerate(runs, 1) if run.brake]
    known_brakes.sort(key=lambda x: (x[1].ratio, x[0]))
    limit = _LEAST_SURE * min((brake.sigma for _, brake in known_brakes), default=0.0)
    certain_runs = [x for x in known_brakes if x[1].sigma <= limit]
    groups = [list(group) for group in _split(certain_runs)] if certain_runs else []
    for lone_run in ([x] for x in known_brakes if x[1].sigma > limit):
        distance, nearest = min(
            (abs(_mean(lone_run) - _mean(group)) / _sigma(group, lone_run), i)
            for i, group in enumerate(groups)
        )
        if distance < Z95:
            groups[nearest] += lone_run
        else:
            groups.append(lone_run)
    groups.sort(key=lambda group: min(place for place, _ in group))
    without_brake = [place for place, run in enumerate(runs, 1) if not run.brake]
    if not groups:
        return [FrictionGroup(tuple(without_brake), 1.0, 0.0)]
    first_run, *_ = groups
    result = []
    for group in groups:
        ratio = math.exp(_mean(group) - _mean(first_run))
        places = sorted([place for place, _ in group] + without_brake * (group is first_run))
        u95 = Z95 * ratio * _sigma(first_run, group) * (group is not first_run)
        result.append(FrictionGroup(tuple(places), ratio, u95))
    return result


def find_friction_differs(
    runs: Sequence[GroupedRun],
    groups: Sequence[FrictionGroup],
    vehicle_files: Sequence[str] = (),
    by_name: bool = False,
) -> list[Finding]:
    """The finding on each group that brakes otherwise than the first; its remedy is commands.

    `vehicle_files` are those of the stated vehicle. `by_name` calls runs by their logs, not by
    their places.
    """
    if len(groups) < 2:
        return []

    def group_name(group: FrictionGroup) -> str:
        logs = [Path(runs[place - 1].log).name for place in group.places]
        places = f"run{'s' * (len(group.places) > 1)} {numbered(group.places)}"
        return listed(logs, _NAMED) if by_name else places

    commands = _commands(runs, groups, vehicle_files)
    return [
        Finding(
            "friction-differs",
            "warning",
            count=len(group.places),
            values={"factor": group.factor, "u95": group.u95},
            names={"runs": group_name(group), "base": group_name(groups[0]), "commands": commands},
        )
        for group in groups[1:]
    ]


_Group = Sequence[tuple[int, LogBrake]]


def _split(group: _Group) -> list[_Group]:
    """The group, in the order of the ratio, cut where the parts differ most, if they differ.

    Of many runs with one brake, the lowest and the highest differ by more than two of them do: the
    fewer runs a part has of all, the larger the coverage factor (Bonferroni).
    """
    best, place = 1.0, 0
    for i in range(1, len(group)):
        fewer = min(i, len(group) - i)
        k = NormalDist().inv_cdf(1.0 - 0.025 * fewer / (len(group) - fewer))
        share = (_mean(group[i:]) - _mean(group[:i])) / (k * _sigma(group[:i], group[i:]))
        if share > best:
            best, place = share, i
    return [*_split(group[:place]), *_split(group[place:])] if place else [group]


def _mean(group: _Group) -> float:
    return float(np.mean([math.log(brake.ratio) for _, brake in group]))


def _sigma(group_a: _Group, group_b: _Group) -> float:
    """1 sigma of the difference of ln of two ratios; gradient and resistance may be one error."""
    sides = [[brake for _, brake in group] for group in (group_a, group_b)]
    speeds = [np.mean([brake.speed_mps for brake in group_files]) for group_files in sides]
    pressures = [[x.pressure_bar for x in group_files if x.pressure_bar] for group_files in sides]
    begin = np.diff([1.0 / np.mean(x) for x in pressures])[0] if all(pressures) else 0.0
    noise = [np.mean([brake.sigma for brake in group_files]) for group_files in sides]
    return math.hypot(*noise, _FADE * (speeds[1] - speeds[0]), _BEGIN * begin)


def _commands(
    runs: Sequence[GroupedRun], groups: Sequence[FrictionGroup], vehicle_files: Sequence[str]
) -> str:
    """A vehicle for each group, and the comparison with them."""
    stated_vehicle = "".join(f" -c {shell_word(file)}" for file in vehicle_files)
    lines, results = [], []
    for number, group in enumerate(groups, 1):
        paths = [runs[place - 1].log for place in group.places]
        logs, brake = " ".join(map(shell_word, paths)), f"brake-{number}"
        lines += [f"adhesion calibrate {logs}{stated_vehicle} -o {brake}.toml"]
        lines += [f"adhesion analyze {logs} -c {brake}.toml -o {brake}"]
        results += [f"{brake}/{stem(path)}.adhesion.mcap" for path in paths]
    report = f"adhesion report {' '.join(map(shell_word, results))} -o compare.html"
    return "\n".join([*lines, report])
