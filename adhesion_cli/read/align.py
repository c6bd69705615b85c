"""Channels of different rates to one record per axle, on the wheel speed's own time."""

from collections.abc import Sequence

import numpy as np

from ..errors import UserError
from ..model import AxleRecord, Bools, Channel, Finding, Floats, Log, Meaning, Times, Vehicle
from ..physics import clamping_force
from . import timeaxis

SHORTEST = 3  # samples: fewer give no derivative with an error


def records(
    log: Log,
    vehicle: Vehicle,
    axles: Sequence[int] = (),
    window: tuple[float | None, float | None] = (None, None),
) -> tuple[list[AxleRecord], list[Finding]]:
    """One record per axle that has a wheel speed and a pressure (or K).

    Args:
        log: with its channels' meanings.
        vehicle: for (15).
        axles: only these, all if empty.
        window: only the samples between these seconds after the log's start.

    Raises:
        UserError: where a needed channel is missing, an axle asked for is not there, or no two
            channels share any time.
    """
    speeds, pressures = _by_axle(log, "wheel_speed"), _by_axle(log, "pressure")
    forces, trains, truths = (_by_axle(log, m) for m in ("clamping_force", "train_speed", "truth"))
    if not speeds:
        raise _missing(log, "wheel speed", 'speed."axle 1" = {channel = "…", unit = "km/h"}')
    if not pressures and not forces:
        raise _missing(
            log, "brake-cylinder pressure", 'pressure."axle 1" = {channel = "…", unit = "bar"}'
        )
    numbers = sorted({a for d in (speeds, pressures, forces) for a in d if a}) or [1]
    if unknown := set(axles) - set(numbers):
        raise UserError(
            f"{log.path}: no axle {min(unknown)}",
            f"the log has axles {', '.join(map(str, numbers))}",
            code=2,
        )
    found: list[AxleRecord] = []
    findings: list[Finding] = []
    for axle in axles or numbers:
        speed = _of(speeds, axle)
        brake = _of(pressures, axle) or _of(forces, axle)
        if not speed or not brake:
            lacking = "wheel speed" if not speed else "pressure or clamping force"
            name = (speed or brake).name  # type: ignore[union-attr]
            text = f"axle {axle} has no {lacking}: not analysed"
            findings.append(Finding("axle-incomplete", "warning", text, name))
            continue
        record, told = _record(
            log, vehicle, axle, speed, brake, _of(trains, axle), _of(truths, axle), window
        )
        findings += told
        if record:
            found.append(record)
    if not found:
        raise _nothing(log, speeds, pressures or forces, window)
    return found, findings


def _by_axle(log: Log, meaning: Meaning) -> dict[int | None, Channel]:
    return {c.axle: c for c in log.channels if c.meaning == meaning}


def _of(channels: dict[int | None, Channel], axle: int) -> Channel | None:
    """An axle's own channel, else the one that is nobody's: a train or a bogie has one pressure."""
    return channels.get(axle) or channels.get(None)


def _record(
    log: Log, vehicle: Vehicle, axle: int, speed: Channel, brake: Channel,
    train: Channel | None, truth: Channel | None, window: tuple[float | None, float | None],
) -> tuple[AxleRecord | None, list[Finding]]:  # fmt: skip
    findings: list[Finding] = []
    start = log.start_ns()
    pieces = [
        slice(a, b)
        for a, b in zip(speed.starts, (*speed.starts[1:], len(speed.data.t)), strict=True)
    ]
    columns: list[tuple[Floats, ...]] = []
    ok: list[Bools] = []
    for piece in pieces:
        t = speed.data.t[piece]
        span = (int(t[0]), int(t[-1]))
        held, fresh = timeaxis.hold(t, brake, timeaxis.piece_over(brake, *span))
        smooth = timeaxis.interpolated(t, brake, timeaxis.piece_over(brake, *span))
        others = [
            timeaxis.interpolated(t, c, timeaxis.piece_over(c, *span))
            if c
            else np.full(len(t), np.nan)
            for c in (train, truth)
        ]
        columns.append((held, np.where(np.isfinite(smooth), smooth, held), *others))
        ok.append(fresh)
    held, smooth, v, truth_force = (np.concatenate(c) for c in zip(*columns, strict=True))
    usable = np.concatenate(ok)
    t, y = speed.data.t, speed.data.value
    since = (t - start) / 1e9
    inside = (since >= (window[0] if window[0] is not None else -np.inf)) & (
        since <= (window[1] if window[1] is not None else np.inf)
    )
    if lost := int((~usable & inside).sum()):
        first = float(since[np.argmax(~usable & inside)])
        edge = max(brake.gap_ns, speed.gap_ns) / 1e9
        within = (since >= (brake.data.t.min() - start) / 1e9) & (
            since <= (brake.data.t.max() - start) / 1e9
        )
        hole = bool((~usable & inside & within).any()) or lost * _interval(t) > 2 * edge
        text = f"wheel speed of axle {axle} without a fresh {brake.meaning}: left out"
        findings.append(
            Finding("no-pressure", "warning" if hole else "info", text, speed.name, lost, first)
        )
    is_pressure = brake.meaning == "pressure"
    K, K_smooth = (
        (clamping_force(held, vehicle), clamping_force(smooth, vehicle))
        if is_pressure
        else (held, smooth)
    )
    K_step = brake.step
    if is_pressure:  # (15) is a straight line once the pads are on
        on = np.array([1e6, 1e6 + brake.step])
        K_step = float(np.diff(clamping_force(on, vehicle))[0])
    frozen = _frozen(t, y, held, speed)
    if count := int((frozen & usable & inside).sum()):
        first = float(since[np.argmax(frozen)])
        text = "the speed stands still while the brake is applied and the wheel turns: left out"
        findings.append(Finding("speed-frozen", "warning", text, speed.name, count, first))
    keep = usable & inside & ~frozen
    broken = np.zeros(len(t), dtype=np.bool_)
    broken[list(speed.starts)] = True
    broken[1:] |= (np.diff(t) > speed.gap_ns) | (frozen[:-1] & ~frozen[1:])
    segments, kept = _segments(t, keep, broken, speed.gap_ns)
    if short := int(keep.sum()) - int(kept.sum()):
        text = f"pieces of fewer than {SHORTEST} samples: left out"
        findings.append(Finding("too-short", "warning", text, speed.name, short))
    if not segments:
        return None, findings
    return AxleRecord(
        axle, t[kept], K[kept], K_smooth[kept], y[kept], segments, speed.step,
        held[kept] if is_pressure else None,
        v[kept] if train else None,
        truth_force[kept] if truth else None,
        K_step,
    ), findings  # fmt: skip


