"""`[track]`: the gradient of the line, and what it does to a stop on a slope."""

from pathlib import Path
from typing import Any

import pytest
from helpers.vehicle_logs import blended_log, log, true

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.inspection import inspect
from adhesion_cli.analysis.prepare import Window
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Parameter, Result
from adhesion_cli.studies.calibrate import calibrate

STATEMENT = {"friction": 0.3, "lever_ratio": 2.4}


def track(gradient: Any) -> settings.Settings:
    return settings.load({"track": {"gradient": gradient}}, folder=False)


def test_the_unit_is_per_mille() -> None:
    assert track(5.0).track.gradient == Parameter(0.005, 0.0005)
    assert track({"value": -12, "tolerance": 2}).track.gradient == Parameter(-0.012, 0.002)
    assert not settings.load({}, folder=False).track.stated


def test_what_a_result_carries_loads_back() -> None:
    stated = track({"value": -12.5, "tolerance": 2})
    again = settings.load(folder=False).over(settings.tree(stated, []))
    assert again.track.gradient.value == pytest.approx(-0.0125)
    assert again.track.stated
    assert not settings.load(folder=False).over(settings.tree(track(None), [])).track.stated
    along = settings.tree(track({"profile": [[0.0, 0.0], [1.5, -12.5]]}), [])
    assert settings.load({"track": along["track"]}, folder=False).track.profile
    assert not settings.load(folder=False).over(along).track.profile  # the log had the position


def test_each_log_has_the_gradient_of_the_first_pattern_that_fits_its_name(tmp_path: Path) -> None:
    stated = track({"logs": {"*_out*": {"value": 8.0, "tolerance": 1.0}, "*_back*": -8.0}})
    paths = [log(tmp_path / f"{name}.csv", true(), 1, 2) for name in ("1_out", "2_back", "3")]
    results = [analyze(path, stated, ["td"]) for path in paths]
    out, back = Parameter(0.008, 0.001), Parameter(-0.008, 0.0005)
    assert [x.track.gradient for x in results[:2]] == [out, back]
    assert [x.track.stated for x in results] == [True, True, False]
    noted = ["gradient-not-stated" in {f.code for f in x.findings} for x in results]
    assert noted == [False, False, True]
    inspected = [inspect(path, stated) for path in paths]
    assert ["gradient-not-stated" in {f.code for f in x.findings} for x in inspected] == noted


@pytest.mark.parametrize(
    "text",
    [
        "km;gradient\n0,0;0\n1,5;-12,5\n",
        "0.0,0\n1.5,-12.5\n",
        "distance [m],gradient [permille]\n0,0\n1500,-12.5\n",
    ],
)
def test_a_profile_is_a_table_of_km_and_per_mille(text: str, tmp_path: Path) -> None:
    file = tmp_path / "line.csv"
    file.write_text(text, encoding="utf-8")
    stated = track({"profile": str(file), "position": "km"}).track
    assert stated.profile == ((0.0, 0.0), (1500.0, -0.0125))
    assert stated.position == "km"


@pytest.mark.parametrize(
    ("gradient", "says"),
    [
        ("steep", "track.gradient"),
        ({"logs": {"*_out*": "steep"}}, r"track.gradient.logs.\*_out\*"),
        ({"logs": 5.0}, "track.gradient.logs"),
        ({"logs": {"*": 1.0}, "value": 2.0}, "value"),
        (500.0, "out of range"),
        ({"profile": "missing.csv"}, "missing.csv cannot be read"),
        ({"profile": "falls.csv"}, "line 3: km 0.5 does not rise"),
        ({"profile": "words.csv"}, "line 2: no km and gradient"),
        ({"profile": "empty.csv"}, "no gradient"),
        ({"profile": 3}, "are names"),
        ({"profile": [[0.0, 5.0], [1.0]]}, "row 2: no km and gradient"),
        ({"profile": "falls.csv", "place": "km"}, "place"),
    ],
)
def test_bad_input_names_the_place(gradient: Any, says: str, tmp_path: Path) -> None:
    for name, rows in (("falls", "0,1\n1,2\n0.5,3\n"), ("words", "a,b\nx,y\n"), ("empty", "")):
        (tmp_path / f"{name}.csv").write_text(rows, encoding="utf-8")
    if isinstance(gradient, dict) and isinstance(gradient.get("profile"), str):
        gradient = {**gradient, "profile": str(tmp_path / gradient["profile"])}
    with pytest.raises(UserError, match=says) as error:
        track(gradient)
    assert error.value.hint


@pytest.fixture(scope="module")
def slope_log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Stops of the stated vehicle on 15 per mille uphill."""
    return log(tmp_path_factory.mktemp("slope") / "up.csv", true(), gradient=0.015)


def run(path: Path, window: Window = (None, None), **sections: Any) -> Result:
    stated = settings.load({"vehicle": STATEMENT, **sections}, folder=False)
    return analyze(path, stated, ["td"], window=window)


def test_a_stated_gradient_is_no_brake_force(slope_log: Path) -> None:
    def force(gradient: float | None) -> float:
        track = {} if gradient is None else {"track": {"gradient": gradient}}
        used = run(slope_log, steady_brake, **track).identified.force_per_bar
        assert used is not None
        return used.value

    steady_brake = (9.0, 19.0)  # coasting and build-up would show the slope
    stated = run(slope_log).identified.stated_force_per_bar
    assert stated is not None
    error = abs(force(15) / stated.value - 1.0)
    assert error < 0.06
    assert error < abs(force(None) / stated.value - 1.0)
    assert force(-15) > 1.04 * force(15)


def test_the_mean_gradient_of_a_stop_is_in_its_level_track(tmp_path: Path) -> None:
    path = blended_log(tmp_path / "stop.csv")  # a stop from 22 m/s with 0.75 m/s²
    (stop,), (unknown,) = (
        summarise(run(path, track={"gradient": g}), {}).stops
        for g in (15, {"value": 0, "tolerance": 3})
    )
    assert stop.corrected_distance_m is not None
    assert unknown.corrected_distance_m is not None
    assert stop.corrected_distance_m.value > 1.15 * unknown.corrected_distance_m.value
    assert stop.corrected_distance_m.u95 < unknown.corrected_distance_m.u95


def test_calibrate_takes_the_gradient(slope_log: Path) -> None:
    stated = settings.load(
        {"vehicle": STATEMENT, "track": {"gradient": 15}, "train": {"alike": 0}}, folder=False
    )
    row = calibrate([slope_log], stated).result.rows["force_over_mass"]
    assert row.posterior == pytest.approx(1.0, abs=0.03)


def test_a_profile_without_a_position_is_said(slope_log: Path, tmp_path: Path) -> None:
    file = tmp_path / "line.csv"
    file.write_text("km,gradient\n0,15\n", encoding="utf-8")
    result = run(slope_log, track={"gradient": {"profile": str(file)}})
    assert "no-position" in {f.code for f in result.findings}
