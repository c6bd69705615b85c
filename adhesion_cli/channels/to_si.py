"""One channel in SI, on a clean time axis, without what recorders write in place of samples."""

import math
import re
from dataclasses import replace

import numpy as np

from ..core import masks, model, time_axis, toml, units
from ..core.errors import UserError
from ..core.finding import Finding, Severity
from ..core.model import Bools, Channel, Column, Floats, Meaning, Parameter, Times, Vehicle
from ..core.text import NO_VALUE
from ..core.time_axis import TimeAxis
from .meaning import Meant, entry_of
from .rules import CLOSED_STATES, OFF_STATES, ON_STATES, OPEN_STATES

# Digits of what stands for "no value": nines, the ends of 16 and 32 bits, well logs' 999.25, and
# 255.996, which is 65535/256 of J1939.
_CODE = re.compile(r"9{3,}|99925|3276[78]|6553[45]|214748364[78]|429496729[45]|25599\d*")
_SHORT_CODE = -99.0  # 99 alone may be a speed
_ANY_CODE = 1e19  # so large a number is one as well, as 1e30
_LEAST_CODES, _FEWEST_VALUES = 2, 10  # samples of one code; other values that differ
_CODE_DISTANCE = 2.0  # times as large as every other value
# Changes of nearly the smallest size, and the share of them that may repeat a value.
_LEAST_CHANGES, _MOST_REPEATS = 10, 0.05
# Cycles in which a value was held; share of the change that the slope around predicts: a lost one.
_LONG_STEP_RATIO, _TREND = 3.0, 0.75
_FEWEST_HOLDS = 2  # intervals, as one alone may be a gap
_LARGEST_ADDITION = 10_000_000  # samples


def codes_of_no_value(value: Floats) -> list[float]:
    """The codes that stand for "no value" among the samples of a channel.

    A code has digits that people choose for it, repeats exactly, and is far from all values, which
    vary: a demand of 0, 33.3 or 99.9 has steps.
    """
    other_values, codes = value[np.isfinite(value)], list[float]()
    while len(other_values):
        code = float(other_values[np.argmax(np.abs(other_values))])
        digits = f"{abs(code):.10e}".replace(".", "").split("e")[0].rstrip("0")
        has_code = other_values == code
        is_code = _CODE.fullmatch(digits) or code == _SHORT_CODE or abs(code) > _ANY_CODE
        if not is_code or np.count_nonzero(has_code) < _LEAST_CODES:
            break
        codes, other_values = [*codes, code], other_values[~has_code]
    if not codes or len(np.unique(other_values)) < _FEWEST_VALUES:
        return []
    return [code for code in codes if abs(code) > _CODE_DISTANCE * np.abs(other_values).max()]


