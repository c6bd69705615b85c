"""How much faster result files are written than with mcap.Writer and one protobuf object each.

    python benchmarks/write_mcap.py

Both write the same `adhesion.Reference` messages (five doubles, no NaN) with zstd, chunk CRCs and
message indexes; ours also reads its file back. Turn by turn, the quickest of the turns counts.
A second row compares one `adhesion.Scalar` per message.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from mcap.writer import Writer
from table import Row, show

from adhesion_cli.core.model import (
    AxleRecord,
    AxleResult,
    Channel,
    Column,
    Floats,
    IdentifiedVehicle,
    Log,
    Reference,
    Result,
    Times,
    Vehicle,
)
from adhesion_cli.results import descriptors, mcap

TURNS = 3
START = 1_760_000_000 * 10**9


def result(t: Times, v: list[Floats]) -> Result:
    log = Log("log.csv", "csv", "0" * 64, True, len(t), (), ())
    record = AxleRecord(1, t, v[0], v[0], v[1], (slice(0, len(t)),))
    reference = Reference("", "", v[0], v[1], v[2])
    axle = AxleResult(record, reference, {"neso": v[4], "td": v[3]}, (), ())
    return Result(log, IdentifiedVehicle(Vehicle(), "stated", None), (axle,), (), {})


def by_objects(path: Path, message: str, fields: list[str], t: Times, v: list[Floats]) -> None:
    kind = descriptors.message(message)
    with path.open("wb") as file:
        writer = Writer(file, enable_data_crcs=True)
        writer.start()
        schema = writer.register_schema(
            f"adhesion.{message}", "protobuf", descriptors.schema(message)
        )
        channel = writer.register_channel("/a", "protobuf", schema)
        for i, (ns, *row) in enumerate(zip(t.tolist(), *(x.tolist() for x in v), strict=True)):
            one = kind(**dict(zip(fields, row, strict=True)))
            one.timestamp.FromNanoseconds(ns)
            writer.add_message(channel, ns, one.SerializeToString(), ns, i)
        writer.finish()


def best(*works: Callable[[], None]) -> list[float]:
    times: list[list[float]] = [[] for _ in works]
    for _ in range(TURNS):
        for work, taken in zip(works, times, strict=True):
            begin = time.perf_counter()
            work()
            taken.append(time.perf_counter() - begin)
    return [min(taken) for taken in times]


def rows(n: int = 200_000) -> Iterator[Row]:
    rng = np.random.default_rng(1)
    t = START + np.arange(n) * 10_000_000 + rng.integers(0, 100_000, n)
    v = [np.cumsum(rng.normal(0, 1, n)) for _ in range(5)]
    fields = ["force", "sigma", "lower", "upper", "coefficient"]
    whole = result(t, v)  # input, reference and two estimates: four messages a row
    data = Column(t, v[0], np.ones(n, bool))
    log = Log("", "csv", "", True, n, (Channel("a", "", None, None, "N", "", data),), ())
    with tempfile.TemporaryDirectory() as folder:
        ours, theirs = Path(folder) / "ours.mcap", Path(folder) / "theirs.mcap"
        few = n // 4  # objects are slow
        for name, per_row, write, message, names, columns in (
            ("result", 4, lambda: mcap.write_results(ours, [whole], "{}"), "Reference", fields, v),
            ("scalars", 1, lambda: mcap.write_log(ours, log), "Scalar", ["value"], v[:1]),
        ):
            cut = [x[:few] for x in columns]
            object_time, our_time = best(
                lambda m=message, n=names, c=cut: by_objects(theirs, m, n, t[:few], c), write
            )
            quick, slow = per_row * n / our_time / 1e3, few / object_time / 1e3
            against = "mcap.Writer, an object per message"
            yield Row(f"write {name}", quick, slow, "k msg/s", against, least=5)


if __name__ == "__main__":
    show(rows())
