"""A log file as channels with meaning, in SI, on clean time axes."""

import hashlib
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..core import time_axis, units
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import MADE, Channel, Column, Floats, Log, Meaning, Vehicle
from ..formats.source import Source
from .meaning import Mapping, Meant, first_name, name, title, understood

# What an analysis cannot do without, and the meanings that give it.
_KIND: dict[Meaning | None, str] = {
    "wheel_speed": "speed", "pressure": "brake", "clamping_force": "brake",
}  # fmt: skip
_FINEST = 2e-4  # of the shortest period: a tick so small is no more than noise
_ON_GRID = 0.9  # mean cosine of phases that lie on one
_MAY_BE = 0.5  # the same of the gaps between them, with their digits' rounding
_WITHOUT: tuple[Meaning, ...] = ("train_speed", "truth", "true_slip")  # what it can do without


def read(source: Source, mappings: Sequence[Mapping], vehicle: Vehicle, max_gap_ns: int = 0) -> Log:
    """The channels of an opened log that mean something, in SI, on clean time axes.

    Args:
        source: the opened log.
        mappings: what the user stated about its channels.
        vehicle: for the wheel radius, where a wheel speed is in km/h.
        max_gap_ns: longer intervals are gaps; 0 decides per channel.

    Raises:
        UserError: where the log cannot be read, a unit that is needed cannot be known, or a
            channel has no usable sample.
    """
    chosen, findings = needed(source, mappings)
    log = _log(source, chosen, findings, lambda m, c, t0: _channel(m, c, vehicle, t0, max_gap_ns))
    return without_empty(log)


def needed(source: Source, mappings: Sequence[Mapping]) -> tuple[list[Meant], list[Finding]]:
    """What an analysis takes of a log, each with its unit known, and what was found on the way.

    Raises:
        UserError: where a unit that is needed cannot be known.
    """
    meant, findings = _understood(source, mappings)
    chosen = [m for m in meant if m.meaning]
    _refuse_two_units(chosen, source.path)
    _refuse_repeated(chosen, source, {m.meaning for m in mappings})
    braked = {m.axle for m in chosen if m.meaning == "pressure"}
    for m in list(chosen):
        spare = m.meaning == "clamping_force" and m.axle in braked  # K comes from p by (15)
        if not m.unit and (spare or m.meaning in _WITHOUT):
            chosen.remove(m)
            text = f"looks like {m.meaning}, but {_lacks(m)}: left out"
            findings.append(Finding("unit-unknown", "warning", text, title(m.field)))
        else:
            _unit_of(m, source.path)
    return chosen, findings


def _refuse_repeated(chosen: Sequence[Meant], source: Source, mapped: set[Meaning]) -> None:
    """Refuses a name that is needed and stands above several columns, unless they were mapped.

    Raises:
        UserError: names both as the reader tells them apart.
    """
    again = {(first_name(f.channel), f.group): f.channel for f in reversed(source.fields)}
    for m in chosen:
        second = again.get((m.field.channel, m.field.group))
        if second and m.meaning in _KIND and m.meaning not in mapped:
            raise UserError(
                f"{source.path}: several columns are called {m.field.channel!r}: which one is the "
                f"{m.meaning.replace('_', ' ')} is not stated",  # type: ignore[union-attr]
                f"state it in a TOML given with -c: [channels] {_key(m)} = {{channel = "
                f'"{m.field.channel}", unit = "…"}}; the next one is called "{second}"',
            )


def _refuse_two_units(chosen: Iterable[Meant], path: Path) -> None:
    """Refuses a channel whose unit is stated in two ways.

    Raises:
        UserError: names both.
    """
    for m in chosen:
        if m.unit_too:
            field = f', field = "{m.field.path}"' if m.field.path else ""
            raise UserError(
                f"{path}: the unit of channel {title(m.field)!r} is stated twice: "
                f"{m.unit!r} ({m.field.unit_from or 'in the name'}) and {m.unit_too!r} (in the "
                "name)",
                f"state it in a TOML given with -c: [channels] {_key(m)} = "
                f'{{channel = "{m.field.channel}"{field}, unit = "…"}}',
            )


def _understood(source: Source, mappings: Sequence[Mapping]) -> tuple[list[Meant], list[Finding]]:
    """`understood`; a result of ours says itself what it holds, mappings are about raw logs."""
    fields = [f for f in source.fields if f.message_type != "adhesion.Event"]  # told, not measured
    if source.metadata.get("adhesion.provenance", {}).get("train_speed") == MADE:
        fields = [f for f in fields if f.path != "train_speed"]  # of the axles, as it will be again
    return understood(fields, () if "adhesion.settings" in source.metadata else mappings)


