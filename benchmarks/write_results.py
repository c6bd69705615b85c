"""Size and time of the results of a log, compared with the formats' own writers.

    python benchmarks/write_results.py

The log has four axles at 100 Hz: stops of the scenario `low-adhesion`, with the train brought up to
speed in between. It is CSV. In an hour it stops every 5 minutes, as between two towns; in 10
minutes it stops every minute, as a metro does. The rivals write the numbers of the 10 minutes with
all digits, and every sample:

- `mcap.Writer` at its defaults writes the protobuf messages. Its time is without the packing.
- The Rerun SDK at its defaults writes a column of every sample for each line of our recording.

The rival of `analyze` reads the log with `pyarrow.csv` and writes both files. It computes nothing.
Each is measured once. Times are of the processor, all threads together.
"""

import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import numpy as np
import rerun as rr
from mcap.reader import make_reader
from mcap.records import Message
from mcap.writer import Writer
from pyarrow import csv
from table import Row, show

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.outputs import write_results
from adhesion_cli.analysis.settings import Settings
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core import rounding
from adhesion_cli.core.model import Floats, Result
from adhesion_cli.results import mcap, rrd, thinning
from adhesion_cli.wsp import plant, simulate

RATE = 100.0  # [Hz]
TOWNS, METRO = (3600.0, 300.0), (600.0, 60.0)  # length, and a stop with the way back to speed [s]


def write_log(path: Path, stops: int, period: float = 60.0) -> None:
    """The stops as CSV: pressure and wheel speed of each axle, train speed."""
    made, rng = simulate.run(simulate.load("low-adhesion")), np.random.default_rng(1)
    braked = np.arange(0, len(made.t), round(1e9 / RATE / (made.t[1] - made.t[0])))
    share = np.linspace(0.0, 1.0, round(period * RATE) - len(braked))[:, None]
    released, gained = np.interp(share, [0.0, 0.1], [0.0, 1.0]), np.interp(share, [0.1, 1], [0, 1])

    def whole(of: Floats, before: Floats | float, back: Floats, noise: float) -> Floats:
        """A column per axle: braked, and then back to the value before."""
        one = np.concatenate([of[braked], (1.0 - back) * of[braked[-1]] + back * before])
        return np.tile(one, (stops, 1)) + rng.normal(0.0, noise, (stops * len(one), of.shape[1]))

    rim = made.wheel_speed * plant.radii(made.scenario) * 3.6
    train = made.train_speed[:, None] * 3.6
    columns = [whole(made.pressure * 1e-5, 0.0, released, 0.01), whole(rim, rim[0], gained, 0.01)]
    columns += [whole(train, train[0], gained, 0.02)]
    names = [f"bc_pressure_{i} [bar]" for i in range(1, 5)]
    names += [f"wheel_speed_{i} [km/h]" for i in range(1, 5)]
    seconds = np.arange(len(columns[0]))[:, None] / RATE
    header = ",".join(["time [s]", *names, "train_speed [km/h]"])
    np.savetxt(path, np.hstack([seconds, *columns]), "%.2f", ",", header=header, comments="")


def seconds(work: Callable[[], object]) -> float:
    """Processor time, of all threads: other programs do not count."""
    begin = time.process_time()
    work()
    return time.process_time() - begin


def by_mcap(path: Path, of: Path) -> float:
    """The messages of a file, by `mcap.Writer`; returns the time of writing alone [s]."""
    taken = 0.0
    with path.open("wb") as file, of.open("rb") as source:
        writer, known = Writer(file), dict[int, int]()
        writer.start()
        batch: list[tuple[int, Message]] = []

        def flush() -> None:
            for channel, message in batch:
                writer.add_message(
                    channel, message.log_time, message.data, message.publish_time, message.sequence
                )
            batch.clear()

        for schema, channel, message in make_reader(source).iter_messages():
            if channel.id not in known:
                assert schema  # ours have one each
                made = writer.register_schema(schema.name, schema.encoding, schema.data)
                known[channel.id] = writer.register_channel(channel.topic, "protobuf", made)
            batch.append((known[channel.id], message))
            if len(batch) == 100_000:
                taken += seconds(flush)
        return taken + seconds(flush) + seconds(writer.finish)


