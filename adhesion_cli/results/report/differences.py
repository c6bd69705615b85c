"""Differences between runs with their uncertainty, by JCGM 100 (GUM), 5.2.

Parameters of the vehicle that two runs state alike are one error in both. What it adds to a
difference is its standard uncertainty times the difference of the sensitivities, so that most of it
cancels. Noise is another one in each run. So is friction in another log: by heat and wear, and by
what the decelerations of the two logs differ, which may be by a gradient or by other pads.
"""

import json
import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import NamedTuple

from ...core.finding import Finding
from ...core.model import Z95, Vehicle
from ...core.signals import coverage_factor
from ...core.summary import BrakeApplication
from ...reference.calibrated_vehicle import LOG_TO_LOG
from ...train import longitudinal
from ..carried_vehicle import correlation, is_of_vehicle, parameter
from ..friction_groups import GroupedRun, find_friction_differs, group_by_friction
from .run import ReportAxle, ReportRun

_NOISE = "noise"
_MASS = "axle_mass"
_BY_BRAKE = ("force", "coefficient")  # quantities that the brake of the vehicle scales


class RunDifference(NamedTuple):
    """A quantity of a run less that of the first run; names as in the JSON."""

    run: int  # place of the run, the second is 2
    axle: int  # number
    application: int  # place among the axle's brake applications, the first is 1
    quantity: str  # "force", "coefficient" (means) or "utilisation"
    unit: str  # of the numbers
    difference: float
    u95: float  # expanded uncertainty (95 %), where the runs share what they state alike
    u95_apart: float  # the same where they share nothing, as for two vehicles
    alike: bool  # whether the uncertainty explains the difference


def compare(runs: Sequence[ReportRun]) -> list[RunDifference]:
    """All runs against the first one: brake applications by their order, axles by their number.

    A run with another brake than the first has no difference of force and coefficient: one vehicle
    makes both wrong.
    """
    reference, *others_runs = runs
    differences: list[RunDifference] = []
    other_brake = {
        place for group in group_by_friction(_grouped(runs))[1:] for place in group.places
    }
    for place, run in enumerate(others_runs, 2):
        reference_axles = {axle.number: axle for axle in reference.axles}
        for axle in run.axles:
            if axle.number in reference_axles:
                differences += _of_axle(
                    place, reference_axles[axle.number], axle, run, _brake_change(reference, run)
                )
    return [d for d in differences if d.quantity not in _BY_BRAKE or d.run not in other_brake]


def friction_findings(runs: Sequence[ReportRun]) -> list[Finding]:
    """That runs have different brakes; those of unstated vehicles by the deceleration per bar."""
    sources = {run.summary.vehicle.source for run in runs}
    files = ["my-train.toml"] * ("stated" in sources)
    grouped = _grouped(runs)
    if sources == {"log"}:
        per_bar = [run.brake and run.brake.deceleration_per_bar for run in grouped]
        grouped = [
            run._replace(brake=run.brake._replace(ratio=x)) if run.brake and x else run
            for run, x in zip(grouped, per_bar, strict=True)
        ]
    return find_friction_differs(grouped, group_by_friction(grouped), files)


def _grouped(runs: Sequence[ReportRun]) -> list[GroupedRun]:
    return [GroupedRun(run.summary.log.path, run.summary.brake) for run in runs]


def unpaired(runs: Sequence[ReportRun]) -> bool:
    """Whether a brake application or an axle of a run has none to be compared with."""
    counts = [{a.number: len(a.applications) for a in run.axles} for run in runs]
    return any(count != counts[0] for count in counts)


def settings_apart(run_a: ReportRun, run_b: ReportRun) -> list[str]:
    """The settings that two runs do not have in common, and the version if that differs."""
    a, b = _statements(run_a), _statements(run_b)
    names = [
        ".".join(k.split(".")[:2]) for k in sorted(a.keys() | b.keys()) if a.get(k) != b.get(k)
    ]
    if run_a.provenance.get("version") != run_b.provenance.get("version"):
        names.append("version of the program")
    return list(dict.fromkeys(names))


def same_log(run_a: ReportRun, run_b: ReportRun) -> bool:
    """Whether two runs are of one log."""
    return bool(run_a.summary.log.sha256) and run_a.summary.log.sha256 == run_b.summary.log.sha256


def same_vehicle(run_a: ReportRun, run_b: ReportRun) -> bool:
    """Whether two runs state the same vehicle."""
    a, b = _statements(run_a), _statements(run_b)
    return all(a.get(key) == b.get(key) for key in a.keys() | b.keys() if is_of_vehicle(key))


def _statements(run: ReportRun) -> dict[str, str]:
    """The settings, without what each log adds to the error of the friction that all state."""
    added = (".friction.tolerance", ".correlation.")
    values = {k: v for k, v in run.settings.items() if not any(x in k for x in added)}
    return {
        k: str([x["value"] for x in json.loads(v)]) if k.endswith(".friction") else v
        for k, v in values.items()
    }


