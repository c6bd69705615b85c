"""What recorders write in place of samples: codes of no value, and nothing while a value holds."""

import re

import numpy as np

from ..core.model import Bools, Column, Floats

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
_LONG, _TREND = 3.0, 0.75
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


def with_held(data: Column, end: int, is_code: Bools) -> tuple[Column, Bools]:
    """The samples of a recorder that writes a channel when its value changes; and those it held.

    Such a recorder writes no value twice, while small changes are frequent in each cycle. An
    interval without samples held the value if the next one is a step away. If it is as far away as
    the slope around predicts, or farther than any step, samples were lost there, or each wheel
    revolution writes one: nothing is added.

    Args:
        data: the samples.
        end: of the log [ns]; the last value holds until then.
        is_code: samples that say "no value" (n,); a value holds no longer than until one.

    Returns:
        The samples with held ones a cycle apart, and which were added; none of another recorder.
    """
    t, value = data.t[data.valid], data.value[data.valid]
    steps, none_added = np.diff(t), (data, np.zeros(len(data.t), np.bool_))
    if len(t) <= _LEAST_CHANGES or not 0 < _LONG * steps.min() < steps.max():
        return none_added
    change = np.abs(np.diff(value))
    if not change.any():
        return none_added
    cycle, smallest = float(np.quantile(steps, 0.1)), change[change > 0.0].min()
    is_long = steps > _LONG * cycle
    small = np.count_nonzero(~is_long & (change > 0.0) & (change < 2.0 * smallest))
    is_repeated = change == 0.0
    # Some recorders write the old value once more right before a change.
    is_before_change = is_repeated & np.append(change[1:] > 0.0, False)
    is_early = is_before_change & (steps > 1.5 * np.append(steps[1:], 0))
    if 2 * np.count_nonzero(is_early) > np.count_nonzero(is_repeated):
        is_repeated &= ~is_before_change
    repeats = np.count_nonzero(~is_long & is_repeated)  # not those of a heartbeat
    if small < _LEAST_CHANGES or repeats > _MOST_REPEATS * small:
        return none_added
    slope = change / steps
    around = np.maximum(np.append(slope[:1], slope[:-1]), np.append(slope[1:], slope[-1:]))
    hold_intervals = is_long & (change <= 2.0 * change[~is_long].max(initial=0.0))
    hold_intervals &= change <= np.maximum(_TREND * steps * around, 1.5 * smallest)
    if np.count_nonzero(hold_intervals) < _FEWEST_HOLDS:
        return none_added
    lengths = np.append(np.where(hold_intervals, steps, 0), max(end - int(t[-1]) + cycle, 0.0))
    code_t = np.append(data.t[is_code], end + cycle)
    lengths = np.minimum(lengths, code_t[np.searchsorted(code_t[:-1], t)] - t)
    cycle = max(cycle, float(lengths.sum()) / _LARGEST_ADDITION)
    counts = np.maximum(np.ceil(lengths / cycle - 0.5).astype(np.int64) - 1, 0)
    rows = np.repeat(np.arange(len(t)), 1 + counts)
    number = np.arange(len(rows)) - np.repeat(np.cumsum(1 + counts) - 1 - counts, 1 + counts)
    times = t[rows] + np.rint(number * cycle).astype(np.int64)
    return Column(times, value[rows], np.ones(len(rows), np.bool_)), number > 0