def by_rerun(path: Path, result: Result) -> None:
    """Every sample of every line of our recording, by the Rerun SDK."""
    rec = rr.RecordingStream("benchmark")
    rec.save(path)
    for axle in result.axles:
        record, reference = axle.record, axle.reference
        columns = {
            "pressure": record.pressure, "clamping": record.clamping_force,
            "wheel": record.wheel_speed, "train": record.train_speed,
            "force": reference.force, "sigma": reference.sigma,
            "lower": reference.lower, "upper": reference.upper,
            "slip": axle.slip, "slope": axle.slope, "confidence": axle.slope_confidence,
            **{f"estimate/{a}": x for a, x in axle.estimates.items()},
            **{f"error/{a}": axle.error(a) for a in axle.estimates},
            **{f"sigma/{a}": x for a, x in axle.sigmas.items()},
        }  # fmt: skip
        times = [rr.TimeColumn("time", duration=record.t.astype("timedelta64[ns]"))]
        for name, values in columns.items():
            if values is not None:
                data = rr.Scalars.columns(scalars=values)
                rec.send_columns(f"axle/{record.axle}/{name}", times, data)
    rec.flush()
    rec.disconnect()


def size(*paths: Path) -> float:
    """Of the files together [MB]."""
    return sum(path.stat().st_size for path in paths) / 1e6


def rows() -> Iterator[Row]:
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        log, files = folder / "log.csv", [folder / "a.mcap", folder / "a.rrd"]

        def run() -> Result:
            result = analyze(log, Settings(), train_speed=True)
            write_results(files, [result], [summarise(result, {})])
            return result

        write_log(log, 1)
        run()  # compiles
        against = "the log as CSV"
        length, period = TOWNS
        write_log(log, round(length / period), period)
        run()
        yield Row("results of an hour, size", size(*files), size(log), "MB", against, most=6)
        length, period = METRO
        write_log(log, round(length / period), period)
        found: list[Result] = []
        own = seconds(lambda: found.append(run()))
        yield Row("results, braked half the time, size", size(*files), size(log), "MB", against)
        yield from against_writers(folder, files, found[0], own)


def against_writers(folder: Path, files: list[Path], result: Result, own: float) -> Iterator[Row]:
    """The files of a result, and all of `analyze`, which took `own` seconds."""
    our_recording = seconds(lambda: rrd.write_results(files[1], [result]))
    whole, bare, sdk = folder / "whole.mcap", folder / "bare.mcap", folder / "sdk.rrd"
    with (
        mock.patch.multiple(rounding, rounded=lambda x, _: x, digits=lambda x: x),
        mock.patch.object(thinning, "LONG_ROWS", 10**9),
    ):
        mcap.write_results(whole, [result], "{}")
    mcap_time, sdk_time = by_mcap(bare, whole), seconds(lambda: by_rerun(sdk, result))
    read_time = seconds(lambda: csv.read_csv(folder / "log.csv"))
    against = "mcap.Writer at its defaults, all digits"
    yield Row("result MCAP, size", size(files[0]), size(bare), "MB", against, most=1)
    against = "Rerun SDK, every sample"
    yield Row("recording, size", size(files[1]), size(sdk), "MB", against, most=1)
    yield Row("recording, time to write", our_recording, sdk_time, "s of CPU", against)
    against = "pyarrow.csv, mcap.Writer, Rerun SDK"
    rival = read_time + mcap_time + sdk_time
    yield Row("analyze 10 min of 4 axles", own, rival, "s of CPU", against)


if __name__ == "__main__":
    show(rows())