def without_empty(log: Log) -> Log:
    """The log, of channels with a meaning, without those that hold no number, told.

    Raises:
        UserError: where nothing is left of something that is needed.
    """
    full = [c for c in log.channels if len(c.data.t)]
    there = {_KIND.get(c.meaning) for c in full}
    findings = []
    for c in log.channels:
        if len(c.data.t):
            continue
        kind = _KIND.get(c.meaning)
        if kind and kind not in there:
            why, hint = "", f"`adhesion inspect {log.path}` shows why"
            if coarse := next((f for f in log.findings if f.code == "time-coarse"), None):
                text, _, hint = coarse.message.rpartition("; ")
                why = f": {text}"
            raise UserError(
                f"{log.path}: channel {c.title!r} has no usable sample ({c.rows} in the log){why}",
                hint,
            )
        covered = kind is None or any(
            _KIND.get(f.meaning) == kind and f.axle == c.axle for f in full
        )
        text = f"no sample holds a number: the log has no {c.meaning} there"
        findings.append(Finding("empty-channel", "info" if covered else "warning", text, c.title))
    return replace(log, channels=tuple(full), findings=(*log.findings, *findings))


def survey(source: Source, mappings: Sequence[Mapping], vehicle: Vehicle) -> Log:
    """Every numeric channel of an opened log on its clean time axis; SI where the unit is known."""
    meant, findings = _understood(source, mappings)
    log = _log(source, meant, findings, lambda m, c, t0: _channel(m, c, vehicle, t0, 0))
    # Counters and stamps in ns that mean nothing to us may be rounded.
    used = {f"{m.field.channel} {m.field.path}" for m in meant if m.meaning}
    told = [
        f
        for f in log.findings
        if f.code != "mcap-rounded" or f"{f.channel} {f.names['field']}" in used
    ]
    return replace(log, findings=tuple(told))


def unchanged(source: Source, mappings: Sequence[Mapping]) -> Log:
    """Every numeric channel of an opened log as it is, in its own unit: for `convert`.

    What a channel is taken for is nothing to a copy: neither told, nor a channel twice where it
    serves two axles. A channel without a single number is left out, and that is told.

    Raises:
        UserError: where no channel holds a number, or the unit of one that means something is
            stated in two ways.
    """
    meant = {m.field: m for m in _understood(source, mappings)[0]}.values()
    _refuse_two_units(meant, source.path)  # the copy would state one of them

    def as_logged(m: Meant, column: Column, start: int) -> tuple[Channel, list[Finding]]:
        # No meaning: what has one is SI.
        place = (name(m.field), m.field.path, None, m.axle, m.unit, m.reason)
        return Channel(*place, column, len(column.t), label=m.field.label), []

    log = _log(source, list(meant), [], as_logged)
    empty = [c for c in log.channels if not c.data.valid.any()]
    if len(empty) == len(log.channels):
        hint = f"`adhesion inspect {log.path}` shows why"
        raise UserError(f"{log.path}: no channel holds a number", hint)
    text = "no sample holds a number: not copied"
    told = [Finding("empty-channel", "info", text, c.title) for c in empty]
    full = tuple(c for c in log.channels if c.data.valid.any())
    return replace(log, channels=full, findings=(*log.findings, *told))


def _log(
    source: Source,
    chosen: Sequence[Meant],
    findings: list[Finding],
    channel: Callable[[Meant, Column, int], tuple[Channel, list[Finding]]],
) -> Log:
    columns = source.columns([m.field for m in chosen])
    times = {id(c.t): c.t for c in columns if len(c.t)}
    start = min((time_axis.earliest(t) for t in times.values()), default=0)
    times.clear()
    channels = []
    clocks = [id(c.t) for c in columns]
    told: list[tuple[int, Finding]] = []
    columns.reverse()
    for m, clock in zip(chosen, clocks, strict=True):
        # what was read is let go with each channel made of it
        made, found = channel(m, columns.pop(), start)
        channels.append(made)
        told += ((clock, f) for f in found)
    findings += _once(told)
    return Log(
        str(source.path), source.format, _sha256(source.path), source.absolute, source.rows,
        tuple(channels), (*source.findings, *findings), source.rejects,
        source.account,
    )  # fmt: skip


def _once(told: Sequence[tuple[int, Finding]]) -> list[Finding]:
    """The findings, one in place of those that differ in nothing but the channels of one clock.

    Args:
        told: each with its channel's clock.
    """
    alike: dict[tuple[int, Finding], list[str]] = {}
    for clock, f in told:
        of_time = f.code == "gap" or f.code.startswith("time-")
        key = replace(f, channel="") if of_time else f
        alike.setdefault((clock, key), []).append(f.channel)
    findings = []
    for (_, f), names in alike.items():
        if len(names) == 1:
            findings.append(replace(f, channel=names[0]))
            continue
        text = f.text and f"{len(names)} channels of one clock: {f.text}"
        findings.append(replace(f, channel=", ".join(names), text=text))
    return findings


