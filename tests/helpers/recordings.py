"""What a recording holds, by Rerun's own reader."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from rerun.chunk import RrdReader

from adhesion_cli.core.model import Floats


def batches(path: Path, entity: str, static: bool = False) -> list[pa.RecordBatch]:
    stream = RrdReader(path).stream().filter(content=entity, is_static=static)
    return [c.to_record_batch() for c in stream]


def column(path: Path, entity: str, component: str) -> tuple[np.ndarray[Any, Any], Floats]:
    """Times since brake start [ns] and values, shape (n,) and (n, k), of one entity."""
    times, values = [], []
    for batch in batches(path, entity):
        names = batch.schema.names
        if (name := next((n for n in names if n.endswith(f":{component}")), None)) is None:
            continue
        times.append(batch["time"].cast(pa.int64()).to_numpy(zero_copy_only=False))
        cells = batch[name]
        flat = cells.flatten().to_numpy(zero_copy_only=False)
        values.append(flat.reshape(len(cells), -1))
    order = np.argsort(np.concatenate(times), kind="stable")
    return np.concatenate(times)[order], np.concatenate(values)[order]


def static(path: Path, entity: str, component: str) -> list[Any]:
    for batch in batches(path, entity, static=True):
        for name in batch.schema.names:
            if name.endswith(f":{component}"):
                return list(batch[name].to_pylist()[0])
    raise AssertionError(f"{entity} has no static {component}")