def with_held(data: Column, log_end: int, is_code: Bools) -> tuple[Column, Bools]:
    """The samples of a recorder that writes a channel when its value changes; and those it held.

    Such a recorder writes no value twice, while small changes are frequent in each cycle. An
    interval without samples held the value if the next one is a step away. If it is as far away as
    the slope around predicts, or farther than any step, samples were lost there, or each wheel
    revolution writes one: nothing is added.

    Args:
        data: the samples.
        log_end: end of the log [ns]; the last value holds until then.
        is_code: samples that say "no value" (n,); a value holds no longer than until one.

    Returns:
        The samples with held ones a cycle apart, and which were added; none of another recorder.
    """
    t, value = data.t[data.valid], data.value[data.valid]
    steps, none_added = np.diff(t), (data, np.zeros(len(data.t), np.bool_))
    if len(t) <= _LEAST_CHANGES or not 0 < _LONG_STEP_RATIO * steps.min() < steps.max():
        return none_added
    change = np.abs(np.diff(value))
    if not change.any():
        return none_added
    cycle, smallest = float(np.quantile(steps, 0.1)), change[change > 0.0].min()
    is_long_step = steps > _LONG_STEP_RATIO * cycle
    small = np.count_nonzero(~is_long_step & (change > 0.0) & (change < 2.0 * smallest))
    is_repeated = change == 0.0
    # Some recorders write the old value once more right before a change.
    is_before_change = is_repeated & np.append(change[1:] > 0.0, False)
    is_early_repeat = is_before_change & (steps > 1.5 * np.append(steps[1:], 0))
    if 2 * np.count_nonzero(is_early_repeat) > np.count_nonzero(is_repeated):
        is_repeated &= ~is_before_change
    repeats = np.count_nonzero(~is_long_step & is_repeated)  # not those of a heartbeat
    if small < _LEAST_CHANGES or repeats > _MOST_REPEATS * small:
        return none_added
    slope = change / steps
    around = np.maximum(np.append(slope[:1], slope[:-1]), np.append(slope[1:], slope[-1:]))
    hold_intervals = is_long_step & (change <= 2.0 * change[~is_long_step].max(initial=0.0))
    hold_intervals &= change <= np.maximum(_TREND * steps * around, 1.5 * smallest)
    if np.count_nonzero(hold_intervals) < _FEWEST_HOLDS:
        return none_added
    lengths = np.append(np.where(hold_intervals, steps, 0), max(log_end - int(t[-1]) + cycle, 0.0))
    code_t = np.append(data.t[is_code], log_end + cycle)
    lengths = np.minimum(lengths, code_t[np.searchsorted(code_t[:-1], t)] - t)
    cycle = max(cycle, float(lengths.sum()) / _LARGEST_ADDITION)
    counts = np.maximum(np.ceil(lengths / cycle - 0.5).astype(np.int64) - 1, 0)
    rows = np.repeat(np.arange(len(t)), 1 + counts)
    number = np.arange(len(rows)) - np.repeat(np.cumsum(1 + counts) - 1 - counts, 1 + counts)
    times = t[rows] + np.rint(number * cycle).astype(np.int64)
    return Column(times, value[rows], np.ones(len(rows), np.bool_)), number > 0


_FINEST = 2e-4  # of the shortest period: a tick so small is no more than noise
_ON_GRID = 0.9  # mean cosine of phases that lie on one
_COARSE_SPEED, _LEAST_LEVELS = 0.2, 8  # a speed rounded to more is reported [m/s]; values of it
_LARGE_ZERO = 0.5e5  # a smaller one is no mistake, though no brake is applied in the log [Pa]


def channel(
    m: Meant, column: Column, vehicle: Vehicle, ends: tuple[int, int], max_gap_ns: int = 0
) -> tuple[Channel, list[Finding]]:
    """One channel in SI where its unit is known, and what was wrong with its samples.

    `ends` are those of the log [ns]. Intervals longer than `max_gap_ns` are gaps; 0 decides by the
    channel itself.

    Raises:
        UserError: where the stated zero is larger than every value.
    """
    start = ends[0]
    column, samples, held, notes = _of_recorder(m, column, ends)
    axis, column = _axis(m, column, start, max_gap_ns)
    findings = [*notes, *axis.findings]
    values = column.value if column.valid.all() else column.value[column.valid]
    data, starts, step, tick = axis.data, axis.starts, quantum(values), 0.0
    unit = units.unit_for(m.unit, m.meaning) if m.meaning else None
    factor = scale(m, unit, vehicle) if unit else 1.0
    if unit and is_total(unit):
        counter_range = factor
        step = (1.0 if unit.dimension == "count" else step) * counter_range
        step /= max(axis.interval_ns / 1e9, 1e-9)
        data, starts, wrapped, reset = _rate(axis, counter_range, m.wrap or _wrap(data.value, unit))
        findings += _of_counter("counter-wrapped", "info", m, axis, wrapped, start)
        findings += _of_counter("counter-reset", "warning", m, axis, reset, start)
    elif unit:
        zero_pa = zero(m, vehicle).value
        _check_zero(m, zero_pa, factor * values)
        data = replace(data, value=factor * data.value + (unit.offset - zero_pa))
        tick = period_tick(values, step) / factor if m.meaning == "wheel_speed" else 0.0
        step *= abs(factor)
        is_train = m.meaning == "train_speed" and unit.dimension == "speed"
        # a few levels show no rounding
        if is_train and step > _COARSE_SPEED and len(np.unique(values)) >= _LEAST_LEVELS:
            rounded = {"step_mps": step}
            findings.append(Finding("train-speed-rounded", "info", m.title, values=rounded))
    rate = 1e9 / axis.interval_ns if axis.interval_ns else None
    place = m.field.channel if m.field.encoding else m.field.folder or m.field.signal
    row_of = (place, m.field.group)
    is_rate = m.meaning == "train_speed" and units.is_acceleration(m.unit)
    origin = (m.field.name, m.field.path, m.meaning, m.axle, m.unit, m.reason)
    faults = (axis.gaps, axis.duplicates, axis.backward, row_of)
    si_channel = Channel(*origin, data, samples, starts, axis.gap_ns, step, rate, *faults, is_rate)
    si_channel = replace(si_channel, label=m.field.label, period_step=tick, delay=m.delay)
    return replace(si_channel, held=held, zero=zero(m, vehicle)), findings


