"""The rail under the slides of an axle: points, fit, utilisation, and a summary."""

import math
from collections.abc import Sequence
from functools import cached_property
from itertools import combinations, pairwise
from typing import NamedTuple

import numpy as np

from ..core import physics, threads
from ..core.finding import Finding
from ..core.masks import true_runs
from ..core.model import AxleRecord, AxleResult, Bools, Floats, Parameter, Vehicle
from ..core.physics import LONGEST_DUMP
from ..core.signals import largest_nearby
from . import fit
from .events import Slide
from .sliding import find_creep, slides
from .slope import REGIONS
from .speed_errors import (
    delay_sigma,
    has_slow_receiver,
    has_uncertain_delay,
    speed_error,
    speed_noise,
)
from .wheel_calibration import calibrate_radius

_LOCKED_SLIP = 0.5  # of a wheel that comes to stand
_SAME_RAIL_PAUSE = 5.0  # after a longer pause a slide may be on another rail [s]
_SMEARING_TIME = 0.1  # over this time the smoother of the force spreads an error [s]
_FEW_DRAWS = 40  # draws for the utilisation of one brake application
_ROUGH_DRAWS = 20  # draws of a fit that finds the delay of the train speed


def shares(axle: AxleResult) -> dict[str, float]:
    """Share of the braked time, above the speed limit for slip, in each region."""
    if axle.region is None or axle.slip is None:
        return {}
    time = np.zeros(len(REGIONS))
    for s in axle.applications:
        h = np.diff(axle.record.t[s], append=axle.record.t[s.stop - 1]) * 1e-9
        h = np.where(np.isfinite(axle.slip[s]), h, 0.0)
        time += np.bincount(axle.region[s], weights=h, minlength=len(REGIONS))
    total = float(time.sum())
    if total == 0.0:
        return {}
    return {name: float(x) / total for name, x in zip(REGIONS, time, strict=True)}


class ApplicationSlides(NamedTuple):
    """The slides of one brake application, and the rail under them."""

    slides: list[Slide]
    rail: fit.RailFit | None
    findings: list[Finding]  # what these slides do not show


class Summary(NamedTuple):
    """What `adhesion slip` reports of one axle; None where the log does not show it."""

    axle: int
    regions: dict[str, float]  # shares of the braked time
    slides: list[Slide]
    rail: fit.RailFit | None
    slip_rmse: float | None  # against the log's own true slip, while braked
    delay: Parameter | None  # delay of the train speed, corrected [s]; None: not known
    places: Sequence[ApplicationSlides] = ()  # where it slid, in the order of time

    def place_of(self, slide: Slide) -> ApplicationSlides | None:
        """The place of a slide."""
        return next((place for place in self.places if slide in place.slides), None)


def summary(axle: AxleResult, vehicle: Vehicle) -> tuple[Summary, list[Finding]]:
    """Slides, shares, rail, peak and adhesion utilisation of an axle."""
    axle_slides, context = slides(axle), AxleContext(axle, vehicle)
    places = fit_places(context, axle_slides)
    rails = [place.rail for place in places if place.rail]
    # of two, none gives the adhesion of the other one, as far as its slides show it
    if any(
        fit.contradicts(a, b, vehicle) and fit.contradicts(b, a, vehicle)
        for a, b in combinations(rails, 2)
    ):
        rail, findings = None, [Finding("rail-changes", "info", channel=f"axle {axle.record.axle}")]
    else:
        rail, findings = fit_rail(context, axle_slides)
    if rail and len(places) == 1:  # what `analyze` reports of the brake application
        place_rail = places[0].rail
        rail = rail._replace(utilisation=place_rail.utilisation if place_rail else None)
    summary_of_axle = Summary(
        axle=axle.record.axle,
        regions=shares(axle),
        slides=axle_slides,
        rail=rail,
        slip_rmse=_rmse(axle),
        delay=None if axle.record.train_speed_made else axle.record.train_speed_late,
        places=places,
    )
    return summary_of_axle, findings


def braked_pieces(axle: AxleResult) -> list[list[slice]]:
    """The brake applications; one whose wheel locked in between has several pieces."""
    merged: list[list[slice]] = []
    for s in axle.applications:
        if merged and _locked(axle, slice(merged[-1][-1].stop, s.start)):
            merged[-1].append(s)
        else:
            merged.append([s])
    return merged