def _segments(t: Times, keep: Bools, broken: Bools, gap_ns: int) -> tuple[tuple[slice, ...], Bools]:
    """Runs of kept samples without a break, and the mask of the samples in them."""
    index = np.flatnonzero(keep)
    if not len(index):
        return (), keep
    breaks = np.cumsum(broken)[index]
    new = np.diff(breaks, prepend=-1) != 0
    new[1:] |= np.diff(t[index]) > gap_ns
    run = np.cumsum(new) - 1
    long = np.bincount(run) >= SHORTEST
    kept = np.zeros(len(t), dtype=np.bool_)
    kept[index[long[run]]] = True
    stops = np.cumsum(np.bincount(run)[long])
    return tuple(
        slice(int(b - n), int(b)) for b, n in zip(stops, np.bincount(run)[long], strict=True)
    ), kept


def _frozen(t: Times, y: Floats, brake: Floats, speed: Channel) -> Bools:
    """Samples at which a stuck sensor repeats its last value.

    A run of equal values is stuck where the wheel turns, the brake is applied (above a fifth of
    its highest value) and, at the rate the speed usually changes with the brake applied, it would
    have moved by more than six quantisation steps; and where the speed then jumps by a good part
    of that, or never changes again. A wheel that turns from sliding to recovering stands at one
    value too, but leaves it gently.
    """
    frozen = np.zeros(len(t), dtype=np.bool_)
    top = float(np.nanmax(brake, initial=0.0))
    applied = (brake > 0.2 * top) & (y > 0.0) if top > 0.0 else frozen
    dt = np.diff(t) / 1e9
    regular = applied[1:] & applied[:-1] & (dt > 0.0) & (np.diff(t) <= speed.gap_ns)
    if not regular.any():
        return frozen
    rate = float(np.abs(np.diff(y))[regular].sum() / dt[regular].sum())
    change = np.flatnonzero(np.diff(y, prepend=np.nan) != 0)
    for a, b in zip(change, [*change[1:], len(y)], strict=True):
        if b - a >= 3 and applied[a:b].all():
            expected = rate * (int(t[b - 1]) - int(t[a])) / 1e9
            jumps = b == len(y) or abs(float(y[b] - y[a])) > 0.3 * expected
            if jumps and expected > max(6.0 * speed.step, 0.02 * float(y[a])):
                frozen[a + 1 : b] = True
    return frozen


def _interval(t: Times) -> float:
    return float(np.median(np.diff(t))) / 1e9 if len(t) > 1 else 0.0


def _missing(log: Log, what: str, example: str) -> UserError:
    names = ", ".join(repr(c.name) for c in log.channels[:8]) or "none"
    return UserError(
        f"{log.path}: no channel is a {what} (recognised: {names})",
        "`adhesion inspect` lists the channels; map one in a TOML given with -c: "
        f"[channels] {example}",
    )


def _nothing(
    log: Log, speeds: dict[int | None, Channel], brakes: dict[int | None, Channel],
    window: tuple[float | None, float | None],
) -> UserError:  # fmt: skip
    def span(channels: dict[int | None, Channel]) -> str:
        first = min(int(c.data.t.min()) for c in channels.values())
        last = max(int(c.data.t.max()) for c in channels.values())
        return f"{first / 1e9:.3f} to {last / 1e9:.3f} s"

    usual = max(len(c.data.t) for c in speeds.values())
    if usual < SHORTEST:
        return UserError(
            f"{log.path}: {usual} usable wheel-speed samples; at least {SHORTEST} are needed",
            f"`adhesion inspect {log.path}` shows what was left out and why",
        )
    if window != (None, None):
        return UserError(
            f"{log.path}: no sample between --from and --to",
            "seconds after the log's start",
            code=2,
        )
    return UserError(
        f"{log.path}: no overlap in time of wheel speed ({span(speeds)}) "
        f"and pressure ({span(brakes)})",
        'state the clock in [channels], e.g. time = {source = "log"}, or convert one of them',
    )