def zero(m: Meant, vehicle: Vehicle) -> Parameter:
    """What is taken off a channel, SI."""
    unit = units.unit_for(m.unit, m.meaning) if m.meaning else None
    factor = scale(m, unit, vehicle) if unit else 0.0
    value, tolerance = m.zero or (0.0, 0.0)
    return Parameter(factor * value, abs(factor) * tolerance)


def _check_zero(m: Meant, si: float, values: Floats) -> None:
    """Refuses a zero that is larger than every value: all would be below zero."""
    top = float(np.max(np.abs(values), initial=0.0))
    if m.zero and abs(si) > max(top, _LARGE_ZERO):
        key = f"channels.{m.meaning}" + (f".axle{m.axle}" if m.axle else "")
        option = toml.option(f"{key}.zero = 0.1")
        raise UserError(
            f"{key}: zero = {m.zero.value:g} {m.unit} is larger than every value of channel "
            f"{m.title!r}, of which the largest is {top * m.zero.value / si:.3g} {m.unit}",
            f"state what it shows while the brake is released, as {option}",
            code=2,
        )


def is_total(unit: units.Unit) -> bool:
    """Whether a wheel speed in this unit is a cumulative counter of pulses or angle."""
    return unit.dimension in ("count", "angle")


def is_rim(unit: units.Unit) -> bool:
    """Whether a wheel speed in this unit is that of the rim, ωR."""
    return unit.dimension == "speed"


def scale(m: Meant, unit: units.Unit, vehicle: Vehicle) -> float:
    """What makes a value SI, before the unit's offset; of a cumulative counter, an angle [rad]."""
    if unit.dimension == "count":
        return 2.0 * math.pi / max(m.teeth, 1)
    if unit.dimension == "pulse rate":
        return unit.factor * (2.0 * math.pi / max(m.teeth, 1))
    if m.meaning in model.MOTOR_FORCES:
        arm, full_force = (m.mapping.arm, m.mapping.full_force) if m.mapping else (0.0, 0.0)
        of_one = full_force if unit.dimension == "ratio" else 1.0  # the force of 1 in SI [N]
        if unit.dimension == "torque":
            of_one = 1.0 / (arm or vehicle.radius(m.axle or 1).value)
        return m.share * unit.factor * of_one
    if m.meaning == "wheel_speed" and is_rim(unit):
        return unit.factor / vehicle.radius(m.axle or 1).value
    return unit.factor