def _locked(axle: AxleResult, pause: slice) -> bool:
    """Whether the train moves on and the brake is on: it is one application of a locked wheel.

    Wheel slide protection may vent the brake of a wheel that stands for a short time. Where the
    wheel rolls, the driver released it.
    """
    record, slip = axle.record, axle.slip
    K, v, t = record.clamping_force[pause], record.train_speed, record.t[pause]
    if v is None or not len(K) or not (v[pause] > physics.CRAWL).all():
        return False
    released = [t[b - 1] - t[a] for a, b in true_runs(K <= physics.NO_FORCE)]
    if released and (slip is None or not np.any(slip[pause] > _LOCKED_SLIP)):
        return False
    return max(released, default=0) < LONGEST_DUMP * 1e9


def fit_places(context: "AxleContext", axle_slides: Sequence[Slide]) -> list[ApplicationSlides]:
    """The rail under the slides of each brake application that has some.

    Each has fewer draws than the fit of all slides: it takes about half a second.
    """
    spans = ((p[0].start, p[-1].stop) for p in braked_pieces(context.axle))
    groups = [[x for x in axle_slides if a <= x.samples.start < b] for a, b in spans]
    return threads.run_each(
        lambda group: ApplicationSlides(group, *fit_rail(context, group, _FEW_DRAWS)),
        [group for group in groups if group],
    )


class AxleContext:
    """What a fit needs of the whole axle, computed once for all its brake applications.

    The axle has its slip and a train speed before anything is asked for.
    """

    def __init__(self, axle: AxleResult, vehicle: Vehicle) -> None:
        self.axle, self.vehicle = axle, vehicle.of_axle(axle.record.axle)

    @cached_property
    def radius(self) -> Parameter:
        """At which it coasts without slip [m]."""
        return calibrate_radius(self.axle.record, self.vehicle)[0]

    @cached_property
    def noise(self) -> Floats:
        """1 sigma of v − ωR [m/s], (n,)."""
        return speed_noise(self.axle.record, self.radius.value)

    @cached_property
    def clock(self) -> Floats:
        """1 sigma of slip by the train speed, (n,)."""
        return speed_error(self.axle.record)

    @cached_property
    def swing(self) -> Floats:
        """1 sigma of μ by the reference, (n,)."""
        record = self.axle.record
        sigma = _around(record, self.axle.reference.sigma)
        return physics.coefficient(sigma, self.vehicle, record.axle)

    @cached_property
    def half_changes(self) -> Floats:
        """What the brake force at the rim changes in half an interval [N], (n,)."""
        record = self.axle.record
        brake_force = physics.wheelset(self.vehicle, record.axle).phi * record.clamping_force
        return np.nan_to_num(np.gradient(brake_force)) / math.sqrt(12.0)

    @cached_property
    def creep(self) -> list[slice]:
        """Where it creeps, as `find_creep`."""
        assert self.axle.slip is not None
        return find_creep(self.axle.record, self.axle.slip)


def unknown_slip(record: AxleRecord, samples: slice, vehicle: Vehicle) -> tuple[Bools, float]:
    """Where the wheel turns and the train speed is not known, (m,), and for how long [s]."""
    mask: Bools = record.wheel_speed[samples] * vehicle.radius(record.axle).value > physics.CRAWL
    if record.train_speed is not None:
        mask &= ~np.isfinite(record.train_speed[samples])
    h = np.diff(record.t[samples], append=record.t[samples.stop - 1])
    typical = np.minimum(h, 2.0 * np.median(h))  # without the time of a gap
    return mask, float(typical[mask].sum()) * 1e-9


def fit_rail(
    context: AxleContext, axle_slides: Sequence[Slide], draws: int | None = None
) -> tuple[fit.RailFit | None, list[Finding]]:
    """The rail under slides of an axle, and findings about what they do not show."""
    record, vehicle = context.axle.record, context.vehicle
    name = f"axle {record.axle}"
    if not axle_slides:
        return None, [Finding("no-slide", "info", channel=name)]
    if record.train_speed_made:
        return None, [Finding("rail-needs-train-speed", "info", channel=name)]
    if has_slow_receiver(record):
        return None, [Finding("rail-needs-train-clock", "info", channel=name)]
    radius = context.radius
    observed, mu_error = points(context, axle_slides)
    if fit.clear_time(observed) < fit.SHORTEST:
        needed = {"needed_s": fit.SHORTEST, "clear_s": fit.clear_time(observed)}
        return None, [Finding("slides-too-short", "info", channel=name, values=needed)]
    radius_error, late, rough = radius.share, 0.0, (_ROUGH_DRAWS,) * 2
    for count in (*(rough if has_uncertain_delay(record) else ()), draws or fit.DRAWS):
        shifted = _without_delay(record, observed, late)
        rail = fit.fit(shifted, vehicle, radius_error, mu_error, count)
        if rail is None:
            break
        late -= rail.delay * delay_sigma(record)
    if rail is None:
        return None, [Finding("rail-changes", "info", channel=name)]
    findings = []
    if rail.peak_slip_limit is None:
        findings.append(Finding("peak-unknown", "info", channel=name))
    elif rail.peak_slip is None:
        values = {"share": rail.peak_slip_limit}
        findings.append(Finding("peak-below", "info", channel=name, values=values))
    if missing := ", ".join(n for n in rail.best._fields if n not in rail.constants):
        names = {"parameters": missing}
        findings.append(Finding("rail-parameters-unknown", "info", channel=name, names=names))
    return rail, findings


