"""The MCAP writer against the ordinary MCAP and protobuf libraries."""

import importlib.util
import re
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.unknown_fields import UnknownFieldSet
from helpers.made_results import EPOCH, near, result
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, Message, Statistics
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

from adhesion_cli.core import physics
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Channel as LogChannel
from adhesion_cli.core.model import Column, Floats, Log, Times
from adhesion_cli.results import descriptors, mcap, names, thinning

SCHEMAS = Path(__file__).parents[2] / "schemas"


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("mcap") / "small.mcap"
    mcap.write_results(path, [result(2, 300)], '{"schema": "adhesion.result/1"}')
    return path


def decoded(path: Path) -> dict[str, list[tuple[Message, Any]]]:
    """Messages by topic in file order, decoded by the ordinary libraries; checks every CRC."""
    return _decoded(path, path.stat().st_mtime_ns)


@lru_cache(maxsize=1)
def _decoded(path: Path, _: int) -> dict[str, list[tuple[Message, Any]]]:
    channels: dict[int, Channel] = {}
    schemas: dict[int, Any] = {}
    factory = DecoderFactory()
    found: dict[str, list[tuple[Message, Any]]] = {}
    with path.open("rb") as file:
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Channel):
                channels[record.id] = record
                found.setdefault(record.topic, [])
            elif type(record).__name__ == "Schema":
                schemas[record.id] = record
            elif isinstance(record, Message):
                channel = channels[record.channel_id]
                decode = factory.decoder_for("protobuf", schemas[channel.schema_id])
                assert decode is not None
                found[channel.topic].append((record, decode(record.data)))
    return found


def column(messages: list[tuple[Message, Any]], field: str) -> Floats:
    return np.array([getattr(m, field) for _, m in messages])


def same(
    path: Path, topic: str, t: Times, within: Floats | float = 0.0, **columns: Floats | None
) -> None:
    messages = decoded(path)[topic]
    assert [r.log_time for r, _ in messages] == [r.publish_time for r, _ in messages] == list(t)
    assert [m.timestamp.ToNanoseconds() for _, m in messages] == list(t)
    assert [r.sequence for r, _ in messages] == list(range(len(t)))
    for field, values in columns.items():
        assert values is not None
        near(column(messages, field), values, within)


def test_numbers_of_a_result(small: Path) -> None:
    analysed = result(2, 300)
    for axle in analysed.axles:
        r, t, root = axle.record, axle.record.t, f"/axle/{axle.record.axle}"
        same(
            small, f"{root}/input", t, brake_cylinder_pressure=r.pressure,
            clamping_force=r.clamping_force, wheel_speed=r.wheel_speed, train_speed=r.train_speed,
        )  # fmt: skip
        ref = axle.reference
        number, most = axle.record.axle, ref.sigma / 32.0
        mu = physics.coefficient(ref.force, analysed.vehicle, number)
        most_mu = physics.coefficient(most, analysed.vehicle, number)
        same(small, f"{root}/reference", t, most, force=ref.force, lower=ref.lower, upper=ref.upper)
        same(small, f"{root}/reference", t, ref.sigma / 512.0, sigma=ref.sigma)
        same(small, f"{root}/reference", t, most_mu, coefficient=mu)
        same(small, f"{root}/truth", t, force=r.truth)
        same(small, f"{root}/slip", t, 2.0**-17, slip=axle.slip)
        same(small, f"{root}/slip", t, most_mu, coefficient=mu)
        for algo, force in axle.estimates.items():
            assert r.truth is not None
            topic = f"{root}/estimate/{algo}"
            same(small, topic, t, most, force=force, error=force - r.truth)
            estimate = physics.coefficient(force, analysed.vehicle, number)
            same(small, topic, t, most_mu, coefficient=estimate)


def test_error_is_against_the_reference_without_truth(tmp_path: Path) -> None:
    analysed = result(1, 50)
    axle = analysed.axles[0]
    axle = replace(
        axle, record=replace(axle.record, truth=None, true_slip=None, train_speed=None), slip=None,
        scores=tuple(replace(s, against="reference") for s in axle.scores),
    )  # fmt: skip
    path = tmp_path / "a.mcap"
    mcap.write_results(path, [replace(analysed, axles=(axle,))], "{}")
    found = decoded(path)
    assert not {"/axle/1/truth", "/axle/1/slip"} & set(found)
    error = axle.estimates["neso"] - axle.reference.force
    written = column(found["/axle/1/estimate/neso"], "error")
    near(written, error, axle.reference.sigma / 32.0)
    assert np.isnan(column(found["/axle/1/input"], "train_speed")).all()  # not 0 m/s