def _of_recorder(
    m: Meant, column: Column, ends: tuple[int, int]
) -> tuple[Column, int, Times, list[Finding]]:
    """The column without codes of no value and with held values.

    Then the samples of the log; when values were held [ns]; notes on codes and holding.
    """
    samples, notes = len(column.t), list[Finding]()
    if m.field.message_type.startswith("adhesion.") or column.words:
        return column, samples, column.t[:0], notes

    def note(code: str, affected: Bools, values: dict[str, float]) -> None:
        spans = masks.spans_of_mask(affected, column.t, ends[0])
        notes.append(Finding(code, "info", m.title, int(np.count_nonzero(affected)), spans, values))

    unit, is_code = units.unit(m.unit), np.zeros(samples, dtype=np.bool_)
    is_share = bool(unit and unit.dimension == "ratio")
    is_share |= m.meaning in (*model.STATES, *model.OTHER_BRAKES)
    for number in [] if is_share else codes_of_no_value(column.value[column.valid]):
        has_number = column.valid & (column.value == number)
        note("value-is-code", has_number, {"number": number})
        is_code |= has_number
    column = replace(column, valid=column.valid & ~is_code)
    column, added = with_held(column, ends[1], is_code)
    if added.any():
        note("written-on-change", added, {})
    return column, samples, column.t[added], notes


def _axis(m: Meant, column: Column, start: int, max_gap_ns: int) -> tuple[TimeAxis, Column]:
    """The channel's clean time axis, and its samples.

    A result of this program has NaN where there is no value. That is no gap in the log, so its
    stamps are judged without its values.
    """
    title = m.title
    if not m.field.message_type.startswith("adhesion."):
        return time_axis.clean(title, column, start, max_gap_ns), column
    column = replace(column, valid=column.valid & np.isfinite(column.value))
    axis = time_axis.clean(title, column, start, max_gap_ns)
    n = len(column.t)
    stamps = Column(column.t, np.zeros(n), np.ones(n, dtype=np.bool_))
    cleaned = time_axis.clean(title, stamps, start, max_gap_ns)
    return replace(axis, findings=cleaned.findings, gaps=cleaned.gaps), column


def _rate(
    axis: TimeAxis, counter_range: float, size: float
) -> tuple[Column, tuple[int, ...], Bools, Bools]:
    """Speed [rad/s] of a cumulative counter: the mean over an interval, at its middle.

    At the end of the interval it would be delayed for the reference. An interval over a step of the
    clock, a gap or a reset of the counter gives no speed. One count is an angle of `counter_range`
    [rad]; the counter starts anew at `size`. Then where pieces of the speed begin, and intervals in
    which the counter wrapped, and in which it was reset, (n - 1,).
    """
    data, starts = axis.data, axis.starts
    step, dt = np.diff(data.value), np.diff(data.t)
    inside = dt <= axis.gap_ns if axis.gap_ns else np.ones(len(dt), dtype=np.bool_)
    inside[np.array(starts[1:], dtype=np.int64) - 1] = False
    usual = float(np.median(step[inside])) if inside.any() else 0.0
    if usual < 0.0:
        step, usual = -step, -usual  # it counts down
    limit = 10.0 * max(usual, 1.0)  # a wheel does not do more than this in one interval
    wrapped = inside & (step < 0.0) & (step + size >= 0.0) & (step + size <= limit)
    step = np.where(wrapped, step + size, step)
    reset = inside & (step < -limit)
    plausible = inside & ~reset
    middle = data.t[:-1] + dt // 2
    speed = step * counter_range / (np.maximum(dt, 1) / 1e9)
    new_starts = sorted({int(plausible[:s].sum()) for s in starts if plausible[s:].any()})
    column = Column(middle[plausible], speed[plausible], np.ones(int(plausible.sum()), np.bool_))
    return column, tuple(new_starts), wrapped, reset


def _of_counter(
    code: str, severity: Severity, m: Meant, axis: TimeAxis, affected: Bools, start: int
) -> list[Finding]:
    """A finding on the intervals of a counter, none where there is no such interval."""
    count = int(affected.sum())
    if not count:
        return []
    spans = masks.spans_of(axis.data.t[:-1][affected], axis.data.t[1:][affected], start)
    line = f"channels.{m.meaning} = {toml.table(entry_of(m.field, wrap=65536))}"
    names = {"option": toml.option(line)}
    return [Finding(code, severity, channel=m.title, count=count, spans=spans, names=names)]