def _without_delay(record: AxleRecord, p: fit.Points, late: float) -> fit.Points:
    """The points with a train speed that is `late` [s].

    A fit knows the error of slip by the delay for a steady deceleration only. Under a WSP the
    train's deceleration changes within the delay, which flattens the curve.
    """
    assert record.train_speed is not None
    known, t = np.isfinite(record.train_speed), (record.t - record.t[0]) * 1e-9
    speed = np.interp(p.t + late, t[known], record.train_speed[known])
    speed = np.maximum(speed, physics.CRAWL)
    return p._replace(speed=speed, slip=1.0 - (1.0 - p.slip) * p.speed / speed)


def _rmse(axle: AxleResult) -> float | None:
    """Rms error of slip against the log's true slip, while braked; None without a true slip."""
    true_slip, s = axle.record.true_slip, axle.slip
    if true_slip is None or s is None:
        return None
    error = np.concatenate([(s - true_slip)[x] for x in axle.applications] or [np.empty(0)])
    error = error[np.isfinite(error)]
    return float(np.sqrt(np.mean(error**2))) if len(error) else None


def points(context: AxleContext, axle_slides: Sequence[Slide]) -> tuple[fit.Points, float]:
    """Operating points of slides and of creep close to them; 1 sigma of μ's scale.

    After a long pause the rail may be another one.
    """
    axle, vehicle = context.axle, context.vehicle
    record, ref = axle.record, axle.reference
    assert axle.slip is not None
    assert record.train_speed is not None
    sliding, on_same_rail = np.zeros((2, len(record)), dtype=np.bool_)
    for x in axle_slides:
        sliding[x.samples] = True
    runs = {x.start: x for x in (*context.creep, *(x.samples for x in axle_slides))}
    for segment in record.segments:
        inside = [runs[i] for i in sorted(runs) if segment.start <= i < segment.stop]
        group = slice(0, 0)
        for run, following in pairwise([*inside, slice(0, 0)]):
            group = slice(group.start if group.stop else run.start, run.stop)
            pause = record.t[following.start] - record.t[run.stop - 1]
            if following.stop and pause < _SAME_RAIL_PAUSE * 1e9:
                continue
            on_same_rail[group] = sliding[group].any()
            group = slice(0, 0)
    indices = np.flatnonzero(on_same_rail & np.isfinite(ref.force) & np.isfinite(axle.slip))
    mu = physics.coefficient(ref.force[indices], vehicle, axle.record.axle)
    force, mass = np.maximum(ref.force[indices], 1.0), vehicle.axle_mass
    common = 0.0 if ref.mass is None else ref.mass[indices] / force  # error of force and mass
    share = ref.tolerance[indices] / force
    scale = share**2 - 2.0 * common
    variance = float(np.median(scale)) if len(indices) else 0.0
    error = math.sqrt(max(variance + mass.share**2, 0.0))
    t = (record.t[indices] - record.t[0]) * 1e-9
    v = record.train_speed[indices]
    noise = context.noise[indices] / v  # of (2)
    typical = float(np.median(share)) if len(indices) else 0.0
    half_changes = context.half_changes[indices]
    errors = np.column_stack([ref.tolerance[indices] - typical * force, half_changes])
    common_errors = physics.coefficient(errors, vehicle, record.axle)
    columns = context.swing[indices], context.clock[indices], common_errors, sliding[indices]
    return fit.Points(t, v, axle.slip[indices], mu, noise, *columns), error


def _around(record: AxleRecord, sigma: Floats) -> Floats:
    """Largest sigma of the reference within `_SMEARING_TIME`, shape (n,).

    Between two readings of a changing pressure, K is unknown. Its error goes into ω̇, and the
    smoother spreads it over correct readings nearby.
    """
    h = float(np.median(np.diff(record.t))) * 1e-9
    return largest_nearby(sigma, max(1, round(_SMEARING_TIME / h)))