def test_a_long_log_keeps_few_computed_samples_between_its_brakes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    analysed = result(2, 4000)
    first, second = analysed.axles
    where = slice(1500, 2000)
    braked = replace(first, applications=(where,), events=())
    both = replace(analysed, axles=(braked, replace(second, applications=(), events=())))
    kept = {}
    for full in (True, False):
        path = tmp_path / f"{full}.mcap"
        monkeypatch.setattr(thinning, "LONG_ROWS", 4000 if full else 1000)  # a short log has all
        mcap.write_results(path, [both], "{}")
        kept[full] = {
            topic: {r.log_time: r.data for r, _ in messages}
            for topic, messages in decoded(path).items()
        }
        with path.open("rb") as file:
            told = {m.name: m.metadata for m in make_reader(file).iter_metadata()}
        assert ("thinned" in told["adhesion.provenance"]) == (not full)
    t = braked.record.t
    near = (t >= t[where.start] - 2 * 10**9) & (t <= t[where.stop - 1] + 2 * 10**9)
    for topic in ("/axle/1/input", "/axle/1/truth", "/axle/2/input"):  # it can be analysed again
        assert kept[False][topic] == kept[True][topic]
    spans = len(np.unique(t // 500_000_000))
    for axle, exact in ((1, near), (2, np.zeros(len(t), bool))):
        for topic in (f"/axle/{axle}/{x}" for x in ("reference", "slip", "estimate/neso")):
            every, some = kept[True][topic], kept[False][topic]
            assert len(every) == len(t)
            assert every.items() >= some.items()
            assert set(t[exact].tolist()) <= set(some)
            assert spans <= len(some) <= np.count_nonzero(exact) + spans


def test_an_estimate_has_its_sigma_where_the_method_has_one(tmp_path: Path) -> None:
    analysed = result(1, 50)
    (axle,) = analysed.axles
    sigma = np.arange(50.0)
    path = tmp_path / "a.mcap"
    known = replace(axle, sigmas={"neso": sigma})
    mcap.write_results(path, [replace(analysed, axles=(known,))], "{}")
    found = decoded(path)
    np.testing.assert_allclose(column(found["/axle/1/estimate/neso"], "sigma"), sigma, 1.0 / 512.0)
    assert np.isnan(column(found["/axle/1/estimate/td"], "sigma")).all()  # not 0 N


def test_a_brake_is_released_when_its_pressure_is_gone(tmp_path: Path) -> None:
    analysed = result(1, 3000)
    (axle,) = analysed.axles
    begins = axle.record.segments[1].start
    stands = begins + 200  # with the brake on
    application = slice(begins, stands)
    for K, released in ((np.full(3000, 2e4), False), (axle.record.clamping_force, True)):
        path = tmp_path / f"{released}.mcap"
        record = replace(axle.record, clamping_force=K)
        stood = replace(axle, record=record, applications=(application,))
        mcap.write_results(path, [replace(analysed, axles=(stood,))], "{}")
        told = {m.code: r.log_time for r, m in decoded(path)["/events"]}
        assert "brake-applied" in told
        assert ("brake-released" in told) == released
    last = int(np.searchsorted(axle.record.t, told["brake-released"]))
    assert last > stands
    assert K[last] <= 0.2 * K[application].max() < K[last - 1]


def test_events(small: Path, tmp_path: Path) -> None:
    analysed = result(2, 300)
    coarse = Finding("standstill", "info", "time")
    whole = replace(analysed, findings=(*analysed.findings, coarse))
    mcap.write_results(tmp_path / "a.mcap", [whole], "{}")
    (of_all,) = (m for _, m in decoded(tmp_path / "a.mcap")["/events"] if m.code == "standstill")
    assert not of_all.HasField("axle")
    events = decoded(small)["/events"]
    assert [r.log_time for r, _ in events] == sorted(r.log_time for r, _ in events)
    told = {(r.log_time - EPOCH, m.code, m.severity, m.axle) for r, m in events}
    record = analysed.axles[0].record
    applied = analysed.axles[0].applications[0]
    assert (int(record.t[applied.start]) - EPOCH, "brake-applied", "info", 1) in told
    assert "brake-released" not in {code for _, code, _, _ in told}  # it ends with the brake on
    assert (1_650_000_000, "gap", "warning", 2) in told
    assert (0, "no-application", "info", 1) in told
    gap = next(m for _, m in events if m.code == "gap")
    assert gap.message == f"speed 2: {whole.findings[0].message}"


def test_messages_have_the_time_and_no_unknown_field(small: Path) -> None:
    messages = [pair for topic in decoded(small).values() for pair in topic]
    assert len(messages) == 2 * 9 * 300 + 2 + 2  # brakes applied, gap and unit
    for record, message in messages:
        assert message.timestamp.ToNanoseconds() == record.log_time
        assert len(record.data) - len(message.SerializeToString()) <= 2 * 7  # zeros of the stamp
        assert not len(UnknownFieldSet(message))


def test_indexes_statistics_and_metadata(small: Path) -> None:
    found = decoded(small)
    with small.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        assert summary is not None
        assert isinstance(summary.statistics, Statistics)
        counts = summary.statistics.channel_message_counts
        assert {summary.channels[i].topic: n for i, n in counts.items()} == {
            topic: len(messages) for topic, messages in found.items()
        }
        assert summary.statistics.message_count == sum(map(len, found.values()))
        assert summary.statistics.message_start_time == EPOCH
        assert summary.statistics.message_end_time == EPOCH + 2_990_000_000
        # a window and a topic, reached by the indexes alone
        start, end = EPOCH + 10**9, EPOCH + 2 * 10**9
        by_index = reader.iter_messages(["/axle/2/reference"], starting_at=start, ending_before=end)
        expected = [r.log_time for r, _ in found["/axle/2/reference"] if start <= r.log_time < end]
        assert [m.log_time for _, _, m in by_index] == expected
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert metadata["adhesion.settings"]["neso.beta1"] == "216.0"
    assert metadata["adhesion.settings"]["vehicle.wheel_radius"] == "[0.42]"
    assert metadata["adhesion.provenance"]["input"] == "stop.csv"
    assert metadata["adhesion.provenance"]["input_sha256"] == "0" * 64
    assert "Rauch" in metadata["adhesion.provenance"]["sources"]
    assert metadata["adhesion.metrics"]["json"] == '{"schema": "adhesion.result/1"}'


def test_same_input_same_bytes(small: Path, tmp_path: Path) -> None:
    mcap.write_results(tmp_path / "b.mcap", [result(2, 300)], '{"schema": "adhesion.result/1"}')
    assert (tmp_path / "b.mcap").read_bytes() == small.read_bytes()


def test_chunks_are_bounded_and_in_time_even_where_the_clock_jumps_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(mcap, "CHUNK", mcap.CHUNK // 10)
    forward = np.arange(6_000, dtype=np.int64) * 10**6
    jumping = np.concatenate([forward[:4_000], forward[500:2_500]])
    slow = forward[::100]
    data = [("a", forward), ("b", jumping), ("c", slow), ("d", jumping)]
    path = tmp_path / "a.mcap"
    mcap.write_log(path, log(*((n, t, np.arange(len(t), dtype=float)) for n, t in data)))
    with path.open("rb") as file:
        chunks = [r for r in StreamReader(file, emit_chunks=True).records if isinstance(r, Chunk)]
    sizes = [c.uncompressed_size for c in chunks]
    assert len(sizes) > 2
    assert max(sizes) < 1.3 * mcap.CHUNK
    found = decoded(path)
    for name, t in data:
        assert [r.log_time for r, _ in found[name]] == list(t)
        np.testing.assert_array_equal(column(found[name], "value"), np.arange(len(t)))
    # where no clock jumps, a reader that goes through the file meets the messages in time order
    mcap.write_log(path, log(("a", forward, forward * 1.0), ("c", slow, slow * 1.0)))
    with path.open("rb") as file:
        times = [r.log_time for r in StreamReader(file).records if isinstance(r, Message)]
    assert all(a <= b for a, b in pairwise(times))


def log(*channels: tuple[str, Times, Floats], absolute: bool = False, unit: str = "bar") -> Log:
    return Log(
        "log.csv", "csv", "0" * 64, absolute, 1,
        tuple(
            LogChannel(name, "", None, None, unit, "", Column(t, v, np.isfinite(v)))
            for name, t, v in channels
        ),
        (),
    )  # fmt: skip


TIMES = st.lists(
    st.one_of(
        st.integers(0, 2**63 - 1),
        st.integers(0, 300),
        st.integers(0, 100).map(lambda s: s * 10**9),
        st.sampled_from([0, 127, 128, 2**14 - 1, 2**14, 2**21, 2**28, 999_999_999, 10**9]),
    ),
    max_size=30,
)
VALUES = st.one_of(st.floats(), st.sampled_from([0.0, -0.0, float("nan")]))


@settings(max_examples=40)
@given(
    axes=st.lists(TIMES, max_size=4), values=st.lists(VALUES, min_size=30, max_size=30),
    unit=st.text(max_size=5).filter(lambda u: u.isprintable()),
)  # fmt: skip
def test_any_log_reads_back(
    tmp_path_factory: pytest.TempPathFactory, axes: list[list[int]], values: list[float], unit: str
) -> None:
    path = tmp_path_factory.getbasetemp() / "any.mcap"
    channels = [
        (f"c{i}", np.array(t, np.int64), np.array(values[: len(t)])) for i, t in enumerate(axes)
    ]
    mcap.write_log(path, log(*channels, unit=unit))
    found = decoded(path)
    assert list(found) == [name for name, _, _ in channels]
    for name, t, v in channels:
        known = np.isfinite(v)
        same(path, name, t[known], value=v[known])
        for record, message in found[name]:
            assert message.unit == unit
            assert message.timestamp.ToNanoseconds() == record.log_time
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        known = sum(int(np.isfinite(v).sum()) for _, _, v in channels)
        assert sum(1 for _ in reader.iter_messages()) == known


def test_wide_and_long_logs(tmp_path: Path) -> None:
    t = np.arange(50, dtype=np.int64)
    channels = [(f"c{i}", t, np.full(50, float(i))) for i in range(300)]
    mcap.write_log(tmp_path / "a.mcap", log(*channels))
    found = decoded(tmp_path / "a.mcap")
    assert [column(found[n], "value")[0] for n, _, _ in channels] == list(range(300))
    with pytest.raises(UserError, match="65535"):
        mcap.write_log(tmp_path / "b.mcap", log(*[("c", t[:0], t[:0] * 1.0)] * 65_536))


def test_time_before_zero(tmp_path: Path) -> None:
    t = np.array([-2_500_000_000, 0, 1], np.int64)
    mcap.write_log(tmp_path / "a.mcap", log(("a", t, t * 1.0)))
    assert [r.log_time for r, _ in decoded(tmp_path / "a.mcap")["a"]] == list(t + 3 * 10**9)
    with (tmp_path / "a.mcap").open("rb") as file:
        (metadata,) = make_reader(file).iter_metadata()
    assert metadata.metadata["time_shift_ns"] == "3000000000"
    with pytest.raises(UserError, match="before 1970"):
        mcap.write_log(tmp_path / "b.mcap", log(("a", t, t * 1.0), absolute=True))


def test_an_event_before_zero_shifts_the_file(tmp_path: Path) -> None:
    analysed = result(1, 300)
    at = -2.5 - analysed.log.start_ns() * 1e-9  # a row whose time is none of the log's
    row = Finding("time-out-of-order", "warning", spans=((at, at),))
    analysed = replace(analysed, log=replace(analysed.log, absolute=False), findings=(row,))
    mcap.write_results(tmp_path / "a.mcap", [analysed], "{}")
    found = decoded(tmp_path / "a.mcap")
    assert found["/events"][0][0].log_time == pytest.approx(0.5e9, abs=1e3)
    first = int(analysed.axles[0].record.t[0])
    assert found["/axle/1/input"][0][0].log_time == first + 3 * 10**9


def test_units_and_names_of_a_log(tmp_path: Path) -> None:
    t = np.array([0], np.int64)
    one = log(("BC [kPa]", t, t * 1.0), ("v", t, t * 1.0), ("v", t, t * 1.0), unit="kPa")
    in_si = replace(one.channels[0], meaning="pressure")
    hostile = replace(one.channels[0], name="\x1b[2Ja\u202eb\nc", unit="")
    one = replace(one, channels=(in_si, *one.channels, hostile))
    expected = ["BC", "BC [kPa]", "v", "v (2)", "\\x1b[2Ja\\u202eb\\nc"]
    mcap.write_log(tmp_path / "a.mcap", one)
    with (tmp_path / "a.mcap").open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    channels = list(summary.channels.values())
    assert [c.topic for c in channels] == expected
    assert [c.metadata["unit"] for c in channels] == ["Pa", "kPa", "kPa", "kPa", ""]


def test_hostile_findings(tmp_path: Path) -> None:
    names_ = {"reason": "two\nlines \x1b]0;pwned\x07", "hint": ""}
    finding = Finding("not-analysable", "info", "ch\u202e", names=names_)
    mcap.write_results(tmp_path / "a.mcap", [replace(result(1, 20), findings=(finding,))], "{}")
    message = next(
        m.message for _, m in decoded(tmp_path / "a.mcap")["/events"] if "pwned" in m.message
    )
    assert message.startswith("ch\\u202e: ")
    assert "two\\nlines \\x1b]0;pwned\\x07" in message


def test_findings_larger_than_a_chunk(tmp_path: Path) -> None:
    long = {"reason": "a" * 2 * mcap.CHUNK, "hint": ""}
    findings = tuple(Finding("not-analysable", "info", names=long) for _ in range(3))
    mcap.write_results(tmp_path / "a.mcap", [replace(result(1, 5), findings=findings)], "{}")
    events = decoded(tmp_path / "a.mcap")["/events"]
    assert sum(len(m.message) > 2 * mcap.CHUNK for _, m in events) == 3


def test_comparison_keeps_logs_apart(tmp_path: Path) -> None:
    logs = [
        result(1, 20, name="a.csv"),
        result(1, 30, start=0, name="b.mcap"),
        result(1, 10, name="a.mcap"),
    ]
    mcap.write_results(tmp_path / "c.mcap", logs, "{}")
    found = decoded(tmp_path / "c.mcap")
    assert [len(found[f"/{n}/axle/1/reference"]) for n in names.logs(logs)] == [20, 30, 10]
    with (tmp_path / "c.mcap").open("rb") as file:
        metadata = {m.name: m.metadata for m in make_reader(file).iter_metadata()}
    assert metadata["adhesion.provenance"]["a (2).input"] == "a.mcap"
    assert metadata["adhesion.settings/b"]["neso.beta1"] == "216.0"


def test_empty_log(tmp_path: Path) -> None:
    mcap.write_log(tmp_path / "a.mcap", log())
    assert decoded(tmp_path / "a.mcap") == {}


# ---- schemas


def test_descriptors_are_those_of_the_proto_files() -> None:
    spec = importlib.util.spec_from_file_location("generate", SCHEMAS / "generate.py")
    assert spec is not None
    assert spec.loader is not None
    generate = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(generate)
    fresh = FileDescriptorSet.FromString(generate.compiled())
    assert fresh == FileDescriptorSet.FromString(generate.TARGET.read_bytes())


def test_each_schema_holds_the_message_and_all_it_needs() -> None:
    for proto in SCHEMAS.glob("adhesion/*.proto"):
        files = FileDescriptorSet.FromString(descriptors.schema(proto.stem)).file
        assert [f.name for f in files] == [
            "google/protobuf/timestamp.proto",
            f"adhesion/{proto.stem}.proto",
        ]
        assert [m.name for m in files[1].message_type] == [proto.stem]
        assert descriptors.numbers(proto.stem)["timestamp"] == 1


def test_units_written_are_those_of_the_proto_files(small: Path) -> None:
    with small.open("rb") as file:
        summary = make_reader(file).get_summary()
    assert summary is not None
    checked = 0
    for channel in summary.channels.values():
        text = (
            SCHEMAS / f"{summary.schemas[channel.schema_id].name.replace('.', '/')}.proto"
        ).read_text()
        for key, unit in channel.metadata.items():
            field = key.removeprefix("unit.")
            assert re.search(rf"double {field} = \d+;\s+// \[{re.escape(unit)}\]", text), (
                field,
                unit,
            )
            checked += 1
    assert checked > 30


def test_contract_of_the_interface() -> None:
    fields = {
        "AxleInput": "brake_cylinder_pressure clamping_force wheel_speed train_speed",
        "Reference": "force sigma lower upper coefficient",
        "Estimate": "force coefficient error sigma",
        "Truth": "force slip",
        "Slip": "slip coefficient slope slope_confidence region",
        "Event": "code severity axle message",
    }
    for message, expected in fields.items():
        assert list(descriptors.numbers(message)) == ["timestamp", *expected.split()]
