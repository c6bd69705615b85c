"""Differences between runs with their uncertainty, by JCGM 100 (GUM), 5.2.

Parameters of the vehicle that two runs state alike are one error in both. What it adds to a
difference is its standard uncertainty times the difference of the sensitivities, so that most of it
cancels. Noise is another one in each run.
"""

import math
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from typing import NamedTuple

from ...core.model import Vehicle
from ...core.signals import coverage_factor
from ...core.summary import BrakeApplication
from .run import Axle, Run

_NOISE = "noise"
_MASS = "axle_mass"


class Difference(NamedTuple):
    """A quantity of a run less that of the first run; names as in the JSON.

    Attributes:
        run: place of the run, the second is 2.
        axle: number.
        application: place among the axle's brake applications, the first is 1.
        quantity: "force", "coefficient" (means) or "utilisation".
        unit: of the numbers.
        difference: the value.
        u95: expanded uncertainty (95 %), where the runs share what they state alike.
        u95_apart: the same where they share nothing, as for two vehicles.
        alike: whether the uncertainty explains the difference.
    """

    run: int
    axle: int
    application: int
    quantity: str
    unit: str
    difference: float
    u95: float
    u95_apart: float
    alike: bool


def every(runs: Sequence[Run]) -> list[Difference]:
    """All runs against the first one: brake applications by their order, axles by their number."""
    first, *others = runs
    found: list[Difference] = []
    for place, run in enumerate(others, 2):
        before = {axle.number: axle for axle in first.axles}
        for axle in run.axles:
            if axle.number in before:
                found += _of_axle(place, before[axle.number], axle, run)
    return found


def unpaired(runs: Sequence[Run]) -> bool:
    """Whether a brake application or an axle of a run has none to be compared with."""
    counts = [{a.number: len(a.applications) for a in run.axles} for run in runs]
    return any(one != counts[0] for one in counts)


def settings_apart(one: Run, other: Run) -> list[str]:
    """The settings that two runs do not have in common, and the version if that differs."""
    keys = sorted(one.settings.keys() | other.settings.keys())
    apart = [k for k in keys if one.settings.get(k) != other.settings.get(k)]
    names = [".".join(k.split(".")[:2]) for k in apart]
    if one.provenance.get("version") != other.provenance.get("version"):
        names.append("version of the program")
    return list(dict.fromkeys(names))


def same_log(one: Run, other: Run) -> bool:
    """Whether two runs are of one log."""
    return bool(one.log.sha256) and one.log.sha256 == other.log.sha256


def same_vehicle(one: Run, other: Run) -> bool:
    """Whether two runs state the same vehicle."""
    stated = [
        {k: v for k, v in r.settings.items() if k.startswith("vehicle.")} for r in (one, other)
    ]
    return stated[0] == stated[1]


def _of_axle(place: int, before: Axle, after: Axle, run: Run) -> Iterator[Difference]:
    pairs = zip(before.applications, after.applications, strict=False)
    for k, (a, b) in enumerate(pairs, 1):

        def told(quantity: str, unit: str, value: float, u95: float, apart: float) -> Difference:
            of = (place, after.number, k, quantity, unit)  # noqa: B023 (used at once)
            return Difference(*of, value, u95, apart, abs(value) <= u95)

        if a.force_n and b.force_n and a.coefficient and b.coefficient:
            difference = b.force_n.mean - a.force_n.mean
            yield told("force", "N", difference, *_of_force(a, b, run))
            change = b.coefficient.mean - a.coefficient.mean
            apart = math.hypot(a.coefficient.mean_u95, b.coefficient.mean_u95)
            if before.weight == after.weight:
                shared = _of_force(a, b, run, by_weight=difference)[0] / after.weight
            else:
                shared = apart
            yield told("coefficient", "-", change, shared, apart)
        if a.utilisation is not None and b.utilisation is not None:
            intervals = (x.utilisation_ci or (0.0, 0.0) for x in (a, b))
            halves = [0.5 * (upper - lower) for lower, upper in intervals]
            u95 = math.hypot(*halves)
            yield told("utilisation", "-", b.utilisation - a.utilisation, u95, u95)


def _of_force(
    a: BrakeApplication, b: BrakeApplication, run: Run, by_weight: float = 0.0
) -> tuple[float, float]:
    """Expanded uncertainty of a difference of mean forces: with shared parameters, without [N].

    Args:
        a: brake application of the first run.
        b: of the other one.
        run: the other one.
        by_weight: the difference, if it will be divided by the weight: the mass then counts [N].
    """
    rows = [{row.quantity: row for row in one.budget or ()} for one in (a, b)]
    shared: dict[str, float] = {}
    alone: list[dict[str, float]] = [{}, {}]
    for name in sorted((rows[0].keys() | rows[1].keys()) - {_NOISE}):
        one, other = (of.get(name) for of in rows)
        if one and other and (one.value, one.u) == (other.value, other.u):
            shared[name] = (other.sensitivity - one.sensitivity) * one.u
        else:
            for own, row in zip(alone, (one, other), strict=True):
                if row:
                    own[name] = row.sensitivity * row.u
    if by_weight:
        stated = {k: float(run.settings[f"vehicle.{_MASS}.{k}"]) for k in ("value", "tolerance")}
        shared[_MASS] = shared.get(_MASS, 0.0) - by_weight * stated["tolerance"] / stated["value"]
    vehicle = Vehicle(correlation=_correlation(run))
    noise = [of[_NOISE].contribution_n for of in rows]
    parts = [vehicle.covariance(own, own) for own in (shared, *alone)]
    u = math.sqrt(max(sum(parts), 0.0) + sum(x**2 for x in noise))
    apart = math.hypot(*(x.coverage.u_n for x in (a, b) if x.coverage))
    freedom = [_freedom_of_noise(one, x) for one, x in zip((a, b), noise, strict=True)]
    return _factor(u, noise, freedom) * u, _factor(apart, noise, freedom) * apart


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


def _correlation(run: Run) -> tuple[tuple[str, str, float], ...]:
    """Of the errors of two parameters, as the settings state it."""
    head = "vehicle.correlation."
    found = {k.removeprefix(head): float(v) for k, v in run.settings.items() if k.startswith(head)}
    return tuple((*pair.split("."), share) for pair, share in found.items())  # type: ignore[misc]
