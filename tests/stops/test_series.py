"""The series: statistics against their formulas, groups, limits, wet against dry."""

import math
from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.core.summary import AxleStop, Measured, StopSummary
from adhesion_cli.stops.series import (
    QUANTITIES,
    GroupLimit,
    SeriesStop,
    braked_weight_percentage,
    compare_wet,
    differences,
    group_stops,
    judge,
    wet_speeds,
)


def stop(distance: float, u95: float = 4.0, common: float = 3.0, v0: float = 20.0) -> StopSummary:
    x = Measured(distance, u95, common)
    return StopSummary(
        start_s=1.0, end_s=30.0, command_from="channel", speed_from="train", nominal_speed_kmh=80.0,
        valid=True, initial_speed_mps=Measured(v0, 0.1, 0.1), distance_m=x, duration_s=None,
        delay_s=None, response_time_s=Measured(1.0, 0.1), mean_deceleration=None,
        equivalent_deceleration=None, jerk=None, corrected_distance_m=None,
    )  # fmt: skip


def series(distances: dict[str, list[float]], u95: float = 4.0) -> list[SeriesStop]:
    return [
        SeriesStop(f"{name}.csv", name, None, stop(d, u95)) for name, x in distances.items()
        for d in x
    ]  # fmt: skip


def test_a_mean_keeps_the_common_error_that_scatter_averages_out() -> None:
    from scipy import stats  # slow to import

    values = [300.0, 304.0, 296.0, 302.0, 298.0, 300.0]
    (group,) = group_stops(series({"a": values}))
    x = group.statistics["distance_m"]
    sd = float(np.std(values, ddof=1))
    factor = float(stats.t.ppf(0.975, 5))
    assert (x.n, x.mean, x.sd) == (6, 300.0, pytest.approx(sd))
    assert x.u95 == pytest.approx(math.hypot(factor * sd / math.sqrt(6.0), 3.0))
    assert x.scatter == pytest.approx(8.0 / 300.0)
    assert x.outliers == ()
    # many stops: only the common part is left
    (many,) = group_stops(series({"a": values * 100}))
    assert many.statistics["distance_m"].u95 == pytest.approx(3.0, rel=0.01)


def test_an_error_of_the_stops_that_does_not_scatter_stays_in_the_mean() -> None:
    """A delay of 0.30 s, read from 0.01 s before the command in each of the stops."""
    rows = [
        replace(s, stop=replace(s.stop, delay_s=Measured(0.31 + 1e-4 * k, 0.015)))
        for k, s in enumerate(series({"a": [300.0] * 5, "b": [300.0] * 5}))
    ]
    first, second = group_stops(rows)
    x = first.statistics["delay_s"]
    assert x.u95 == pytest.approx(0.015, rel=0.01)
    assert x.common_u95 == pytest.approx(0.015, rel=0.01)
    (change,) = (d for d in differences([first, second], [("a", "b")]) if d.quantity == "delay_s")
    # it may be another one in the other group
    assert change.u95 == pytest.approx(0.015 * math.sqrt(2.0), rel=0.01)


def test_an_error_that_does_not_scatter_is_in_the_extension() -> None:
    x = compare_wet(series({"dry": [300.0] * 3, "wet": [400.0] * 3}), "dry", "wet")
    lengths = np.array([280.0, 380.0])  # after a response of 1 s from 20 m/s
    own, common = math.sqrt(4.0**2 - 3.0**2) / lengths, 3.0 / lengths
    ratio = lengths[1] / lengths[0]
    assert x.extension == pytest.approx(ratio - 1.0)
    assert x.extension_u95 == pytest.approx(ratio * math.hypot(*own, common[1] - common[0]))


def test_one_stop_has_its_own_uncertainty() -> None:
    (group,) = group_stops(series({"a": [300.0]}))
    x = group.statistics["distance_m"]
    assert (x.n, x.sd, x.u95, x.drift) == (1, None, 4.0, None)
    assert "delay_s" not in group.statistics


def test_stops_that_are_not_valid_do_not_count() -> None:
    rows = series({"a": [300.0, 300.0]})
    rows[1] = replace(rows[1], stop=replace(rows[1].stop, valid=False, reason="cut"))
    (group,) = group_stops(rows)
    assert (group.n, group.statistics["distance_m"].n) == (1, 1)


