"""States in words in every format that has words: the same as in a text log."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import can
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from asammdf import MDF, Signal
from asammdf.blocks.conversion_utils import from_dict
from cantools.database import Message
from cantools.database.can import Database
from cantools.database.can import Signal as CanSignal
from cantools.database.conversion import BaseConversion
from google.protobuf.descriptor_pb2 import DescriptorProto, EnumDescriptorProto
from google.protobuf.descriptor_pb2 import EnumValueDescriptorProto as EnumValue
from google.protobuf.descriptor_pb2 import FieldDescriptorProto as F
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from helpers.mcap_logs import START, Log, cdr, message, proto_file, proto_schema
from mcap.records import Channel, Schema
from nptdms import ChannelObject, TdmsWriter

from adhesion_cli.channels.log import survey, unchanged
from adhesion_cli.core.model import Vehicle
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

N = 300
T = np.arange(N) / 10
WORDS = np.where(np.arange(N) % 100 < 40, "off", "ON")
NUMBERS = np.where(WORDS == "off", 1, 2)  # as a vehicle counts its states
NAME, TOPIC = "sanding", "/train"


def parquet(folder: Path, column: Any) -> Path:
    path = folder / "a.parquet"
    pq.write_table(pa.table({"t [s]": T, "speed [km/h]": T, NAME: column}), path)
    return path


def mf4(folder: Path, samples: Any, **more: Any) -> Path:
    with MDF(version="4.10") as file:
        file.append([Signal(samples, T, name=NAME, **more), Signal(T, T, name="speed")])
        return Path(file.save(folder / "a.mf4", overwrite=True))


def tdms(folder: Path, **wave: float) -> Path:
    channels = [ChannelObject("g", "speed", T, wave), ChannelObject("g", NAME, WORDS.tolist())]
    if not wave:
        channels.append(ChannelObject("g", "Time", T, {"unit_string": "s"}))
    with TdmsWriter(folder / "a.tdms") as file:
        file.write_segment(channels)
    return folder / "a.tdms"


def sanding(log: Any) -> Any:
    """The only channel of this name."""
    (channel,) = (c for c in log.channels if "sanding" in c.title)
    return channel


def mcap(folder: Path, encoding: str, schemas: list[Schema], messages: list[bytes]) -> Path:
    log = Log(schemas, [Channel(1, TOPIC, encoding, {}, len(schemas))])
    log.messages = [message(1, START + k * 10**8, raw) for k, raw in enumerate(messages)]
    path = folder / "a.mcap"
    path.write_bytes(log.bytes())
    return path


def ros2(folder: Path) -> Path:
    schema = Schema(1, b"string frame_id\nstring sanding\nfloat32 extra", "ros2msg", "p/msg/State")
    values = [{"frame_id": f"{k}", NAME: word, "extra": 1.0} for k, word in enumerate(WORDS)]
    return mcap(folder, "cdr", [schema], [cdr(schema, value) for value in values])


def protobuf(folder: Path, is_enum: bool) -> Path:
    kind = {"type": F.TYPE_ENUM, "type_name": ".t.Sanding"} if is_enum else {"type": F.TYPE_STRING}
    field = F(name=NAME, number=1, label=F.LABEL_OPTIONAL, **kind)
    names = ("SANDING_UNSPECIFIED", "SANDING_OFF", "SANDING_ON")
    values = [EnumValue(name=name, number=k) for k, name in enumerate(names)]
    file = proto_file([DescriptorProto(name="State", field=[field])])
    file.enum_type.append(EnumDescriptorProto(name="Sanding", value=values))
    pool = DescriptorPool()
    pool.Add(file)
    make: Any = GetMessageClass(pool.FindMessageTypeByName("t.State"))
    states = NUMBERS.tolist() if is_enum else WORDS.tolist()
    raw = [make(**{NAME: x}).SerializeToString() for x in states]
    return mcap(folder, "protobuf", [proto_schema(file, "State")], raw)


CHOICES = {1: "off", 2: "ON", 3: "not available"}


def bus(folder: Path, numbers: list[int], choices: dict[int, str]) -> Path:
    conversion = BaseConversion.factory(choices=choices)
    signal = CanSignal(NAME, 0, 4, conversion=conversion)
    database = Database([Message(0x123, "Brake", 1, [signal])], version="")
    (folder / "a.dbc").write_text(database.as_dbc_string(), "utf-8")
    with can.Logger(folder / "a.asc") as log:
        for k, number in enumerate(numbers):
            log(can.Message(k / 10, 0x123, data=[number], channel=0, is_extended_id=False))
    return folder / "a.asc"


TO_TEXT = {"val_0": 1, "text_0": b"off", "val_1": 2, "text_1": b"ON"}
FORMATS: dict[str, Callable[[Path], Path]] = {
    "Parquet, texts": lambda folder: parquet(folder, WORDS),
    "Parquet, dictionary": lambda folder: parquet(folder, pa.array(WORDS).dictionary_encode()),
    "Parquet, large texts": lambda folder: parquet(folder, pa.array(WORDS, pa.large_string())),
    "MF4, texts": lambda folder: mf4(folder, WORDS.astype("S"), encoding="utf-8"),
    "MF4, values to texts": lambda folder: mf4(
        folder, NUMBERS.astype("u1"), conversion=from_dict(TO_TEXT)
    ),
    "MF4, some values to texts": lambda folder: mf4(
        folder,
        NUMBERS.astype("u1"),
        conversion=from_dict({**TO_TEXT, "default_addr": {"a": 1.0, "b": 0.0}}),
    ),
    "TDMS, increments": lambda folder: tdms(folder, wf_increment=0.1),
    "TDMS, time channel": tdms,
    "MCAP, JSON": lambda folder: mcap(
        folder, "json", [], [json.dumps({NAME: str(x)}).encode() for x in WORDS]
    ),
    "MCAP, ROS 2": ros2,
    "MCAP, protobuf": lambda folder: protobuf(folder, is_enum=False),
    "MCAP, protobuf enum": lambda folder: protobuf(folder, is_enum=True),
    "CAN": lambda folder: bus(folder, NUMBERS.tolist(), CHOICES),
}


@pytest.mark.parametrize("name", FORMATS)
def test_words_are_states(tmp_path: Path, name: str) -> None:
    path = FORMATS[name](tmp_path)
    options = ReadOptions(dbc=(str(tmp_path / "a.dbc"),) if name == "CAN" else ())
    channel = sanding(survey(open_source(path, options), (), Vehicle()))
    assert channel.meaning == "sanding"
    np.testing.assert_array_equal(channel.data.value, NUMBERS - 1)
    assert [word.casefold() for word in channel.levels] == ["off", "on"]
    copy = unchanged(open_source(path, options), ())
    copied = sanding(copy)
    np.testing.assert_array_equal(copied.data.value, NUMBERS - 1)
    (numbered,) = (f for f in copy.findings if f.code == "words-as-numbers")
    assert re.search("'OFF' is 0, 'ON' is 1", numbered.message, re.IGNORECASE)


def test_values_without_a_word_have_no_state(tmp_path: Path) -> None:
    column = pa.array([None if k == 7 else word for k, word in enumerate(WORDS)])
    source = open_source(parquet(tmp_path, column), ReadOptions())
    channel = sanding(survey(source, (), Vehicle()))
    assert len(channel.data.t) == N - 1


def test_words_that_are_no_state_leave_the_numbers(tmp_path: Path) -> None:
    texts = {"val_0": 1, "text_0": b"first", "val_1": 2, "text_1": b"second"}
    conversion = from_dict({**texts, "default_addr": {"a": 1.0, "b": 0.0}})
    path = mf4(tmp_path, np.full(N, 5, "u1"), conversion=conversion)
    channel = sanding(survey(open_source(path, ReadOptions()), (), Vehicle()))
    assert (channel.levels, set(channel.data.value)) == ((), {5.0})


@pytest.mark.parametrize("name", ["MF4", "CAN"])
def test_words_for_some_numbers_of_a_channel_are_no_state(tmp_path: Path, name: str) -> None:
    """A demand in steps of which only the lowest has a name."""
    steps = np.arange(N) % 5
    if name == "MF4":
        texts = {"val_0": 0, "text_0": b"released", "default_addr": {"a": 1.0, "b": 0.0}}
        path = mf4(tmp_path, steps.astype("u1"), conversion=from_dict(texts))
    else:
        path = bus(tmp_path, steps.tolist(), {0: "released"})
    source = open_source(path, ReadOptions(dbc=(str(tmp_path / "a.dbc"),) * (name == "CAN")))
    channel = sanding(survey(source, (), Vehicle()))
    assert channel.levels == ()
    assert {1.0, 2.0, 3.0, 4.0} <= set(channel.data.value)
