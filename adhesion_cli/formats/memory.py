"""A log in memory: signals as arrays, with units. It is read as a file is."""

import hashlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ..core.errors import UserError, unknown
from ..core.model import Column, Floats, Log, Times
from .source import Field, ReadOptions, Source

_INDEX = "__index_level_0__"  # name of an index without one
_FARTHEST = 9.2e9  # seconds that 64-bit nanoseconds hold


class Signals:
    """Signals over time in memory, to be analysed as a log file is.

    Names and units mean what they mean in the header of a CSV log. A unit may stand in the name, as
    in ``"bc pressure [bar]"``.

    Args:
        time: of shape (n,): seconds from any start, or ``datetime64`` in UTC.
        signals: values of shape (n,), by name. NaN is a missing sample.
        units: by name, where the name itself does not say it.
        name: of the log; files of results are named after it.

    Raises:
        UserError: for what is no series of numbers of that length, and for a unit without signal.

    >>> signals = {"pressure [bar]": [1.0, 2.0], "axle 1": [9, 8]}
    >>> log = Signals([0.0, 0.1], signals, units={"axle 1": "rpm"})
    >>> log.name, log.units
    ('signals', {'pressure [bar]': '', 'axle 1': 'rpm'})
    """

    def __init__(
        self,
        time: ArrayLike,
        signals: Mapping[str, ArrayLike],
        units: Mapping[str, str] | None = None,
        name: str = "signals",
    ) -> None:
        for unit_name in units or ():
            if unit_name not in signals:
                raise unknown("signal with a unit", unit_name, list(signals))
        t, self.absolute = _time(time, name)
        units_given = dict(units or {})
        self.name, self.origin, self.sha256 = name, "memory", ""
        self._series = {n: _column(n, t, unit_name) for n, unit_name in signals.items()}
        self.units = {n: units_given.get(n, "") for n in signals}

    @classmethod
    def from_table(
        cls,
        table: Any,
        time: str | None = None,
        units: Mapping[str, str] | None = None,
        name: str = "signals",
    ) -> "Signals":
        """Signals from a table of pandas, pyarrow or polars: a column each.

        Args:
            table: the table. A pandas table that is indexed by time needs no column for it.
            time: name of the column that holds the time; else the index, or the first column.
            units: by name of a column, where the name itself does not say it. A field of an arrow
                table may state its ``unit`` in its metadata.
            name: as above.

        Raises:
            UserError: for what is no table, and as above.
        """
        import pyarrow as pa

        try:
            arrow = pa.table(table)
        except (TypeError, ValueError, pa.ArrowInvalid):
            hint = "give a table of pandas, pyarrow or polars, or use Signals(time, {name: values})"
            raise UserError(f"a {type(table).__name__} is no table", hint) from None
        index = getattr(table, "index", None)
        names = list(arrow.column_names)
        if time is None and type(index).__name__ in ("DatetimeIndex", "TimedeltaIndex"):
            time = next(n for n in (getattr(index, "name", None), _INDEX) if n in names)
        time = names[0] if time is None and names else time
        if time not in names:
            raise unknown("column for the time", str(time), names)
        t = arrow.column(time).to_numpy()
        names = [n for n in names if n != time and not n.startswith(_INDEX[:-1])]
        metadata = {n: arrow.schema.field(n).metadata or {} for n in names}
        stated = {n: x.get(b"unit", b"").decode() for n, x in metadata.items()}
        signals = {n: arrow.column(n).to_numpy() for n in names}
        return cls(t, signals, stated | dict(units or {}), name)

    @classmethod
    def of_log(cls, log: Log) -> "Signals":
        """The channels of a log, in the unit that each has there."""
        signals = cls([], {}, name=log.path)
        signals.absolute, signals.origin, signals.sha256 = log.absolute, log.format, log.sha256
        signals._series = {c.name: c.data for c in log.channels}
        signals.units = {c.name: c.unit for c in log.channels}
        return signals

    def __repr__(self) -> str:
        return f"Signals({', '.join(self._series)})"

    def __getitem__(self, name: str) -> Floats:
        """The values of one signal, shape (n,)."""
        return self._series[name].value

    def time(self, name: str) -> Times:
        """The times of one signal [ns], shape (n,)."""
        return self._series[name].t

    @property
    def source(self) -> "MemorySource":
        """The signals as a log that was opened."""
        return MemorySource(self)

    def columns(self, names: Iterable[str]) -> list[Column]:
        """The samples of these signals."""
        return [self._series[n] for n in names]

    def digest(self) -> str:
        """SHA-256 of all that they hold."""
        if self.sha256:
            return self.sha256
        content_hash = hashlib.sha256(repr((self.units, self.absolute)).encode())
        for column in self._series.values():
            content_hash.update(column.t.tobytes() + column.value.tobytes())
        return content_hash.hexdigest()


class MemorySource(Source):
    """Signals as a `Source`."""

    time_reason = "as given"

    def __init__(self, signals: Signals) -> None:
        super().__init__(Path(signals.name), ReadOptions())
        self.signals, self.format = signals, signals.origin
        columns = signals.columns(signals.units)
        self.absolute = signals.absolute
        axes = {id(c.t): len(c.t) for c in columns}
        self.rows = sum(axes.values())
        several = len(axes) > 1  # then each signal has rows of its own
        self.fields = [
            Field(n, unit=unit, unit_from="as given" if unit else "", signal=n if several else "")
            for n, unit in signals.units.items()
        ]

    def digest(self) -> str:
        """SHA-256 of all signals."""
        return self.signals.digest()

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """See `Source`."""
        return self.signals.columns(f.channel for f in wanted)


def _time(time: ArrayLike, name: str) -> tuple[Times, bool]:
    """Time stamps [ns], and whether they count from 1970."""
    t = np.asarray(time)
    hint = "give seconds as numbers, or datetime64, as pandas.to_datetime does; none may be missing"
    error = UserError(f"{name}: the time is no row of numbers or dates", hint)
    if t.ndim != 1:
        raise error
    if t.dtype.kind in "mM":
        if np.isnat(t).any():
            raise error
        return t.astype(f"{t.dtype.kind}8[ns]").astype(np.int64), t.dtype.kind == "M"
    try:
        seconds = t.astype(np.float64)
    except (TypeError, ValueError):
        raise error from None
    if not (np.abs(seconds) < _FARTHEST).all():
        raise error
    return np.rint(seconds * 1e9).astype(np.int64), False


def _column(name: str, t: Times, values: ArrayLike) -> Column:
    try:
        value = np.ascontiguousarray(values, dtype=np.float64)
    except (TypeError, ValueError):
        hint = "leave the column out, or convert it to numbers"
        raise UserError(f"signal {name!r} holds something that is no number", hint) from None
    if value.shape != t.shape:
        text = f"signal {name!r} has the shape {value.shape}, the time {t.shape}"
        raise UserError(text, "give each signal one value for each time")
    return Column(t, value, np.isfinite(value))