def test_of_twenty_groups_of_sound_stops_one_has_an_outlier() -> None:
    rng, groups, accused = np.random.default_rng(3), 300, 0
    for _ in range(groups):
        rows = []
        for numbers in rng.normal(100.0, 1.0, (12, len(QUANTITIES))):
            quantities = {q: Measured(x, 4.0) for q, x in zip(QUANTITIES, numbers, strict=True)}
            rows.append(SeriesStop("a.csv", "a", None, replace(stop(1.0), **quantities)))
        (group,) = group_stops(rows)
        accused += any(x.outliers for x in group.statistics.values())
    assert 0.02 < accused / groups < 0.09


def test_an_outlier_and_a_drift_are_named() -> None:
    from scipy import stats  # slow to import

    (group,) = group_stops(series({"a": [300.0, 301.0, 299.0, 300.5, 299.5, 340.0]}))
    assert group.statistics["distance_m"].outliers == (6,)
    both = {"a": [300.0, 301.0], "b": [300.0, 301.0, 299.0, 340.0, 300.5, 299.5]}
    assert group_stops(series(both))[1].statistics["distance_m"].outliers == (6,)  # as in the table
    (group,) = group_stops(series({"a": [300.0, 302.1, 303.9, 306.0, 308.1]}))
    x = group.statistics["distance_m"]
    line = stats.linregress(range(1, 6), [300.0, 302.1, 303.9, 306.0, 308.1])
    assert x.drift == pytest.approx(line.slope)
    assert x.drift_u95 == pytest.approx(float(stats.t.ppf(0.975, 3)) * line.stderr)


def test_a_difference_has_no_error_that_both_groups_share() -> None:
    from scipy import stats  # slow to import

    old, new = [300.0, 302.0, 298.0, 300.0], [290.0, 292.0, 288.0, 290.0]
    (row,) = [
        x
        for x in differences(group_stops(series({"old": old, "new": new})), [("old", "new")])
        if x.quantity == "distance_m"
    ]
    welch = stats.ttest_ind(new, old, equal_var=False).confidence_interval(0.95)
    assert row.value == -10.0
    assert row.u95 == pytest.approx((welch.high - welch.low) / 2.0)
    assert row.distinguishable
    (same,) = [
        x
        for x in differences(group_stops(series({"old": old, "new": old})), [("old", "new")])
        if x.quantity == "distance_m"
    ]
    assert not same.distinguishable


@pytest.mark.parametrize(
    ("limit", "verdict"),
    [(330.0, "pass"), (303.0, "undecided"), (299.0, "undecided"), (290.0, "fail")],
)
def test_a_limit_is_kept_or_broken_by_the_whole_interval(limit: float, verdict: str) -> None:
    stops = series({"a": [300.0, 301.0, 299.0, 300.0]})
    groups = group_stops(stops)
    assert groups[0].statistics["distance_m"].u95 == pytest.approx(3.27, abs=0.05)
    (row,) = judge(stops, groups, [GroupLimit("distance_m", limit, None)])
    assert (row.kind, row.verdict) == ("max", verdict)
    mirrored = {"pass": "fail", "fail": "pass", "undecided": "undecided"}
    (row,) = judge(stops, groups, [GroupLimit("distance_m", None, limit)])
    assert (row.kind, row.verdict) == ("min", mirrored[verdict])


def test_each_stop_is_judged_by_its_own_interval() -> None:
    stops = series({"a": [280.0, 295.0, 300.0, 320.0], "b": [400.0]})
    (row,) = judge(stops, group_stops(stops)[:1], [GroupLimit("distance_m", 302.0, None)])
    assert (row.verdict, row.stops_pass, row.stops_fail, row.stops_undecided) == (
        "undecided", 2, 1, 1,
    )  # fmt: skip


