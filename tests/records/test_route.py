"""Where a train was: by its position, its distance or its coordinates, with jumps found."""

from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Channel, Column, Floats, Log, Meaning, Vehicle
from adhesion_cli.records.route import NOWHERE, check_route, find_route

SPEED = 20.0  # [m/s]
T = np.arange(0.0, 100.0, 0.1)  # [s]
METRES = 12_000.0 + SPEED * T
NORTH = 50.0 + SPEED * T / 111_195.0  # along a meridian [°]
FIRST = 10**18  # time of the first sample [ns]


def channel(meaning: Meaning, value: Floats, t: Floats = T) -> Channel:
    times = FIRST + np.round(1e9 * t).astype(np.int64)
    data = Column(times, value, np.ones(len(t), np.bool_))
    return Channel(meaning, "", meaning, None, "", "", data)


def log(speed: float = SPEED, **places: Floats) -> Log:
    channels = [channel("train_speed", np.full(len(T), speed))]
    channels += [channel(meaning, value) for meaning, value in places.items()]  # type: ignore[arg-type]
    return Log("a.csv", "csv", "", True, len(T), tuple(channels), ())


def findings(of: Log) -> dict[str, Finding]:
    return {f.code: f for f in check_route(of, Vehicle())}


def test_the_position_counts_more_than_distance_and_coordinates() -> None:
    coordinates = {"latitude": NORTH, "longitude": np.full(len(T), 8.6)}
    whole = log(position=METRES, distance=METRES - 7000.0, **coordinates)
    route = find_route(whole)
    assert route.position_from == "position"
    place = route.at(FIRST + 10_050_000_000)
    assert place.position_m == pytest.approx(12_201.0)
    assert place.position_km == pytest.approx(12.201)
    assert place.latitude == pytest.approx(50.0 + 201.0 / 111_195.0, abs=1e-6)
    assert place.longitude == 8.6
    assert findings(whole) == {}


def test_a_distance_counts_from_the_start_of_the_log() -> None:
    route = find_route(log(distance=METRES))
    assert route.position_from == "distance"
    assert route.at(FIRST + 10 * 10**9).position_m == pytest.approx(200.0)
    assert route.lines() == []


def test_coordinates_give_the_length_of_the_way() -> None:
    noise = np.random.default_rng(1).normal(0.0, 2.0 / 111_195.0, len(T))
    of = log(latitude=NORTH + noise, longitude=np.full(len(T), 8.6))
    route = find_route(of)
    assert route.position_from == "coordinates"
    assert route.at(FIRST + 90 * 10**9).position_m == pytest.approx(1800.0, rel=0.02)
    (line,) = route.lines()
    assert len(line) < 0.5 * len(T)
    assert findings(of) == {}


def test_a_receiver_at_rest_makes_no_way() -> None:
    noise = np.random.default_rng(1).normal(50.0, 2.0 / 111_195.0, len(T))
    route = find_route(log(0.0, latitude=noise, longitude=np.full(len(T), 8.6)))
    assert route.at(FIRST + 90 * 10**9).position_m == 0.0


def test_without_a_place_there_is_none() -> None:
    assert find_route(log()).at(FIRST) == ("2001-09-09T01:46:40Z", None, None, None)
    assert NOWHERE.at(FIRST) == (None, None, None, None)
    assert findings(log()) == {}


def test_a_jump_is_named_and_nothing_is_interpolated_over_it() -> None:
    jumped = np.where(T < 50.0, METRES, METRES + 3000.0)
    of = log(position=jumped)
    (jump,) = check_route(of, Vehicle())
    assert (jump.code, jump.channel, jump.count) == ("position-jumps", "position", 1)
    assert jump.spans == ((pytest.approx(49.9), pytest.approx(50.0)),)
    assert jump.values["largest_m"] == pytest.approx(3002.0)
    route = find_route(of)
    assert route.at(FIRST + 49_950_000_000).position_m is None
    assert route.at(FIRST + 50_000_000_000).position_m == pytest.approx(16_000.0)


def test_a_jump_of_coordinates_parts_the_line() -> None:
    jumped = np.where((T > 40.0) & (T < 60.0), NORTH + 0.5, NORTH)
    of = log(latitude=jumped, longitude=np.full(len(T), 8.6))
    assert findings(of)["position-jumps"].count == 2
    assert len(find_route(of).lines()) == 3


def test_zero_coordinates_are_no_place() -> None:
    lost = T < 20.0
    of = log(latitude=np.where(lost, 0.0, NORTH), longitude=np.where(lost, 0.0, 8.6))
    assert findings(of) == {}
    assert find_route(of).at(FIRST).latitude is None


def test_a_place_over_a_gap_is_not_known() -> None:
    known = (T < 30.0) | (T > 60.0)
    channels = (channel("position", METRES[known], T[known]),)
    route = find_route(Log("a.csv", "csv", "", True, 1, channels, ()))
    assert route.at(FIRST + 45 * 10**9).position_m is None
    assert route.at(FIRST + 20 * 10**9).position_m == pytest.approx(12_400.0)


@pytest.mark.parametrize(("factor", "contradicts"), [(1.03, False), (1.1, True), (1.609, True)])
def test_a_distance_that_the_speed_contradicts_is_named(factor: float, contradicts: bool) -> None:
    of = log(distance=factor * (METRES - METRES[0]))
    codes = findings(of)
    assert ("distance-contradicts-speed" in codes) is contradicts
    if contradicts:
        values = codes["distance-contradicts-speed"].values
        assert values["share"] == pytest.approx(factor, rel=1e-3)
        assert values["by_speed_m"] == pytest.approx(SPEED * 99.0)


def test_a_distance_beside_the_kilometres_is_checked_and_may_begin_anew() -> None:
    begun_anew = np.where(T < 50.0, METRES, METRES - METRES[len(T) // 2]) - METRES[0]
    assert findings(log(position=METRES, distance=begun_anew)) == {}
    codes = findings(log(position=METRES, distance=1.2 * (METRES - METRES[0])))
    assert codes["distance-contradicts-speed"].channel == "distance"


def test_wheels_that_slide_contradict_no_distance() -> None:
    """Both wheels are slow for a while, and no train speed shows it."""
    rim = np.where((T > 40.0) & (T < 60.0), 0.3 * SPEED, SPEED)
    wheels = [replace(channel("wheel_speed", rim / 0.42), axle=axle) for axle in (1, 2)]
    channels = (*wheels, channel("distance", METRES))
    assert check_route(Log("a.csv", "csv", "", True, 1, channels, ()), Vehicle()) == []


def test_falling_kilometres_contradict_nothing() -> None:
    assert findings(log(position=50_000.0 - SPEED * T)) == {}


def test_coarse_kilometres_are_no_jumps() -> None:
    assert findings(log(position=np.floor(METRES / 100.0) * 100.0)) == {}