def _lacks(m: Meant) -> str:
    """What is wrong with the unit of a channel without one."""
    for text in (m.field.path, m.field.label, m.field.channel):
        if wrong := units.unknown_in(text):
            return f"its name states an unknown unit {wrong!r}"
    return "its unit is not stated"


def _key(m: Meant) -> str:
    """Where a channel of this meaning is stated under [channels]."""
    if m.meaning == "train_speed":
        return "train_speed"
    return f'{"speed" if m.meaning == "wheel_speed" else m.meaning}."axle {m.axle or 1}"'


def _unit_of(m: Meant, path: Path) -> units.Unit:
    """The unit of a channel with a meaning.

    Raises:
        UserError: where the log does not state it: a guess would be silently wrong.
    """
    assert m.meaning
    if not m.unit:
        known = ", ".join(units.known_units(m.meaning))
        field = f', field = "{m.field.path}"' if m.field.path else ""
        raise UserError(
            f"{path}: channel {title(m.field)!r} looks like the {m.meaning.replace('_', ' ')}, "
            f"but {_lacks(m)}",
            f"state it in a TOML given with -c: [channels] {_key(m)} = "
            f'{{channel = "{m.field.channel}"{field}, unit = "…"}}; one of {known}',
        )
    unit = units.stated(m.unit, m.meaning, title(m.field))
    if unit.dimension in ("pulse rate", "count") and not m.teeth:
        raise UserError(
            f"{path}: channel {title(m.field)!r} counts pulses ({m.unit}), pulses per turn unknown",
            f'state them with -c: [channels] speed."axle {m.axle or 1}" = '
            f'{{channel = "{m.field.channel}", unit = "{m.unit}", teeth = 80}}',
        )
    return unit


def _channel(
    m: Meant, column: Column, vehicle: Vehicle, start: int, max_gap: int
) -> tuple[Channel, list[Finding]]:
    told = title(m.field)
    findings: list[Finding] = []
    ours = m.field.message_type.startswith("adhesion.")
    if ours:  # our own files say NaN where there is none
        column = replace(column, valid=column.valid & np.isfinite(column.value))
    values = column.value if column.valid.all() else column.value[column.valid]
    step, tick = _step(values), 0.0
    axis = time_axis.clean(told, column, start, max_gap)
    if ours:  # such a stretch is no gap in the log
        n = len(column.t)
        stamps = Column(column.t, np.zeros(n), np.ones(n, dtype=np.bool_))
        whole = time_axis.clean(told, stamps, start, max_gap)
        axis = replace(axis, findings=whole.findings, gaps=whole.gaps)
    data, starts, gap_ns = axis.data, axis.starts, axis.gap_ns
    if m.meaning and (unit := units.of(m.unit, m.meaning)):
        radius = vehicle.radius(m.axle or 1).value
        factor = unit.factor
        if m.meaning == "wheel_speed" and unit.dimension == "speed":
            factor /= radius
        if unit.dimension == "pulse rate":
            factor *= 2.0 * math.pi / max(m.teeth, 1)
        if unit.dimension in ("count", "angle"):
            counted = unit.dimension == "count"
            turn = 2.0 * math.pi / max(m.teeth, 1) if counted else unit.factor
            step = (1.0 if counted else step) * turn / max(axis.interval_ns / 1e9, 1e-9)
            data, starts, found = _rate(data, starts, gap_ns, turn, m.wrap, unit, told, start)
            findings += found
        else:
            data = replace(data, value=factor * data.value + unit.offset)
            tick = _tick(values, step) / factor if m.meaning == "wheel_speed" else 0.0
            step *= factor
        if m.meaning == "pressure" and not unit.offset and _from_vacuum(data.value):
            text = (
                "never much below 1 bar, where a released brake cylinder has 0 above atmosphere; "
                f'if it counts from vacuum, state unit = "{m.unit} abs" in [channels]'
            )
            findings.append(Finding("pressure-absolute", "warning", text, told))
    rate = 1e9 / axis.interval_ns if axis.interval_ns else None
    row_of = (m.field.channel if m.field.encoding else m.field.signal, m.field.group)
    return Channel(
        name(m.field), m.field.path, m.meaning, m.axle, m.unit, m.reason, data, len(column.t),
        starts, gap_ns, step, rate, axis.gaps, axis.duplicates, axis.backward, row_of,
        m.meaning == "train_speed" and units.is_acceleration(m.unit), m.field.label, tick,
    ), [*axis.findings, *findings]  # fmt: skip


def _from_vacuum(pressure: Floats) -> bool:
    """Whether a pressure [Pa] looks as if it counted from vacuum: 1 atmosphere at rest."""
    if not len(pressure):
        return False
    low, top = (float(x) for x in np.quantile(pressure, [0.02, 1.0]))
    return 0.85e5 < low < 1.1e5 and top > 2.0 * low


