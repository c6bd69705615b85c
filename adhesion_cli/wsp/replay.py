"""What each controller would have done in a logged stop.

Rail. `replay_rail` gives the rail under each axle that slid, and where it lies. Elsewhere, and
under an axle that never slid, the rail counts as dry.

Demand. It is the clamping force of the axles that never slid. If every axle slid, the WSP dumped
air from each, and the demand counts as the largest force so far. If it was not steady before the
slides, or grew in them, half of the draws have more, up to what locks a wheel on dry rail. There is
then no dry distance. The demand begins earlier by the time in which cylinders fill against their
springs. If the brake was released before standstill, the demand continues.

Train. It has the log's axles and its speed at the start of the brake. The track is level, and the
WSP controller is that of `scenario.Antiskid`.

Uncertainty. A draw has a rail under each axle and one true pad friction. How friction falls in deep
slides is the same choice under all axles. The intervals do not contain the errors of the
assumptions above.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..core import physics
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Bools, Floats, Result, Times, Vehicle
from ..core.stop import JUDGED_FROM, STANDING, Stop, Verdict
from ..core.text import printable
from ..rail import fit, slip
from ..rail.creep_law import Condition, condition
from ..rail.events import Slide
from ..rail.fit import RailFit
from ..train.longitudinal import STATED_SIGMAS, tolerance
from . import closed_loop, replay_rail
from .plant import Track
from .replay_rail import Under
from .scenario import INF, Antiskid, Brake, Command, Scenario, Train
from .sweep import Compared, Values, compared, intervals, on_all_cores
from .wsp_controller import Settings

_EVERY = 0.1  # between two knots of the demand [s]
_OFFSET = 0.1  # share of it: a smaller least value is a sensor's offset
_PAUSE = 2.0  # longest time without brake and slide within one brake application [s]
_DRAWS = 40  # of the fit that are simulated
_NOISE = 0.01  # share of the largest demand: least change of it
_STOOD, _EVEN = 1.0, 0.03  # least time [s] and largest change (share) of a steady demand
_LEAST = 1.0  # clamping force for which a cylinder is filled up to its spring's force [N]
_BEFORE = 5.0  # of a stop that a hint names [s]
_BLEND = 0.1  # from the dry rail to the fitted one [m]


class Case(NamedTuple):
    """A stop of a log, ready to be run again."""

    start_s: float  # of the brake, after the log's start [s]
    scenario: Scenario  # train and demand
    track: Track  # the best fit
    draws: list[tuple[Scenario, Track]]
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


class _Braking(NamedTuple):
    """The stop on a grid of `_EVERY` from the start of the brake; all shape (n,)."""

    t: Times  # [ns]
    speed: Floats  # of the train [m/s]
    K: Floats  # clamping force of each axle [N], shape (axles, n)


def case(result: Result, train_speed: Literal["measured", "axles"] | None = None) -> Case:
    """The stop of a log with the longest slide, and the rails that are likely under it.

    Args:
        result: the analysed log.
        train_speed: source of the WSP's train speed, if not that of `scenario.Antiskid`.

    Raises:
        UserError: where the log does not show the rail, with the reason.
    """
    name = printable(Path(result.log.path).name)
    slides = [slip.slides(axle) for axle in result.axles]
    if not any(slides):
        raise UserError(
            f"{name}: no axle slides, so the adhesion available is not known",
            "replay a log with slides",
        )
    braking = _braking(result, slides)
    if not braking.speed[0] > JUDGED_FROM:
        text = f"{name}: the train does not move when the brake is applied"
        raise UserError(text, "choose a stop with --from and --to")
    begin, end = braking.t[[0, -1]].tolist()
    under, findings = _under(result, slides, begin, end)
    firsts = [x.spans[0][0] if x else 0 for x in under]
    places = [
        [(_distance(braking, a), INF if b is None else _distance(braking, b)) for a, b in x.spans]
        if x
        else []
        for x in under
    ]
    asked, known, told = _demand(braking, firsts, result.log.start_ns())
    radii = tuple(result.vehicle.radius(a.record.axle) for a in result.axles)
    scenario = Scenario(
        Path(name).stem, "a stop of a log", closed_loop.LONGEST, closed_loop.DRY,
        train=Train(float(braking.speed[0]), len(radii)), brake=Brake(_commands(braking, asked)),
        vehicle=replace(result.vehicle, wheel_radius=radii),
    ).with_train_speed(train_speed)  # fmt: skip
    rails = [x and x.rail for x in under]
    stands = bool(braking.speed[-1] < STANDING)
    return Case(
        (begin - result.log.start_ns()) / 1e9, scenario,
        _track(places, [rail and rail.best for rail in rails]),
        _draws(scenario, braking, rails, places, (asked, known)),
        _distance(braking, end) if stands else None, bool(known.all()),
        [*findings, *told, *_in_part(result, braking)],
    )  # fmt: skip


def _under(
    result: Result, slides: Sequence[Sequence[Slide]], begin: int, end: int
) -> tuple[list[Under | None], list[Finding]]:
    """The rail under every axle that slid in the stop, and findings about it.

    Raises:
        UserError: the slides of an axle show no rail. The hint names what helps.
    """
    found: list[Under | None] = []
    findings, refused, start = list[Finding](), list[tuple[int, UserError]](), result.log.start_ns()
    for axle, own in zip(result.axles, slides, strict=True):
        number, under = axle.record.axle, None
        if inside := [x for x in own if begin <= x.start <= end]:
            try:
                under, told = replay_rail.under(axle, result.vehicle, inside, begin, end)
            except UserError as error:
                refused.append((number, error))
            else:
                findings += told
                if spans := [((a - start) / 1e9, (b - start) / 1e9) for a, b in under.spans if b]:
                    findings.append(
                        Finding("replay-rail-ends", "info", f"axle {number}", spans=tuple(spans))
                    )
        found.append(under)
    if not refused:
        return found, findings
    number, why = refused[0]
    hints = [why.hint]
    if others := [x for own in slides for x in own if not begin <= x.start <= end]:
        first, last = _brake(result, slides, max(others, key=lambda x: x.duration).start)
        begins = max((first - start) / 1e9 - _BEFORE, 0.0)
        hints.append(f"Or replay another stop: --from {begins:.0f} --to {(last - start) / 1e9:.0f}")
    elif any(found):
        out = {n for n, _ in refused}
        rest = (x.record.axle for x in result.axles if x.record.axle not in out)
        hints.append(f"Or leave the axle out: {' '.join(f'--axle {n}' for n in rest)}")
    name = printable(Path(result.log.path).name)
    text = f"{name}: no rail to replay under axle {number}: {why.text}"
    raise UserError(text, " ".join(hints))


def _draws(
    scenario: Scenario,
    braking: _Braking,
    rails: Sequence[RailFit | None],
    places: Sequence[Sequence[tuple[float, float]]],
    demand: tuple[Floats, Bools],
) -> list[tuple[Scenario, Track]]:
    """Stops that are as likely as the best fit; `demand` and where it is known, from `_demand`."""
    random = np.random.default_rng(0)
    (asked, known), vehicle, draws = demand, scenario.vehicle, []
    phi = vehicle.friction
    most = condition("dry").f0 * physics.G * vehicle.axle_mass.value
    most = max(most / phi.value, float(asked.max()))
    drawn = _drawn(rails, vehicle, random)
    for k, scale in enumerate(next(rail.scales for rail in rails if rail)[:_DRAWS]):
        truly = replace(vehicle, friction=phi._replace(value=phi.value * scale))
        track = _track(places, [of[k] if of else None for of in drawn])
        more = (most / np.maximum(asked, _LEAST)) ** max(random.uniform(-1.0, 1.0), 0.0)
        brake = Brake(_commands(braking, np.where(known, 1.0, more) * asked))
        draws.append((replace(scenario, vehicle=truly, brake=brake), track))
    return draws


def answers(
    case: Case, algo: str, settings: Settings, seed: int, tell: Callable[[str], None]
) -> tuple[float | None, dict[str, Answer]]:
    """Dry distance [m], None where the demand is not known, and every controller's stop, by name.

    Args:
        case: the stop.
        algo: online estimator in the loop.
        settings: as in `closed_loop.run`.
        seed: of the sensors' noise.
        tell: gets the progress.

    Raises:
        UserError: as `closed_loop.run`.
    """

    def stops(
        draw: tuple[Scenario, Track], tell: Callable[[str], None] = lambda _: None
    ) -> tuple[float, dict[str, tuple[Stop, Verdict]]]:
        return closed_loop.side_by_side(draw[0], seed, algo, settings, tell, draw[1])

    def verdicts(draw: tuple[Scenario, Track]) -> dict[str, Verdict]:
        return {law: v for law, (_, v) in stops(draw)[1].items()}

    dry, best = stops((case.scenario, case.track), tell)
    drawn = on_all_cores(verdicts, case.draws, tell)
    by_law = {law: [draw[law] for draw in drawn] for law in best}
    paired, found = compared(by_law, np.median), {}
    for law, (stop, _) in best.items():
        values = intervals(by_law[law], np.median)
        known = values if case.demanded else {**values, "extension": None}
        found[law] = Answer(stop, known, paired[law])
    return dry if case.demanded else None, found


def _drawn(
    rails: Sequence[RailFit | None], vehicle: Vehicle, random: np.random.Generator
) -> list[list[Condition] | None]:
    """Draws of every axle's rail; draw k has similar adhesion of locked wheels under all axles.

    The slides do not show how far friction falls. Independent draws of it under each axle would
    average out, and the stop would seem too certain.
    """
    order: NDArray[np.int64] | None = None
    found: list[list[Condition] | None] = []
    for rail in rails:
        if rail is None:
            found.append(None)
            continue
        scales = rail.scales[:_DRAWS]
        own = [replay_rail.scaled_by(x, 1.0 / c) for x, c in zip(rail.draws, scales, strict=False)]
        own.sort(key=lambda x: float(fit.curve(x, rail.speed, np.ones(1), vehicle)[0]))
        order = random.permutation(len(own)) if order is None else order
        found.append(
            [replay_rail.scaled_by(own[i], c) for i, c in zip(order.tolist(), scales, strict=True)]
        )
    return found


def _braking(result: Result, slides: Sequence[Sequence[Slide]]) -> _Braking:
    """From the demand of the brake in which the longest slide lies, to standstill or release."""
    slide = max((x for found in slides for x in found), key=lambda x: x.duration)
    start, end = _brake(result, slides, slide.start)
    filled = float(physics.cylinder_pressure(physics.force_line(result.vehicle), 0.0))
    start -= round(filled / Antiskid().fill_rate * 1e9)
    start = max(start, *(int(a.record.t[0]) for a in result.axles))
    t = np.arange(start, end, round(_EVERY * 1e9), dtype=np.int64)
    speed = _column(t, result.axles[0].record.t, result.axles[0].record.train_speed)
    K = np.array([_column(t, a.record.t, a.record.clamping_force_smooth) for a in result.axles])
    stands = speed < STANDING
    past = int(np.argmax(stands)) + 1 if stands.any() else len(t)
    past = max(_last_full(K[:, :past].max(axis=0)), int(np.searchsorted(t, slide.start))) + 1
    return _Braking(t[:past], speed[:past], K[:, :past])


def _brake(result: Result, slides: Sequence[Sequence[Slide]], at: int) -> tuple[int, int]:
    """When the brake applied at that time began, and when the next one or the log's end is [ns].

    A WSP may dump every cylinder, but while a wheel slides and for a short time. A release lasts,
    and no wheel slides.
    """
    spans = [(x.start, x.start + round(x.duration * 1e9)) for found in slides for x in found]
    for a in result.axles:
        spans += [(int(a.record.t[s.start]), int(a.record.t[s.stop - 1])) for s in a.applications]
    spans.sort()
    begin, end = spans[0]
    for first, last in spans[1:]:
        if first - end > _PAUSE * 1e9:
            if end >= at:
                return begin, first
            begin = first
        end = max(end, last)
    return begin, max(int(a.record.t[-1]) for a in result.axles)


def _last_full(asked: Floats) -> int:
    """Index at which the brake begins to be released.

    Args:
        asked: the largest clamping force of all axles [N], shape (n,).
    """
    most = float(asked.max())
    least = float(asked.min())
    none = (least if least < _OFFSET * most else 0.0) + physics.RELEASED_SHARE * most
    top = i = max(np.flatnonzero(asked > none).tolist(), default=0)
    if top == len(asked) - 1:
        return top
    while i > 0 and (top - i) * _EVERY < _STOOD:
        i -= 1
        if asked[i] > asked[top] + _NOISE * most:
            top = i
    return top


def _in_part(result: Result, braking: _Braking) -> list[Finding]:
    """Findings where other axles or forces slowed the train, too."""
    mine = {a.record.axle for a in result.axles}
    speeds = [c for c in result.log.channels if c.meaning == "wheel_speed" and len(c.data.t)]
    if others := sorted({c.axle for c in speeds if c.axle} - mine):
        names = {"axles": ", ".join(map(str, others))}
        return [Finding("replay-axles-missing", "warning", names=names)]
    if any(a.record.train_speed_made for a in result.axles):
        return []
    F = sum(_column(braking.t, a.record.t, a.reference.force) for a in result.axles)
    mass = len(mine) * result.vehicle.axle_mass.value
    by_axles, lost = float(np.sum(F)) * _EVERY / mass, float(braking.speed[0] - braking.speed[-1])
    if by_axles > 0.0 and abs(lost / by_axles - 1.0) < STATED_SIGMAS * tolerance(result.vehicle):
        return []
    span = ((braking.t[[0, -1]] - result.log.start_ns()) * 1e-9).tolist()
    values = {"lost_mps": lost, "explained_mps": by_axles}
    return [Finding("replay-train-differs", "warning", spans=((span[0], span[1]),), values=values)]


def _column(at: Times, t: Times, values: Floats | None) -> Floats:
    assert values is not None  # `analyze` makes a train speed where there is none
    known = np.isfinite(values)
    return np.interp(at, t[known], values[known])


def _distance(braking: _Braking, until: int) -> float:
    """Distance of the train until then [m]."""
    seconds = (braking.t - braking.t[0]) * 1e-9
    run = np.concatenate([[0.0], np.cumsum((braking.speed[1:] + braking.speed[:-1]) / 2.0)])
    return float(np.interp((until - braking.t[0]) * 1e-9, seconds, run * _EVERY))


def _demand(
    braking: _Braking, firsts: Sequence[int], start_ns: int
) -> tuple[Floats, Bools, list[Finding]]:
    """The least demand [N], where it is the demand itself, and findings; shape (n,).

    Args:
        braking: the stop.
        firsts: when each axle began to slide, 0: it did not.
        start_ns: the log's start.
    """
    free, findings = [first == 0 for first in firsts], []
    at = (braking.t - start_ns) * 1e-9
    known: Bools = np.ones(len(braking.t), dtype=np.bool_)
    if any(free):
        asked: Floats = braking.K[free].max(axis=0)
    else:
        # From here on, no axle shows the demand.
        last = max(int(np.searchsorted(braking.t, max(firsts))), 1)
        rolling = braking.t < np.array(firsts)[:, None]
        rolling[:, 0] = True
        asked = np.where(rolling, braking.K, 0.0).max(axis=0)
        most = np.maximum.accumulate(braking.K[:, last:].max(axis=0))
        asked[last:] = np.maximum(most, asked[last - 1])
        before = asked[:last][-1 - round(_STOOD / _EVERY) :]
        stood = len(before) * _EVERY > _STOOD and np.ptp(before) < _EVEN * before[-1]
        spans = ((float(at[last]), float(at[-1])),)
        if stood and asked[-1] < (1.0 + _EVEN) * before[-1]:
            findings.append(Finding("demand-estimated", "info", spans=spans))
        else:
            known[last:] = False
            force = {"force_n": float(asked.max())}
            findings.append(Finding("demand-unknown", "warning", spans=spans, values=force))
    if braking.speed[-1] >= STANDING:
        values, end = {"speed_mps": float(braking.speed[-1])}, float(at[-1])
        findings.append(Finding("stop-extended", "info", spans=((end, end),), values=values))
    return asked, known, findings


def _commands(braking: _Braking, asked: Floats) -> tuple[Command, ...]:
    """A demand [N], shape (n,), without noise, which would cost air."""
    seconds = ((braking.t - braking.t[0]) * 1e-9).tolist()
    now = max(float(asked[0]), _LEAST)
    commands = [Command(0.0, clamping_force=now)]
    for i, force in enumerate(asked[1:].tolist()):
        if abs(force - now) > _NOISE * asked.max():
            now = force
        commands.append(Command(seconds[i], None, now, seconds[i + 1] - seconds[i]))
    return tuple(commands)


def _track(
    places: Sequence[Sequence[tuple[float, float]]], rails: Sequence[Condition | None]
) -> Track:
    """Each axle's rail at its places, from and to [m], in order; dry elsewhere."""
    ends = {x for axle in places for place in axle for x in place if x < INF}
    knots = np.unique([0.0, *ends, *(x + _BLEND for x in ends)])
    dry = np.array(condition("dry"))
    values = []
    for axle, rail in zip(places, rails, strict=True):
        part = np.zeros(len(knots))
        for first, last in axle:
            part += np.clip((knots - first) / _BLEND, 0.0, 1.0)
            part -= np.clip((knots - last) / _BLEND, 0.0, 1.0)
        there = np.array(rail or dry)
        there[:2] = np.minimum(there[:2], 1.0)  # kA and kS: at most those of (3) without reduction
        under = dry + part[:, None] * (there - dry)
        values.append([*under, under[-1]])
    return Track(False, np.array([*knots, INF]), np.array(values), 0.0, 1.0)