def test_a_limit_of_a_quantity_that_no_stop_has_is_undecided() -> None:
    stops = series({"a": [300.0, 302.0]})
    groups = group_stops(stops)
    rows = judge(
        stops, groups, [GroupLimit("jerk", 4.0, 0.1), GroupLimit("distance_m", 400.0, None)]
    )
    assert [(x.kind, x.limit, x.value, x.u95, x.verdict) for x in rows[:2]] == [
        ("max", 4.0, None, None, "undecided"), ("min", 0.1, None, None, "undecided"),
    ]  # fmt: skip
    assert [x.verdict for x in rows[2:]] == ["pass"]


def test_the_extension_is_that_of_the_distance_after_the_response() -> None:
    dry, wet = [SeriesStop("d", "dry", None, stop(320.0))], []
    for slip in (0.1, 0.3):
        axle = AxleStop(1, slip, 0.5, 0.5, 7, None, 0.08, 0.02, 0.9, (0.85, 0.94))
        slid = replace(stop(420.0), response_time_s=None, axles=(axle,))
        wet.append(SeriesStop("w", "wet", None, slid))
    x = compare_wet([*dry, *wet], "dry", "wet")
    # 20 m/s for 1 s of response: 300 m dry, 400 m wet
    assert x.extension == pytest.approx(1.0 / 3.0)
    assert x.k_wet == pytest.approx(0.75)
    assert x.extension_u95 is not None
    assert x.k_wet_u95 == pytest.approx(0.75**2 * x.extension_u95)
    (axle_row,) = x.axles
    assert axle_row[:7] == (1, 0.3, 0.5, 0.5, 14, None, 0.08)
    assert axle_row.utilisation == 0.9
    assert axle_row.initial_coefficient_u95 == pytest.approx(0.02)
    assert axle_row.utilisation_ci == pytest.approx((0.85, 0.94))
    # Two stops far apart say nothing of their mean. A share is still from 0 to 1.
    unlike = [
        replace(wet[0], stop=replace(wet[0].stop, axles=(axle._replace(**used),)))
        for used in (
            {"utilisation": 0.6, "utilisation_ci": (0.55, 0.65)},
            {"utilisation": 0.9, "utilisation_ci": (0.85, 0.95)},
        )
    ]
    (axle_row,) = compare_wet([*dry, *unlike], "dry", "wet").axles
    assert axle_row.utilisation_ci == (0.0, 1.0)


def test_wet_stops_of_another_nominal_speed_have_no_extension() -> None:
    dry = SeriesStop("d", "dry", None, stop(320.0))
    other = replace(stop(420.0), nominal_speed_kmh=dry.stop.nominal_speed_kmh + 20.0)
    x = compare_wet([dry, SeriesStop("w", "wet", None, other)], "dry", "wet")
    assert x.extension is None
    assert x.k_wet is None


@pytest.mark.parametrize(("v0", "speeds"), [(21.0, None), (24.0, ([72.0], [86.4]))])
def test_groups_of_one_stated_speed_that_stop_from_others_are_named(
    v0: float, speeds: tuple[list[float], list[float]] | None
) -> None:
    dry = SeriesStop("d", "dry", None, stop(320.0))
    stops = [dry, SeriesStop("w", "wet", None, stop(420.0, v0=v0))]
    assert wet_speeds(stops, "dry", "wet") == speeds
    assert (compare_wet(stops, "dry", "wet").extension is None) == (speeds is not None)


def test_air_is_the_fall_of_the_reservoir_and_its_volume() -> None:
    wet = [
        SeriesStop("w", "wet", None, replace(stop(420.0), reservoir_drop_pa=x, sanding_s=4.0))
        for x in (1e5, 2e5)
    ]
    assert compare_wet(wet, "dry", "wet").air_nl is None
    x = compare_wet(wet, "dry", "wet", 100.0)
    assert x.air_nl == pytest.approx(150.0 / 1.0873, rel=1e-3)
    assert x.sanding_s == 4.0


def test_braked_weight_percentage_of_known_speeds_only() -> None:
    """Its interval holds that of a distance at the end of its own."""
    x = braked_weight_percentage(100.0, Measured(481.0, 10.0, 8.0))
    assert x is not None
    assert x.value == pytest.approx(61300.0 / 481.0 - 8.9)
    assert x.u95 == pytest.approx(61300.0 / 481.0 - 61300.0 / 491.0, rel=0.03)
    assert braked_weight_percentage(80.0, Measured(300.0, 10.0)) is None
