"""Runs with different brakes are told apart by their deceleration per bar, whatever their order."""

import numpy as np
import pytest

from adhesion_cli.core.model import LogBrake
from adhesion_cli.results.friction_groups import (
    GroupedRun,
    find_friction_differs,
    group_by_friction,
)

OLD, NEW = (0.46, 0.462, 0.47, 0.455), (0.55, 0.558, 0.548)


def run(
    per_bar: float, log: str = "a.csv", speed: float = 14.0, pressure: float = 2.9
) -> GroupedRun:
    return GroupedRun(log, LogBrake(per_bar, per_bar / 0.5, 0.042, pressure, speed))


@pytest.mark.parametrize("seed", range(5))
def test_two_brakes_are_two_groups_in_any_order(seed: int) -> None:
    values = np.random.default_rng(seed).permutation(OLD + NEW).tolist()
    groups = group_by_friction([run(x) for x in values])
    assert [{values[i - 1] in NEW for i in group.places} for group in groups] == [
        {values[0] in NEW},
        {values[0] not in NEW},
    ]
    factor = np.mean(NEW) / np.mean(OLD)
    expected = factor if values[0] in OLD else 1.0 / factor
    assert groups[1].factor == pytest.approx(expected, rel=0.01)
    assert groups[1].u95 == pytest.approx(1.96 * 0.042 * np.sqrt(2.0) * expected, rel=0.02)


def test_a_run_with_slides_hides_no_other_brake_and_joins_the_nearest() -> None:
    slid = GroupedRun("slid.csv", LogBrake(0.53, 1.06, 0.3, 2.9, 14.0))
    groups = group_by_friction([*(run(x) for x in OLD), *(run(x) for x in NEW), slid])
    assert [group.places for group in groups] == [(1, 2, 3, 4), (5, 6, 7, 8)]


@pytest.mark.parametrize("number", [2, 12, 60])
def test_one_brake_is_one_group(number: int) -> None:
    draws = 0.46 * np.exp(np.random.default_rng(3).normal(0.0, 0.042, (100, number)))
    groups = [group_by_friction([run(x) for x in drawn.tolist()]) for drawn in draws]
    assert sum(len(group) == 1 for group in groups) >= 90


def test_friction_that_falls_with_speed_is_no_other_brake() -> None:
    assert len(group_by_friction([run(0.46, speed=8.0), run(0.36, speed=22.0)])) == 1
    assert len(group_by_friction([run(0.46), run(0.36)])) == 2


def test_a_pressure_at_which_the_brake_begins_is_no_other_brake() -> None:
    assert len(group_by_friction([run(0.46, pressure=0.6), run(0.36)])) == 1


def test_a_run_that_shows_no_brake_is_not_accused() -> None:
    groups = group_by_friction([run(0.46), GroupedRun("slid.csv", None), run(0.56)])
    assert [group.places for group in groups] == [(1, 2), (3,)]
    assert len(group_by_friction([GroupedRun("a.csv", None), GroupedRun("b.csv", None)])) == 1


def test_the_remedy_has_a_vehicle_for_each_group() -> None:
    runs = [run(0.46, "old pads.csv"), run(0.55, "new.csv.gz")]
    (finding,) = find_friction_differs(runs, group_by_friction(runs), ["train.toml"])
    assert finding.names["runs"] == "run 2"
    assert (finding.hint or "").splitlines()[1:] == [
        'adhesion calibrate "old pads.csv" -c train.toml -o brake-1.toml',
        'adhesion analyze "old pads.csv" -c brake-1.toml -o brake-1',
        "adhesion calibrate new.csv.gz -c train.toml -o brake-2.toml",
        "adhesion analyze new.csv.gz -c brake-2.toml -o brake-2",
        'adhesion report "brake-1/old pads.adhesion.mcap" brake-2/new.adhesion.mcap'
        " -o compare.html",
    ]
    assert not find_friction_differs(runs[:1], group_by_friction(runs[:1]))