def _wrap(values: Floats, unit: units.Unit) -> float:
    """Where a counter starts anew: at a whole turn of an angle, else by its largest value."""
    if unit.dimension == "angle":
        return 2.0 * math.pi / unit.factor
    top = float(values.max(initial=0.0))
    return next((float(2**b) for b in (8, 10, 12, 16, 24, 32) if top < 2**b), 0.0)


def quantum(values: Floats) -> float:
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


def period_tick(speed: Floats, step: float) -> float:
    """The step of 1/speed, where a timer counts whole ticks from pulse to pulse; 0 elsewhere.

    Judged over the faster half: there ticks are coarsest, and equal steps of the speed are no equal
    steps of the period. The measure is the mean cosine of the phases that the periods have in it.
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

    def agreement(ticks: Floats, periods: Floats) -> Floats:
        cosine: Floats = np.cos(2.0 * np.pi * (periods / ticks[:, None])).mean(axis=1)
        return cosine

    sampled = periods[:: max(1, len(periods) // 200)]
    candidates = np.arange(0.8, 1.25, usual / periods[-1] / 8.0)
    for divisor in (1, 2, 3):
        ticks = usual / divisor * candidates
        # A few periods rule out most of some thousand ticks, and a few more most of the others.
        for count in (8, 40):
            subset = sampled[:: max(1, len(sampled) // count)]
            ticks = ticks[agreement(ticks, subset) > 0.5 * _ON_GRID]
        if not len(ticks):
            continue
        best = ticks[[np.argmax(agreement(ticks, sampled))]]
        if agreement(best, periods)[0] > _ON_GRID:
            whole_ticks = np.rint(periods / best)
            return float(periods @ whole_ticks / (whole_ticks @ whole_ticks))
    return 0.0


def words_key(meaning: Meaning, axle: int | None) -> str:
    """Where the provenance of a result has the words of a state, a line for each level."""
    return f"{meaning}_words" if axle is None else f"{meaning}_{axle}_words"


def as_levels(column: Column, meaning: Meaning | None) -> tuple[Column, tuple[str, ...]]:
    """A column of words as 0 and 1, or as 0, 1, 2 and so on; and the word of each level.

    Words for "off" are 0. Words as "unknown" are no value. Where all others are words for "on",
    these are 1. Else each of them is a level, by the number in it, then in the order of the log. A
    hold valve acts where it is closed, every other one where it is open.
    """
    if not column.words:
        return column, ()
    zero_words = OFF_STATES | (OPEN_STATES if meaning == "hold_valve" else CLOSED_STATES)
    one_words = ON_STATES | (CLOSED_STATES if meaning == "hold_valve" else OPEN_STATES)
    folded = [word.casefold() for word in column.words]
    state_words = zero_words | one_words
    missing = {word for word in folded if word not in state_words and NO_VALUE.search(word)}
    level_words = [word for word in dict.fromkeys(folded) if word not in zero_words | missing]
    if all(word in one_words for word in level_words):
        level_of = {word: float(word in one_words) for word in folded}
    else:
        level_of = dict.fromkeys(folded, 0.0)
        level_words.sort(key=lambda word: float((re.search(r"\d+", word) or ["inf"])[0]))
        level_of |= {word: float(k) for k, word in enumerate(level_words, 1)}
    level_of |= dict.fromkeys(missing, np.nan)
    numbers = np.array([level_of[word] for word in folded])
    value = np.full(len(column.t), np.nan)
    value[column.valid] = numbers[column.value[column.valid].astype(np.int64)]
    pairs = list(zip(numbers.tolist(), column.words, strict=True))
    names = {int(k): word for k, word in reversed(pairs) if k == k}
    levels = tuple(names.get(k, "") for k in range(max(names, default=-1) + 1))
    return replace(column, value=value, valid=np.isfinite(value), words=()), levels
