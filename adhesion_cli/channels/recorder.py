"""What recorders write in place of samples: codes of no value, and nothing while a value holds."""

import re

import numpy as np

from ..core.model import Bools, Column, Floats

# Digits of what stands for "no value": nines, the ends of 16 and 32 bits, well logs' 999.25.
_CODE = re.compile(r"9{3,}|99925|3276[78]|6553[45]|214748364[78]|429496729[45]")
_ANY_CODE = 1e19  # so large a number is one as well, as 1e30
_LEAST_CODES, _APART = 3, 2.0  # samples of one code; times as large as every other value
# Changes of nearly the smallest size, and the share of them that a heartbeat may repeat a value.
_LEAST_CHANGES, _MOST_REPEATS = 10, 0.05
# Cycles in which a value was held; share of the change that the steps around predict: a lost one.
_LONG, _TREND = 3.0, 0.75
_LEAST_HELD, _MOST_HELD = 2, 10_000_000  # intervals, as one alone may be a gap; samples added


def code_of_no_value(value: Floats) -> float:
    """The code that stands for "no value" among the samples of a channel, 0 for none.

    It has digits that people choose for it, repeats exactly, and stands apart from all values.
    """
    finite = value[np.isfinite(value)]
    for code in {float(finite.min()), float(finite.max())} if len(finite) else ():
        digits = f"{abs(code):.10e}".replace(".", "").split("e")[0].rstrip("0")
        others = finite[finite != code]
        is_apart = len(others) and abs(code) > _APART * np.abs(others).max() > 0.0
        is_repeated = len(finite) - len(others) >= _LEAST_CODES
        if is_apart and is_repeated and (_CODE.fullmatch(digits) or abs(code) > _ANY_CODE):
            return code
    return 0.0


def with_held(data: Column, end: int) -> tuple[Column, Bools]:
    """The samples of a recorder that writes a channel when its value changes; and those it held.

    Such a recorder writes no value twice, while small changes are frequent. An interval without
    samples held the value if the next one is a step away. If it is as far away as the steps around
    predict, or farther than any step, samples were lost there: nothing is added.

    Args:
        data: the samples.
        end: of the log [ns]; the last value holds until then.

    Returns:
        The samples with held ones a cycle apart, and which were added; none of another recorder.
    """
    t, value = data.t[data.valid], data.value[data.valid]
    steps, change = np.diff(t), np.abs(np.diff(value))
    none_added = data, np.zeros(len(data.t), np.bool_)
    if len(t) <= _LEAST_CHANGES or steps.min() <= 0 or not change.any():
        return none_added
    cycle, smallest = float(np.quantile(steps, 0.1)), change[change > 0.0].min()
    small = np.count_nonzero((change > 0.0) & (change < 2.0 * smallest))
    if small < _LEAST_CHANGES or np.count_nonzero(change == 0.0) > _MOST_REPEATS * small:
        return none_added
    is_long = steps > _LONG * cycle
    around = np.maximum(np.append(change[:1], change[:-1]), np.append(change[1:], change[-1:]))
    held = is_long & (change <= change[~is_long].max(initial=0.0))
    held &= change <= _TREND * steps / cycle * around
    if np.count_nonzero(held) < _LEAST_HELD:
        return none_added
    lengths = np.append(np.where(held, steps, 0), max(end - int(t[-1]) + cycle, 0.0))
    cycle = max(cycle, float(lengths.sum()) / _MOST_HELD)
    counts = np.maximum(np.ceil(lengths / cycle - 0.5).astype(np.int64) - 1, 0)
    rows = np.repeat(np.arange(len(t)), 1 + counts)
    number = np.arange(len(rows)) - np.repeat(np.cumsum(1 + counts) - 1 - counts, 1 + counts)
    times = t[rows] + np.rint(number * cycle).astype(np.int64)
    return Column(times, value[rows], np.ones(len(rows), np.bool_)), number > 0
