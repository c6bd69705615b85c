"""States in words as 0 and 1, or as the levels of a command."""

from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.channels.log import survey, unchanged
from adhesion_cli.channels.meaning import Mapping
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Channel, Log, Vehicle
from adhesion_cli.formats import source
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

VALVE = Mapping("vent_valve", 1, "position of Y1")


def logged(path: Path, name: str, words: list[str], *mappings: Mapping) -> Log:
    """The channels of a log with a column of words in front of its numbers."""
    lines = [f"t [s],{name},bc pressure [bar]"]
    lines += [f"{0.1 * k:.1f},{word},{0.1 * k:.1f}" for k, word in enumerate(words)]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return survey(open_source(path, ReadOptions()), mappings, Vehicle())


def state(log: Log, meaning: str) -> Channel:
    (channel,) = (c for c in log.channels if c.meaning == meaning)
    return channel


@pytest.mark.parametrize(
    ("name", "meaning", "words", "values", "levels"),
    [
        ("Sanding", "sanding", "off off ON ON", [0, 0, 1, 1], ("off", "ON")),
        ("WSP active", "wsp_active", "TRUE FALSE FALSE", [1, 0, 0], ("FALSE", "TRUE")),
        ("Gleitschutz aktiv", "wsp_active", "aus ein aus", [0, 1, 0], ("aus", "ein")),
        ("vent valve axle 1", "vent_valve", "closed open closed", [0, 1, 0], ("closed", "open")),
        ("hold valve axle 1", "hold_valve", "closed open closed", [1, 0, 1], ("open", "closed")),
        (
            "brake demand step",
            "brake_command",
            "released Step2 Step1 FULL Step2",
            [0, 2, 1, 3, 2],
            ("released", "Step1", "Step2", "FULL"),
        ),
        ("Hamowanie nagłe", "emergency", "NIE NIE TAK", [0, 0, 1], ("NIE", "TAK")),
        ("Hamowanie nagle", "emergency", "FAŁSZ PRAWDA", [0, 1], ("FAŁSZ", "PRAWDA")),
        ("emergency", "emergency", "off invalid on", [0, 1], ("off", "on")),
        ("emergency", "emergency", "inactive inactive inactive", [0, 0, 0], ("inactive",)),
    ],
)
def test_words_are_numbers(
    tmp_path: Path, name: str, meaning: str, words: str, values: list[int], levels: tuple[str, ...]
) -> None:
    channel = state(logged(tmp_path / "x.csv", name, words.split()), meaning)
    np.testing.assert_array_equal(channel.data.value, values)
    assert channel.levels == levels


def test_a_cell_without_a_word_has_no_state(tmp_path: Path) -> None:
    channel = state(logged(tmp_path / "x.csv", "Sanding", ["off", "", "on"]), "sanding")
    np.testing.assert_array_equal(channel.data.value, [0, 1])
    np.testing.assert_array_equal(channel.data.t, [0, 200_000_000])


def test_other_columns_of_text_are_no_channels(tmp_path: Path) -> None:
    for name, words in (("driver", ["on", "off", "on"]), ("WSP software", ["v1", "v1", "v1"])):
        log = logged(tmp_path / f"{name}.csv", name, words)
        assert [c.name for c in log.channels] == ["bc pressure [bar]"]


def test_a_column_with_too_many_words_is_no_channel(tmp_path: Path) -> None:
    words = ["off", *(f"remark {k}" for k in range(source.MOST_WORDS))]
    assert len(logged(tmp_path / "x.csv", "Sanding", words).channels) == 1


def test_a_column_of_words_may_be_stated_as_a_state_only(tmp_path: Path) -> None:
    words = ["zu", "auf", "zu"]
    log = logged(tmp_path / "x.csv", "position of Y1", words, VALVE)
    np.testing.assert_array_equal(state(log, "vent_valve").data.value, [0, 1, 0])
    with pytest.raises(UserError, match="position of Y1"):
        logged(tmp_path / "x.csv", "position of Y1", words, Mapping("pressure", 1, VALVE.channel))


def test_a_copy_has_the_state_as_numbers(tmp_path: Path) -> None:
    logged(tmp_path / "x.csv", "Sanding", ["on", "off", "on"])
    log = unchanged(open_source(tmp_path / "x.csv", ReadOptions()), ())
    by_name = {c.name: c.data.value.tolist() for c in log.channels}
    assert by_name["Sanding"] == [1, 0, 1]


def test_words_beyond_the_head_are_read(tmp_path: Path) -> None:
    words = ["off"] * 90_000 + ["step 1", "emergency", "off"]
    channel = state(logged(tmp_path / "x.csv", "brake demand", words), "brake_command")
    np.testing.assert_array_equal(channel.data.value[-4:], [0, 1, 2, 0])
    assert channel.levels == ("off", "step 1", "emergency")
