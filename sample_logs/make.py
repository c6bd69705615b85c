"""Makes the sample logs from bundled scenarios: python sample_logs/make.py [FOLDER]."""

import csv
import io
import json
import sys
from pathlib import Path

from mcap.writer import CompressionType, Writer

from adhesion_cli.wsp import simulate

START_NS = 1_730_790_720_000_000_000  # 2024-11-05 07:12 UTC, for the log that has a calendar

_TOPICS = {
    "pressure": "/axle/{}/bc_pressure",
    "wheel_speed": "/axle/{}/wheel_speed",
    "train_speed": "/train/speed",
    "truth": "/axle/{}/adhesion_force_true",
    "slip": "/axle/{}/slip_true",
}
_SCHEMA = {
    "title": "Scalar",
    "type": "object",
    "properties": {"value": {"type": "number"}, "unit": {"type": "string"}},
}


def as_csv(recordings: list[simulate.Recording]) -> bytes:
    """One row per time stamp, a cell left empty where a slower channel has no sample."""
    rows: dict[int, list[str]] = {}
    for column, r in enumerate(recordings):
        for t, text in zip(r.t.tolist(), r.texts(), strict=True):
            rows.setdefault(t, [""] * len(recordings))[column] = text
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(["time [s]", *(f"{r.name} [{r.unit}]" for r in recordings)])
    table.writerows([f"{t / 1e9:.3f}", *rows[t]] for t in sorted(rows))
    return out.getvalue().encode()


def as_mcap(recordings: list[simulate.Recording]) -> bytes:
    """One JSON message per sample, each signal of each axle on a topic of its own."""
    out = io.BytesIO()
    writer = Writer(out, compression=CompressionType.LZ4, enable_data_crcs=True)
    writer.start(profile="", library="sample_logs/make.py")
    schema = writer.register_schema("Scalar", "jsonschema", json.dumps(_SCHEMA).encode())
    messages = []
    for r in recordings:
        topic = _TOPICS[r.signal].format(r.axle)
        channel = writer.register_channel(topic, "json", schema)
        for t, text in zip(r.t.tolist(), r.texts(), strict=True):
            if text:  # a logger that has no value sends nothing
                data = f'{{"value": {text}, "unit": "{r.unit}"}}'
                messages.append((START_NS + t, channel, data.encode()))
    for number, (t, channel, data) in enumerate(sorted(messages)):
        writer.add_message(channel, log_time=t, publish_time=t, data=data, sequence=number)
    writer.finish()
    return out.getvalue()


def make() -> dict[str, bytes]:
    """Every sample log by file name."""
    service, low = (
        simulate.log(simulate.run(simulate.load(name)))
        for name in ("service-brake", "low-adhesion")
    )
    return {
        "service-brake.csv": as_csv(service),
        "low-adhesion.csv": as_csv(low),
        "low-adhesion.mcap": as_mcap(low),
    }


if __name__ == "__main__":
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent
    for name, data in make().items():
        (folder / name).write_bytes(data)
        print(f"{folder / name}: {len(data)} bytes")
