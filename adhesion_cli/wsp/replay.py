"""What each controller would have done in a logged stop.

Rail. `replay_rail` gives the rail under each axle that slid, and where it lies. Elsewhere, and
under an axle that never slid, the rail counts as dry.

Demand. It is the clamping force of the axles that never slid. If every axle slid, the WSP dumped
air from each, and the demand counts as the largest force so far. If it was not steady before the
slides, or grew in them, half of the draws have more, up to what locks a wheel on dry rail. There is
then no dry distance. The demand begins earlier by the time in which cylinders fill against their
springs. If the brake was released before standstill, the demand continues.

Train. It has the log's axles and its speed at the start of the brake. What slowed the logged train
beside its axles, as running resistance, air drag and gradient, acts in every replayed stop. It is
r + C v², fitted to the train speed less the impulse of the axles' forces. Without a measured train
speed, or with axles left out, it is zero. The WSP controller is that of `scenario.Antiskid`.

The log's own WSP is replayed, too: every wheel slides as in the log, with the force that the fitted
rail has at that slip. Where this stop is not as long as the log's, the replay is not that stop.

Uncertainty. A draw has a rail under each axle and one true pad friction, which the deceleration of
the train makes likely. How friction falls in deep slides is the same choice under all axles. The
intervals do not contain the errors of the assumptions above.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path
from statistics import NormalDist
from typing import Literal, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from ..core import physics, threads, toml
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Floats, Parameter, Result, Times, Vehicle
from ..core.physics import JUDGED_FROM, STANDING
from ..core.signals import running_integral
from ..core.text import printable
from ..rail import fit, sliding
from ..rail.creep_law import Condition, condition
from ..rail.events import Slide
from ..rail.fit import RailFit
from ..train import mean_axle
from ..train.deceleration_cause import STATED_SIGMAS
from ..train.grid import GRADIENT_SIGMA
from ..train.longitudinal import DRAG_OF_TRAINS, RESISTANCE_OF_TRAINS, tolerance
from . import closed_loop, replay_rail
from .closed_loop import Logged
from .plant import RailConditions
from .replay_rail import RailUnderAxle, SlidCourse
from .scenario import INF, Antiskid, Command, Scenario, ScenarioBrake, ScenarioTrain
from .stop import Stop, Verdict
from .wsp_controller import Settings

_KNOT_INTERVAL = 0.1  # between two knots of the demand [s]
_OFFSET = 0.1  # share of it: a smaller least value is a sensor's offset
_PAUSE = 2.0  # longest time without brake and slide within one brake application [s]
_DRAWS = 40  # of the fit that are simulated
_NOISE = 0.01  # share of the largest demand: least change of it
_STEADY_TIME = 1.0  # least time of a steady demand [s]
_STEADY_CHANGE = 0.03  # and its largest change, as a share
_FILLED_FORCE = 1.0  # clamping force for which a cylinder is filled up to its spring's force [N]
_HINT_LEAD = 5.0  # of a stop that a hint names [s]
_BLEND = 0.1  # from the dry rail to the fitted one [m]
_SPEED_SCALE = 0.005  # 1 sigma of the scale of the train speed, and so of the deceleration
_LEVEL_STRIDE = 10  # samples of a slide's level between two knots of the rail
_CLOSE = 0.02  # of a distance: a smaller difference is one of the curve's shape
_LOCKS = 0.5  # least slip of a wheel that locks: the log does not show its force
_LOGGED_INTERVAL = 0.01  # between samples of the logged stop [s]


Values = dict[str, tuple[float, float, float] | None]  # by field of `Verdict`
Job = TypeVar("Job")
JobAnswer = TypeVar("JobAnswer")


class Compared(NamedTuple):
    """A controller compared with the others."""

    patent_less_this_m: tuple[float, float, float] | None  # difference of the distances
    shortest: float  # share of the stops in which it has the shortest distance


class Case(NamedTuple):
    """A stop of a log, ready to be run again."""

    start_s: float  # of the brake, after the log's start [s]
    scenario: Scenario  # train and demand
    track: RailConditions  # the best fit
    draws: list[tuple[Scenario, RailConditions]]
    logged: Logged  # what the log shows of its axles
    logged_m: float | None  # distance in the log from the same moment to standstill
    demanded: bool  # the demand is known
    findings: list[Finding]


class Answer(NamedTuple):
    """One controller: its stop on the best fit; of each value the draws' median and 95 % interval.

    The best fit's own value would mislead: one stop's largest slip lies below that of most draws.
    """

    stop: Stop
    values: Values
    compared: Compared  # over the draws, each the same rail and brake for every controller


class _AxlePlaces(NamedTuple):
    """Where the fitted rail lies under an axle, after the start of the brake."""

    spans: list[tuple[float, float]]  # from and to [m]
    vehicle: Vehicle
    course: SlidCourse | None = None  # that shows the level of the rail
    level_places: Floats = np.empty(0)  # of these levels, shape (k,) [m]


class _Braking(NamedTuple):
    """The stop on a grid of `_KNOT_INTERVAL` from the start of the brake; all shape (n,)."""

    t: Times  # [ns]
    speed: Floats  # of the train [m/s]
    K: Floats  # clamping force of each axle [N], shape (axles, n)


def case(result: Result, train_speed: Literal["measured", "axles"] | None = None) -> Case:
    """The stop of a log with the longest slide, and the rails that are likely under it.

    `train_speed` is the source of the WSP's train speed, if not that of `scenario.Antiskid`.

    Raises:
        UserError: where the log does not show the rail, with the reason.
    """
    name = printable(Path(result.log.path).name)
    slides = [sliding.slides(axle) for axle in result.axles]
    if not any(slides):
        hint = "replay a log with slides"
        raise UserError(f"{name}: no axle slides, so the adhesion available is not known", hint)
    braking = _braking(result, slides)
    if not braking.speed[0] > JUDGED_FROM:
        text = f"{name}: the train does not move when the brake is applied"
        raise UserError(text, "choose a stop with --from and --to")
    begin, stop = braking.t[[0, -1]].tolist()
    axle_rails, findings = _rails_under(result, slides, begin, stop)
    firsts = [x.spans[0][0] if x else 0 for x in axle_rails]
    places = [_places(braking, x, result.vehicle) for x in axle_rails]
    demand, demand_known, demand_findings = _demand(braking, firsts, result.log.start_ns())
    radii = tuple(result.vehicle.radius(a.record.axle) for a in result.axles)
    scenario = Scenario(
        Path(name).stem,
        "a stop of a log",
        closed_loop.LONGEST,
        closed_loop.DRY,
        train=ScenarioTrain(float(braking.speed[0]), len(radii)),
        brake=ScenarioBrake(_commands(braking, demand)),
        # the demand has the friction of the table
        vehicle=replace(_equal_axle(result), wheel_radius=radii, friction_table=None),
    ).with_train_speed(train_speed)
    rails = [x and x.rail for x in axle_rails]
    impulse, train_findings = _impulse(result, braking)
    comes_to_rest = bool(braking.speed[-1] < STANDING)
    track = _track(places, [rail and rail.best for rail in rails])
    return Case(
        (begin - result.log.start_ns()) / 1e9,
        scenario,
        _with_resistance(track, braking, impulse, 1.0, 0.0),
        _draws(scenario, braking, rails, places, (demand, demand_known), impulse),
        _logged(result, braking, slides),
        _distance(braking, stop) if comes_to_rest else None,
        bool(demand_known.all()),
        [*findings, *demand_findings, *train_findings],
    )


def _places(braking: _Braking, x: RailUnderAxle | None, vehicle: Vehicle) -> _AxlePlaces:
    if x is None:
        return _AxlePlaces([], vehicle)
    spans = [(_distance(braking, a), _distance(braking, b)) for a, b in x.spans]
    if x.course is None:
        return _AxlePlaces(spans, vehicle)
    level_places = [_distance(braking, t) for t in x.course.t[::_LEVEL_STRIDE].tolist()]
    return _AxlePlaces(spans, vehicle, x.course, np.array(level_places))


def _rails_under(
    result: Result, slides: Sequence[Sequence[Slide]], begin: int, stop: int
) -> tuple[list[RailUnderAxle | None], list[Finding]]:
    """The rail under every axle that slid in the stop, and findings about it."""
    axle_rails: list[RailUnderAxle | None] = []
    findings, refused, start = list[Finding](), list[tuple[int, UserError]](), result.log.start_ns()
    for axle, axle_slides in zip(result.axles, slides, strict=True):
        number, rail = axle.record.axle, None
        if inside := [x for x in axle_slides if begin <= x.start <= stop]:
            try:
                rail, rail_findings = replay_rail.rail_under_axle(
                    axle, result.vehicle, inside, begin, stop
                )
            except UserError as error:
                refused.append((number, error))
            else:
                findings += rail_findings
                spans = tuple(((a - start) / 1e9, (b - start) / 1e9) for a, b in rail.spans if b)
                if spans:
                    name = f"axle {number}"
                    findings.append(Finding("replay-rail-ends", "info", name, spans=spans))
        elif (
            axle.record.train_speed_late is None
            and sliding.limited_from(axle, begin, stop) is not None
        ):
            text = "the delay of the train speed is not known, and may hide its slides"
            line = toml.option("channels.train_speed.delay = 0.8")
            hint = "Replay a log with a brake on a dry rail, too: it shows the delay. "
            hint += f"If you know it, state it in seconds, as {line}."
            refused.append((number, UserError(text, hint)))
        axle_rails.append(rail)
    if not refused:
        return axle_rails, findings
    number, reason = refused[0]
    hints = [reason.hint]
    all_slides = [x for axle_slides in slides for x in axle_slides]
    if elsewhere := [x for x in all_slides if not begin <= x.start <= stop]:
        longest = max(elsewhere, key=lambda x: x.duration)
        seconds = [(t - start) / 1e9 for t in _brake(result, slides, longest.start)]
        begins = max(seconds[0] - _HINT_LEAD, 0.0)
        hints.append(f"Or replay another stop: --from {begins:.0f} --to {seconds[1]:.0f}")
    elif any(axle_rails):
        refused_axles = {n for n, _ in refused}
        kept_axles = (x.record.axle for x in result.axles if x.record.axle not in refused_axles)
        hints.append(f"Or leave the axle out: {' '.join(f'--axle {n}' for n in kept_axles)}")
    name = printable(Path(result.log.path).name)
    text = f"{name}: no rail to replay under axle {number}: {reason.text}"
    raise UserError(text, " ".join(hints))


def _draws(
    scenario: Scenario,
    braking: _Braking,
    rails: Sequence[RailFit | None],
    places: Sequence[_AxlePlaces],
    demand: tuple[Floats, Bools],
    impulse: Floats | None,
) -> list[tuple[Scenario, RailConditions]]:
    """Stops that are as likely as the best fit.

    `demand` and where it is known are from `_demand`, `impulse` from `_impulse`.
    """
    random = np.random.default_rng(0)
    (demand_force, demand_known), vehicle, draws = demand, scenario.vehicle, []
    phi = vehicle.friction
    dry_force = condition("dry").f0 * physics.G * vehicle.axle_mass.value
    dry_force = max(dry_force / phi.value, float(demand_force.max()))
    computed_scales = next(rail.scales for rail in rails if rail)[:_DRAWS]
    scales = _balanced(computed_scales, braking, impulse)
    sampled_rails = _draw_rails(rails, scales, vehicle, random)
    order, n = np.random.default_rng(1).permutation(len(scales)).tolist(), len(scales)
    errors = [NormalDist(0.0, _SPEED_SCALE).inv_cdf((k + 0.5) / n) for k in order]
    for k, scale in enumerate(scales):
        truly = replace(vehicle, friction=phi._replace(value=phi.value * scale))
        track = _track(places, [axle[k] if axle else None for axle in sampled_rails], scale)
        track = _with_resistance(track, braking, impulse, scale, errors[k])
        exponent = max(random.uniform(-1.0, 1.0), 0.0)
        excess = (dry_force / np.maximum(demand_force, _FILLED_FORCE)) ** exponent
        drawn_demand = np.where(demand_known, 1.0, excess) * demand_force
        brake = ScenarioBrake(_commands(braking, drawn_demand))
        draws.append((replace(scenario, vehicle=truly, brake=brake), track))
    return draws


def _balanced(
    scales: Sequence[float], braking: _Braking, impulse: Floats | None
) -> Sequence[float]:
    """Scales of the forces that the deceleration of the train makes likely, too.

    Forces whose scale is not known may not slow the train more than it slows, or leave more of its
    deceleration than resistance and gradient explain. `scales` are true over computed force, of
    each draw.
    """
    sigma = float(np.std(np.log(scales)))
    if impulse is None or not impulse[-1] > 0.0 or not sigma > 0.0:
        return scales
    seconds = _KNOT_INTERVAL * len(braking.t)
    squares = _KNOT_INTERVAL * float(np.sum(braking.speed**2))
    resistance = seconds * RESISTANCE_OF_TRAINS.value + squares * DRAG_OF_TRAINS.value
    steady_sigma = seconds * math.hypot(RESISTANCE_OF_TRAINS.tolerance, GRADIENT_SIGMA)
    resistance_sigma = math.hypot(steady_sigma, squares * DRAG_OF_TRAINS.tolerance)
    by_axles, speed_loss = float(impulse[-1]), float(braking.speed[0] - braking.speed[-1])
    weight = sigma**2 / (sigma**2 + (resistance_sigma / by_axles) ** 2)
    mean = 1.0 + weight * ((speed_loss - resistance) / by_axles - 1.0)
    narrower = math.sqrt(1.0 - weight)
    return [mean * scale**narrower for scale in scales]


def _impulse(result: Result, braking: _Braking) -> tuple[Floats | None, list[Finding]]:
    """What the axles' forces took from the train's speed so far, shape (n,) [m/s].

    None where axles of the log are left out, or where no train speed is measured: an estimated one
    is made of the axles. Findings say that other axles or forces slowed the train, too.
    """
    numbers = {a.record.axle for a in result.axles}
    speeds = [c for c in result.log.channels if c.meaning == "wheel_speed" and len(c.data.t)]
    if missing := sorted({c.axle for c in speeds if c.axle} - numbers):
        names = {"axles": ", ".join(map(str, missing))}
        return None, [Finding("replay-axles-missing", "warning", names=names)]
    if any(a.record.train_speed_made for a in result.axles):
        return None, []
    F = sum(_column(braking.t, a.record.t, a.reference.force) for a in result.axles)
    vehicle = _equal_axle(result)
    impulse = _KNOT_INTERVAL * np.cumsum(F) / (len(result.axles) * vehicle.axle_mass.value)
    by_axles, speed_loss = float(impulse[-1]), float(braking.speed[0] - braking.speed[-1])
    if by_axles > 0.0 and abs(speed_loss / by_axles - 1.0) < STATED_SIGMAS * tolerance(vehicle):
        return impulse, []
    span = ((braking.t[[0, -1]] - result.log.start_ns()) * 1e-9).tolist()
    values = {"lost_mps": speed_loss, "explained_mps": by_axles}
    spans = ((span[0], span[1]),)
    return impulse, [Finding("replay-axles-differ", "warning", spans=spans, values=values)]


def _with_resistance(
    track: RailConditions, braking: _Braking, impulse: Floats | None, scale: float, error: float
) -> RailConditions:
    """The track with what slows the train beside its axles: a constant, and drag over v².

    `scale` is that of the forces, `error` that of the train's deceleration, as a share.
    """
    if impulse is None:
        return track
    speed_loss = braking.speed[0] - braking.speed - scale * impulse
    seconds = (braking.t - braking.t[0]) * 1e-9
    squares = _KNOT_INTERVAL * np.cumsum(braking.speed**2)
    columns = np.column_stack([seconds, squares])
    resistance, drag = np.linalg.lstsq(columns, speed_loss, rcond=None)[0].tolist()
    if drag < 0.0:  # of noise: no drag pushes
        resistance, drag = float(np.sum(speed_loss * seconds) / np.sum(seconds**2)), 0.0
    mean = float(braking.speed[0] - braking.speed[-1]) / max(float(seconds[-1]), _KNOT_INTERVAL)
    return track._replace(resistance=resistance + error * mean, drag=drag)


def _logged(result: Result, braking: _Braking, slides: Sequence[Sequence[Slide]]) -> Logged:
    """What the log shows of each axle from the start of the stop on."""
    start_ns, stop_ns = braking.t[[0, -1]].tolist()
    t = np.arange(start_ns, stop_ns + 1, round(_LOGGED_INTERVAL * 1e9), dtype=np.int64)
    vehicle = _equal_axle(result)
    line, columns = physics.force_line(vehicle), list[tuple[Floats, Floats, Floats]]()
    for axle, axle_slides in zip(result.axles, slides, strict=True):
        record = axle.record
        rim_speed = record.wheel_speed * result.vehicle.radius(record.axle).value
        v, rim = _column(t, record.t, record.train_speed), _column(t, record.t, rim_speed)
        slip = np.clip(1.0 - rim / np.maximum(v, STANDING), 0.0, 1.0)
        force = _column(t, record.t, axle.reference.force)
        for x in axle_slides:
            force[(t >= x.start) & (t <= x.start + x.duration * 1e9)] = np.nan
        force[slip > _LOCKS] = np.nan  # also at walking pace, where no slide is found
        K = _column(t, record.t, record.clamping_force_smooth)
        pressure = physics.cylinder_pressure(line, K)
        columns.append((pressure, slip, force))
    tables = (np.column_stack(x) for x in zip(*columns, strict=True))
    return Logged(_LOGGED_INTERVAL, vehicle.friction.value, *tables)


def answers(
    case: Case, algo: str, settings: Settings, seed: int, progress: Callable[[str], None]
) -> tuple[float | None, dict[str, Answer]]:
    """Dry distance [m], None where the demand is not known, and every controller's stop, by name.

    `algo`, `settings` and `seed` are those of `closed_loop.run`.

    Raises:
        UserError: as `closed_loop.run`.
    """

    def stops(
        draw: tuple[Scenario, RailConditions], progress: Callable[[str], None] = lambda _: None
    ) -> tuple[float, dict[str, tuple[Stop, Verdict]]]:
        scenario, track = draw
        dry, by_law = closed_loop.compare_laws(scenario, seed, algo, settings, progress, track)
        if case.logged_m is not None:
            stop = closed_loop.follow(scenario, track, case.logged)
            by_law[closed_loop.LOGGED] = stop, closed_loop.verdict(stop, scenario, dry)
        return dry, by_law

    def verdicts(draw: tuple[Scenario, RailConditions]) -> dict[str, Verdict]:
        return {law: v for law, (_, v) in stops(draw)[1].items()}

    dry, best = stops((case.scenario, case.track), progress)
    results = on_all_cores(verdicts, case.draws, progress)
    by_law = {law: [draw[law] for draw in results] for law in best}
    paired, bounds = compared(by_law), {}
    for law, (stop, _) in best.items():
        values = intervals(by_law[law])
        quantities = values if case.demanded else {**values, "extension": None}
        bounds[law] = Answer(stop, quantities, paired[law])
    return dry if case.demanded else None, bounds


def distance_findings(case: Case, answers: Mapping[str, Answer]) -> list[Finding]:
    """A finding where the replay of the logged slides is not as long as the logged stop."""
    logged = answers.get(closed_loop.LOGGED)
    interval = logged and logged.values["stopping_distance_m"]
    if case.logged_m is None or interval is None:
        return []
    _, lower, upper = interval
    if (1.0 - _CLOSE) * lower <= case.logged_m <= (1.0 + _CLOSE) * upper:
        return []
    values = {"logged_m": case.logged_m, "lower_m": lower, "upper_m": upper}
    return [Finding("replay-train-differs", "warning", values=values)]


def _draw_rails(
    rails: Sequence[RailFit | None],
    scales: Sequence[float],
    vehicle: Vehicle,
    random: np.random.Generator,
) -> list[list[Condition] | None]:
    """Draws of every axle's rail; draw k has similar adhesion of locked wheels under all axles.

    The slides do not show how far friction falls. Independent draws of it under each axle would
    average out, and the stop would seem too certain. A rail that is None is dry. `scales` are true
    over computed μ, of each draw.
    """
    order: NDArray[np.int64] | None = None
    conditions: list[list[Condition] | None] = []
    for rail in rails:
        if rail is None:
            conditions.append(None)
            continue
        computed = zip(rail.draws[:_DRAWS], rail.scales, strict=False)
        draws = [replay_rail.scaled_by(x, 1.0 / c) for x, c in computed]
        draws.sort(key=lambda x: float(fit.curve(x, rail.speed, np.ones(1), vehicle)[0]))
        order = random.permutation(len(draws)) if order is None else order
        scaled = zip(order.tolist(), scales, strict=True)
        conditions.append([replay_rail.scaled_by(draws[i], c) for i, c in scaled])
    return conditions


def _equal_axle(result: Result) -> Vehicle:
    """An axle of the stop, which all equal but for their radii; refuses others."""
    numbers = [a.record.axle for a in result.axles]
    vehicle = mean_axle.mean_axle(result.vehicle, numbers)
    if not mean_axle.have_equal_values(result.vehicle, numbers):
        text = "the axles of this stop have different brakes or masses: a replay has one kind"
        raise UserError(text, "replay one car, by an --axle for each of its axles", code=2)
    return vehicle


def _braking(result: Result, slides: Sequence[Sequence[Slide]]) -> _Braking:
    """From the demand of the brake in which the longest slide lies, to standstill or release."""
    slide = max((x for slides_of_axle in slides for x in slides_of_axle), key=lambda x: x.duration)
    start, stop = _brake(result, slides, slide.start)
    filled = float(physics.cylinder_pressure(physics.force_line(_equal_axle(result)), 0.0))
    start -= round(filled / Antiskid().fill_rate * 1e9)
    start = max(start, *(int(a.record.t[0]) for a in result.axles))
    t = np.arange(start, stop, round(_KNOT_INTERVAL * 1e9), dtype=np.int64)
    speed = _column(t, result.axles[0].record.t, result.axles[0].record.train_speed)
    by_table = replace(_equal_axle(result), friction_fade=Parameter(0.0, 0.0))
    records = [physics.with_fade(a.record, by_table) for a in result.axles]
    K = np.array([_column(t, r.t, r.clamping_force_smooth) for r in records])
    at_rest = speed < STANDING
    rest_index = int(np.argmax(at_rest)) + 1 if at_rest.any() else len(t)
    last_braked = _last_full_brake(K[:, :rest_index].max(axis=0))
    stop_index = max(last_braked, int(np.searchsorted(t, slide.start))) + 1
    return _Braking(t[:stop_index], speed[:stop_index], K[:, :stop_index])


def _brake(result: Result, slides: Sequence[Sequence[Slide]], instant: int) -> tuple[int, int]:
    """When the brake applied at that time began, and when the next one or the log's end is [ns].

    A WSP may dump every cylinder, but while a wheel slides and for a short time. A release lasts,
    and no wheel slides.
    """
    spans = [(x.start, x.start + round(x.duration * 1e9)) for x in chain.from_iterable(slides)]
    for a in result.axles:
        spans += [(int(a.record.t[s.start]), int(a.record.t[s.stop - 1])) for s in a.applications]
    spans.sort()
    begin, stop = spans[0]
    for slide_start, slide_stop in spans[1:]:
        if slide_start - stop > _PAUSE * 1e9:
            if stop >= instant:
                return begin, slide_start
            begin = slide_start
        stop = max(stop, slide_stop)
    return begin, max(int(a.record.t[-1]) for a in result.axles)


def _last_full_brake(demand: Floats) -> int:
    """Index at which the brake begins to be released, by the largest K of all axles [N], (n,)."""
    largest = float(demand.max())
    smallest = float(demand.min())
    offset = smallest if smallest < _OFFSET * largest else 0.0
    no_force = offset + physics.RELEASED_SHARE * largest
    top = i = max(np.flatnonzero(demand > no_force).tolist(), default=0)
    if top == len(demand) - 1:
        return top
    while i > 0 and (top - i) * _KNOT_INTERVAL < _STEADY_TIME:
        i -= 1
        if demand[i] > demand[top] + _NOISE * largest:
            top = i
    return top


def _column(grid: Times, t: Times, values: Floats | None) -> Floats:
    assert values is not None  # `analyze` makes a train speed where there is none
    finite = np.isfinite(values)
    return np.interp(grid, t[finite], values[finite])


def _distance(braking: _Braking, t: int | None) -> float:
    """Distance of the train until then [m]; infinite for None, the end of the stop."""
    if t is None:
        return INF
    seconds = (braking.t - braking.t[0]) * 1e-9
    distance = running_integral(seconds, braking.speed)
    return float(np.interp((t - braking.t[0]) * 1e-9, seconds, distance))


def _demand(
    braking: _Braking, firsts: Sequence[int], start_ns: int
) -> tuple[Floats, Bools, list[Finding]]:
    """The least demand [N], where it is the demand itself, and findings; shape (n,).

    `firsts` says when each axle began to slide, 0: it did not.
    """
    sliding_later, findings = [instant == 0 for instant in firsts], []
    seconds = (braking.t - start_ns) * 1e-9
    constrained: Bools = np.ones(len(braking.t), dtype=np.bool_)
    if any(sliding_later):
        demand: Floats = braking.K[sliding_later].max(axis=0)
    else:
        # From here on, no axle shows the demand.
        last_index = max(int(np.searchsorted(braking.t, max(firsts))), 1)
        rolling = braking.t < np.array(firsts)[:, None]
        rolling[:, 0] = True
        demand = np.where(rolling, braking.K, 0.0).max(axis=0)
        running_maximum = np.maximum.accumulate(braking.K[:, last_index:].max(axis=0))
        demand[last_index:] = np.maximum(running_maximum, demand[last_index - 1])
        steady_part = demand[:last_index][-1 - round(_STEADY_TIME / _KNOT_INTERVAL) :]
        is_even = np.ptp(steady_part) < _STEADY_CHANGE * steady_part[-1]
        stood = is_even and len(steady_part) * _KNOT_INTERVAL > _STEADY_TIME
        spans = ((float(seconds[last_index]), float(seconds[-1])),)
        if stood and demand[-1] < (1.0 + _STEADY_CHANGE) * steady_part[-1]:
            findings.append(Finding("demand-estimated", "info", spans=spans))
        else:
            constrained[last_index:] = False
            force = {"force_n": float(demand.max())}
            findings.append(Finding("demand-unknown", "warning", spans=spans, values=force))
    if braking.speed[-1] >= STANDING:
        values, spans = {"speed_mps": float(braking.speed[-1])}, ((float(seconds[-1]),) * 2,)
        findings.append(Finding("stop-extended", "info", spans=spans, values=values))
    return demand, constrained, findings


def _commands(braking: _Braking, demand: Floats) -> tuple[Command, ...]:
    """A demand [N], shape (n,), without noise, which would cost air."""
    seconds = ((braking.t - braking.t[0]) * 1e-9).tolist()
    current = max(float(demand[0]), _FILLED_FORCE)
    commands = [Command(0.0, clamping_force=current)]
    for i, force in enumerate(demand[1:].tolist()):
        if abs(force - current) > _NOISE * demand.max():
            current = force
        commands.append(Command(seconds[i], None, current, seconds[i + 1] - seconds[i]))
    return tuple(commands)


def _track(
    places: Sequence[_AxlePlaces], rails: Sequence[Condition | None], scale: float = 1.0
) -> RailConditions:
    """Each axle's rail at its places, in their order; dry elsewhere.

    A rail that is None is dry. `scale` is true over computed μ, of these rails.
    """
    limits = {x for axle in places for place in axle.spans for x in place if x < INF}
    of_levels = (axle.level_places for axle in places)
    knots = np.unique(np.concatenate([[0.0, *limits, *(x + _BLEND for x in limits)], *of_levels]))
    dry = np.array(condition("dry"))
    values = []
    for axle, rail in zip(places, rails, strict=True):
        weight = np.zeros(len(knots))
        for x_start, x_stop in axle.spans:
            weight += np.clip((knots - x_start) / _BLEND, 0.0, 1.0)
            weight -= np.clip((knots - x_stop) / _BLEND, 0.0, 1.0)
        conditions = np.tile(_without_excess(rail) if rail else dry, (len(knots), 1))
        if rail and axle.course:
            level = scale * replay_rail.levels(axle.course, _without_excess(rail), axle.vehicle)
            level = level[::_LEVEL_STRIDE]
            conditions[:, :3] *= np.interp(knots, axle.level_places, level)[:, None]
            conditions[:, :2] = np.minimum(conditions[:, :2], 1.0)
        rail_values = dry + weight[:, None] * (conditions - dry)
        values.append([*rail_values, rail_values[-1]])
    return RailConditions(False, np.array([*knots, INF]), np.array(values), 0.0, 1.0)


def _without_excess(rail: Condition) -> Condition:
    """The rail with kA and kS of at most those of (3) without reduction."""
    return rail._replace(k_a=min(rail.k_a, 1.0), k_s=min(rail.k_s, 1.0))


def compared(by_law: Mapping[str, Sequence[Verdict]]) -> dict[str, Compared]:
    """Each controller compared with the others, by its stops: the same rail in each place."""
    distances = {law: [v.stopping_distance_m for v in stops] for law, stops in by_law.items()}
    smallest = np.min(list(distances.values()), axis=0)
    is_unique = np.sum(np.array(list(distances.values())) == smallest, axis=0) == 1
    answers = {}
    for law, runs in distances.items():
        saving = np.subtract(distances["patent"], runs).tolist()
        first_share = float(np.mean((np.array(runs) == smallest) & is_unique))
        answers[law] = Compared(interval(saving) if law != "patent" else None, first_share)
    return answers


def on_all_cores(
    run_job: Callable[[Job], JobAnswer], jobs: Sequence[Job], progress: Callable[[str], None]
) -> list[JobAnswer]:
    """`run_job` of every job, in the order of the jobs; compile shared functions before."""
    results: list[JobAnswer] = []
    for x in threads.run_ahead(run_job, jobs):
        results.append(x)
        progress(f"{len(results)} of {len(jobs)} done")
    return results


def interval(values: Sequence[float | None]) -> tuple[float, float, float] | None:
    """Median, 2.5 % and 97.5 % quantile of the values; None without a value."""
    finite = [x for x in values if x is not None]
    if not finite:
        return None
    lower, middle, upper = np.quantile(finite, [0.025, 0.5, 0.975]).tolist()
    return middle, lower, upper


def intervals(stops: Sequence[Verdict]) -> Values:
    """`interval` of every field of the verdicts."""
    columns = zip(*stops, strict=True)
    return {k: interval(x) for k, x in zip(Verdict._fields, columns, strict=True)}
