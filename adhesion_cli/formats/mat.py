"""MATLAB files of version 5, by scipy: variables of one length become columns of a text log.

A structure gives its fields, a matrix its columns. Files of version 7.3 are HDF5 and are not read.
"""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa

from ..core.errors import UserError
from ..core.finding import Finding
from .as_text import open_text, write_table
from .csv.header_words import time_name
from .csv.reader import CsvSource
from .isolated import Library
from .source import ReadOptions

_LIBRARY = Library("mat", "MATLAB", (), "")
_RATES = ("fs", "samplerate", "sample_rate", "sampling_rate", "samplingrate")  # [Hz]
_INTERVALS = ("dt", "ts", "sampletime", "sample_time", "delta_t")  # [s]
_MOST_COLUMNS = 64  # of a matrix


def open_mat(path: Path, options: ReadOptions) -> CsvSource:
    """Opens a MATLAB file as a log.

    Raises:
        UserError: where it cannot be read, or holds no numbers over time.
    """
    other_variables: list[str] = []

    def write(text: Path) -> list[str]:
        names, other_names = _LIBRARY.call(path, write_text, text)
        other_variables.extend(other_names)
        return [""] * len(names)

    source = open_text("mat", path, write, options)
    if other_variables:
        names = {"reason": "they are no vectors of the length that the time has"}
        names["groups"], count = ", ".join(other_variables[:6]), len(other_variables)
        source.findings.append(Finding("group-not-read", "info", "", count, names=names))
    return source


def write_text(path: Path, text: Path) -> tuple[list[str], list[str]]:
    """Writes the variables as columns; those of the time's length, else of the usual one.

    Returns the names of the columns; and the other variables of more than one number, with the
    size.

    Raises:
        UserError: where there are none.
    """
    from scipy.io import loadmat

    with path.open("rb") as file:
        version = file.read(10)
    if version == b"MATLAB 7.3":
        problem = f"{path}: a MATLAB file of version 7.3 (HDF5), which is not read"
        raise UserError(problem, "save it in MATLAB with the option -v7")
    variables = loadmat(path, simplify_cells=True)
    variable_pairs = (pair for pair in variables.items() if pair[0][:2] != "__")
    arrays = {name: x for variable in variable_pairs for name, x in _columns(*variable)}
    columns = {name: x for name, x in arrays.items() if x.ndim == 1}
    lengths = Counter(len(x) for x in columns.values() if len(x) > 1)
    times = [len(x) for name, x in columns.items() if time_name(name.split(".")[-1])]
    length = next((n for n in times if n > 1), lengths.most_common(1)[0][0] if lengths else 0)
    if length and not times and (step := _step(columns)):
        columns["time [s]"] = np.arange(length) * step
    names = [name for name, x in columns.items() if len(x) == length]
    if not length or len(names) < 2:
        sizes = ", ".join(f"{name} ({len(x)})" for name, x in list(columns.items())[:12]) or "none"
        problem = f"{path}: no two variables of numbers have one length (variables: {sizes})"
        raise UserError(problem, "save the time and the channels as vectors of one length")
    write_table({name: pa.array(columns[name]) for name in names}, text)
    other_arrays = {name: x for name, x in arrays.items() if name not in names and x.size > 1}
    return names, [f"{name} ({' x '.join(map(str, x.shape))})" for name, x in other_arrays.items()]


def _step(columns: dict[str, Any]) -> float:
    """The time between two samples [s] that a rate or an interval states; 0 for none."""
    numbers = {name.split(".")[-1].casefold(): float(x[0]) for name, x in columns.items() if len(x)}
    steps = [1.0 / x for name, x in numbers.items() if name in _RATES and x > 0.0]
    steps += [x for name, x in numbers.items() if name in _INTERVALS and x > 0.0]
    return next(iter(steps), 0.0)


def _columns(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """The columns of numbers that a variable holds, by name; a large array is given as it is."""
    if isinstance(value, dict):
        for key, inner in value.items():
            yield from _columns(f"{name}.{key}".lstrip("."), inner)
        return
    if isinstance(value, list):  # as Simulink writes its signals
        for k, inner in enumerate(value, 1):
            signal = inner if isinstance(inner, dict) else {"values": inner}
            yield from _columns(f"{name}.{signal.get('label') or k}", signal.get("values", inner))
        return
    array = np.atleast_1d(value)
    if array.dtype.kind not in "biuf":
        return
    if array.ndim == 1:
        yield name, array.astype(np.float64)
    elif array.ndim > 2 or min(array.shape) > _MOST_COLUMNS:
        yield name, array
    else:
        matrix = array if array.shape[0] > array.shape[1] else array.T
        for k in range(matrix.shape[1]):
            yield f"{name}_{k + 1}", matrix[:, k].astype(np.float64)