def same_statement(run_a: ReportRun, run_b: ReportRun) -> bool:
    """Whether two runs differ by what their logs show of the vehicle that both state."""
    a, b = (run.summary.vehicle for run in (run_a, run_b))
    statements = ((x.source, x.stated_force_per_bar_n, x.stated_u95, x.cars) for x in (a, b))
    share_vehicle = a.source == "stated" and len({*statements}) == 1
    return share_vehicle and a.force_per_bar_n != b.force_per_bar_n


def _brake_change(run_a: ReportRun, run_b: ReportRun) -> float:
    """By how much the brake of two logs may differ beyond their vehicles, as a share (95 %)."""
    if same_log(run_a, run_b):
        return 0.0
    by_wear = Z95 * math.sqrt(2.0) * LOG_TO_LOG[longitudinal.SCALE]
    a, b = run_a.summary.brake, run_b.summary.brake
    return math.hypot(by_wear, math.log(b.ratio / a.ratio)) if a and b else by_wear


def _of_axle(
    place: int, axle_a: ReportAxle, axle_b: ReportAxle, run: ReportRun, brake_change: float
) -> Iterator[RunDifference]:
    pairs = zip(axle_a.applications, axle_b.applications, strict=False)
    for k, (a, b) in enumerate(pairs, 1):
        quantities: list[tuple[str, str, float, float, float]] = []
        if a.force_n and b.force_n and a.coefficient and b.coefficient:
            difference = b.force_n.mean - a.force_n.mean
            by_brake = brake_change * max(abs(a.force_n.mean), abs(b.force_n.mean))
            u95, u95_apart = _of_force(a, b, run, axle_b.number)
            quantities.append(("force", "N", difference, math.hypot(u95, by_brake), u95_apart))
            change = b.coefficient.mean - a.coefficient.mean
            u95_apart = math.hypot(a.coefficient.mean_u95, b.coefficient.mean_u95)
            u95 = u95_apart
            if axle_a.weight == axle_b.weight:
                u95 = _of_force(a, b, run, axle_b.number, by_weight=difference)[0]
                u95 = math.hypot(u95, by_brake) / axle_b.weight
            quantities.append(("coefficient", "-", change, u95, u95_apart))
        if a.utilisation is not None and b.utilisation is not None:
            intervals = (x.utilisation_ci or (0.0, 0.0) for x in (a, b))
            u95 = math.hypot(*(0.5 * (upper - lower) for lower, upper in intervals))
            quantities.append(("utilisation", "-", b.utilisation - a.utilisation, u95, u95))
        for quantity, unit, value, u95, u95_apart in quantities:
            is_explained, widest = abs(value) <= u95, max(u95, u95_apart)
            application = place, axle_b.number, k
            yield RunDifference(*application, quantity, unit, value, u95, widest, is_explained)


def _of_force(
    a: BrakeApplication, b: BrakeApplication, run: ReportRun, axle: int, by_weight: float = 0.0
) -> tuple[float, float]:
    """Expanded uncertainty of a difference of mean forces: with shared parameters, without [N].

    `run` is that of `b`. `by_weight` is the difference [N], if it will be divided by the weight:
    the mass then counts.
    """
    rows = [{row.quantity: row for row in row_a.budget or ()} for row_a in (a, b)]
    shared: dict[str, float] = {}
    independent: list[dict[str, float]] = [{}, {}]
    for name in sorted((rows[0].keys() | rows[1].keys()) - {_NOISE}):
        row_a, row_b = (rows_by_name.get(name) for rows_by_name in rows)
        if row_a and row_b and row_a.value == row_b.value:
            shared[name] = (row_b.sensitivity - row_a.sensitivity) * max(row_a.u, row_b.u)
        else:
            for sensitivities, row in zip(independent, (row_a, row_b), strict=True):
                if row:
                    sensitivities[name] = row.sensitivity * row.u
    if by_weight:
        mass = parameter(run.settings, _MASS, axle)
        shared[_MASS] = shared.get(_MASS, 0.0) - by_weight * mass.tolerance / mass.value
    vehicle = Vehicle(correlation=correlation(run.settings, axle))
    noise = [rows_by_name[_NOISE].contribution_n for rows_by_name in rows]
    covariances = [
        vehicle.covariance(sensitivities, sensitivities) for sensitivities in (shared, *independent)
    ]
    u = math.sqrt(max(sum(covariances), 0.0) + sum(x**2 for x in noise))
    u95_apart = math.hypot(*(x.coverage.u_n for x in (a, b) if x.coverage))
    freedom = [_freedom_of_noise(row_a, x) for row_a, x in zip((a, b), noise, strict=True)]
    return _factor(u, noise, freedom) * u, _factor(u95_apart, noise, freedom) * u95_apart


def _freedom_of_noise(application: BrakeApplication, noise: float) -> float:
    """Degrees of freedom of the noise of a mean force, from the effective ones of all."""
    coverage = application.coverage
    if not coverage or coverage.degrees_of_freedom is None or not noise:
        return math.inf
    return coverage.degrees_of_freedom * (noise / coverage.u_n) ** 4


def _factor(u: float, noise: Sequence[float], freedom: Sequence[float]) -> float:
    """Coverage factor of 95 % by Welch and Satterthwaite; only noise is found from samples."""
    spent = sum(x**4 / n for x, n in zip_longest(noise, freedom) if n)
    return coverage_factor(u**4 / spent if spent else math.inf)
