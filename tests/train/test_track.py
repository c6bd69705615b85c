"""The gradient of the line: stated, along a profile, or logged."""

import numpy as np
import pytest

from adhesion_cli.core.model import Channel, Column, Log, Meaning, Parameter, Track
from adhesion_cli.train.track import find_gradient

SECONDS = np.arange(0, 61, dtype=np.int64) * 1_000_000_000
PROFILE = ((0.0, 0.0), (1000.0, 0.010), (2000.0, -0.005))


def log(meaning: Meaning, values: np.ndarray, name: str = "x") -> Log:
    data = Column(SECONDS, values, np.ones(len(SECONDS), np.bool_))
    channel = Channel(name, "", meaning, None, "m", "", data)
    return Log("x.csv", "csv", "", False, 0, (channel,), ())


def test_a_stated_gradient_holds_everywhere() -> None:
    found = find_gradient(log("position", SECONDS * 1e-9), Track(Parameter(0.015, 1e-3), True))
    assert found is not None
    np.testing.assert_allclose(found.at(SECONDS), 0.015)
    assert found.sigma == 1e-3


def test_a_profile_holds_from_each_place_and_turns_with_the_train() -> None:
    track = Track(Parameter(0.0, 5e-4), True, PROFILE)
    up = find_gradient(log("position", 20.0 + 40.0 * SECONDS * 1e-9), track)
    down = find_gradient(log("position", 2420.0 - 40.0 * SECONDS * 1e-9), track)
    assert up is not None
    assert down is not None
    assert [float(up.value[i]) for i in (10, 30, 55)] == [0.0, 0.010, -0.005]
    assert [float(down.value[i]) for i in (5, 30, 50)] == [0.005, -0.010, 0.0]


def test_the_named_channel_counts_more_than_the_meaning() -> None:
    track = Track(Parameter(0.0, 5e-4), True, PROFILE, "km")
    other = log("position", np.full(61, 2500.0))
    named = log("distance", 1500.0 + SECONDS * 1e-9, "km")
    both = Log("x.csv", "csv", "", False, 0, (*other.channels, *named.channels), ())
    found = find_gradient(both, track)
    assert found is not None
    assert float(found.value[30]) == 0.010


def test_a_channel_says_it_where_nobody_states_it() -> None:
    logged = log("gradient", np.linspace(0.0, 0.02, 61))
    found = find_gradient(logged, Track())
    assert found is not None
    assert found.at(SECONDS)[30] == pytest.approx(0.01)
    stated = find_gradient(logged, Track(Parameter(-0.01, 0.0), True))
    assert stated is not None
    assert float(stated.value[0]) == -0.01


@pytest.mark.parametrize("track", [Track(), Track(Parameter(0.0, 0.0), True, PROFILE)])
def test_without_a_place_it_is_not_known(track: Track) -> None:
    assert find_gradient(log("temperature", np.zeros(61)), track) is None