def _rate(  # noqa: PLR0913
    data: Column,
    starts: tuple[int, ...],
    gap_ns: int,
    turn: float,
    wrap: float,
    unit: units.Unit,
    channel: str,
    start_ns: int,
) -> tuple[Column, tuple[int, ...], list[Finding]]:
    """Speed [rad/s] of a cumulative counter: the mean over an interval, at its middle.

    Half an interval before it can be known; at its end it would be late for the reference.
    Intervals over a jump of the clock, a gap or a reset of the counter give no speed.
    """
    step, dt = np.diff(data.value), np.diff(data.t)
    inside = dt <= gap_ns if gap_ns else np.ones(len(dt), dtype=np.bool_)
    inside[np.array(starts[1:], dtype=np.int64) - 1] = False
    usual = float(np.median(step[inside])) if inside.any() else 0.0
    if usual < 0.0:
        step, usual = -step, -usual  # it counts down
    size = wrap or _wrap(data.value, unit)
    most = 10.0 * max(usual, 1.0)  # a wheel does not do more than this in one interval
    wrapped = inside & (step < 0.0) & (step + size >= 0.0) & (step + size <= most)
    step = np.where(wrapped, step + size, step)
    reset = inside & (step < -most)
    findings = []
    for code, severity, text, where in (
        ("counter-wrapped", "info", "counter wrapped: continued", wrapped),
        ("counter-reset", "warning", "counter falls back and not by a wrap: no speed there", reset),
    ):
        if count := int(where.sum()):
            first = (int(data.t[1:][np.argmax(where)]) - start_ns) / 1e9
            findings.append(Finding(code, severity, text, channel, count, first))  # type: ignore[arg-type]
    kept = inside & ~reset
    middle = data.t[:-1] + dt // 2
    speed = step * turn / (np.maximum(dt, 1) / 1e9)
    new_starts = sorted({int(kept[:s].sum()) for s in starts if kept[s:].any()})
    column = Column(middle[kept], speed[kept], np.ones(int(kept.sum()), dtype=np.bool_))
    return column, tuple(new_starts), findings


def _wrap(values: Floats, unit: units.Unit) -> float:
    """Where a counter starts anew: at a whole turn of an angle, else by its largest value."""
    if unit.dimension == "angle":
        return 2.0 * math.pi / unit.factor
    top = float(values.max(initial=0.0))
    return next((float(2**b) for b in (8, 10, 12, 16, 24, 32) if top < 2**b), 0.0)


def _step(values: Floats) -> float:
    """The step of a quantised signal in its own unit, 0 where its values lie on no grid."""
    head = values[:: max(1, len(values) // 20000)]
    steps = np.diff(np.unique(head[np.isfinite(head)]))
    if not len(steps):
        return 0.0
    smallest = float(steps.min())
    if smallest <= 1e-9 * float(np.abs(head).max()):
        return 0.0
    ratio = steps / smallest
    return smallest if float(np.abs(ratio - np.rint(ratio)).max()) < 0.02 else 0.0


def _tick(speed: Floats, step: float) -> float:
    """The step of 1/speed, where a timer counts whole ticks from pulse to pulse; 0 elsewhere.

    Judged over the faster half, where ticks are coarsest and speeds on a grid have no periods on
    one: by the mean cosine of the periods' phases in it.
    """
    head = speed[:: max(1, len(speed) // 20000)]
    head = head[np.isfinite(head)]
    periods = np.unique(1.0 / head[head > max(0.5 * float(head.max(initial=0.0)), 1e-9)])
    if len(periods) < 12 or periods[-1] < 1.2 * periods[0]:
        return 0.0
    gaps = np.diff(periods)
    usual = float(np.quantile(gaps, 0.1))  # a tick, or some where speed falls fast
    if usual < max(_FINEST * periods[0], 2.0 * step * periods[0] ** 2):
        return 0.0

    def agree(ticks: Floats, periods: Floats) -> Floats:
        cosine: Floats = np.cos(2.0 * np.pi * periods / ticks[:, None]).mean(axis=1)
        return cosine

    some = periods[:: max(1, len(periods) // 200)]
    close = np.arange(0.8, 1.25, usual / periods[-1] / 8.0)
    for parts in (1, 2, 3):
        if agree(np.array([usual / parts]), gaps[gaps < 10.0 * usual])[0] < _MAY_BE:
            continue  # so much is seen at once
        ticks = usual / parts * close
        best = ticks[[np.argmax(agree(ticks, some))]]
        if agree(best, periods)[0] > _ON_GRID:
            whole = np.rint(periods / best)
            return float(periods @ whole / (whole @ whole))
    return 0.0


def _sha256(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
