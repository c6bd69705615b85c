"""Cars and lists per axle: what they state, what is refused, and a train of unlike cars."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import unlike_train
from helpers.commands import Run
from helpers.unlike_train import TRAIN

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core import toml
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.studies.calibrate import as_tables, calibrate


def load(*layers: dict[str, Any]) -> settings.Settings:
    return settings.load(list(layers), folder=False)


def of_axles(vehicle: Vehicle, name: str, *numbers: int) -> list[float]:
    return [getattr(vehicle.of_axle(n), name).value for n in numbers]


def test_a_car_has_its_own_values_and_those_of_the_vehicle() -> None:
    vehicle = load(TRAIN).vehicle
    assert of_axles(vehicle, "friction", 1, 2, 3) == [0.35, 0.35, 0.25]
    assert [vehicle.radius(n).value for n in (2, 5)] == [0.42, 0.46]
    assert vehicle.of_axle(3).wheelset_inertia.value == pytest.approx(0.05 * 12000 * 0.46**2)
    assert of_axles(vehicle, "discs", 1, 4) == [4.0, 1.0]


def test_lists_have_a_value_for_each_axle() -> None:
    vehicle = load(
        {"axle_mass": [9000, 9500], "wheelset_inertia": [110, 90], "friction": 0.3}
    ).vehicle
    assert of_axles(vehicle, "axle_mass", 1, 2) == [9000, 9500]
    assert of_axles(vehicle, "wheelset_inertia", 1, 2) == [110, 90]
    car = {"a": {"axles": [3, 1], "axle_mass": [7000, 8000]}, "b": {"axles": [2]}}
    vehicle = load({"wheel_diameter": [0.80, 0.82, 0.84], "car": car}).vehicle
    assert of_axles(vehicle, "axle_mass", 1, 3) == [8000, 7000]
    assert [vehicle.radius(n).value for n in (1, 2, 3)] == [0.40, 0.41, 0.42]


def test_a_later_statement_of_the_vehicle_holds_for_every_car() -> None:
    heavier = load(TRAIN, {"axle_mass": 20000}).vehicle
    assert of_axles(heavier, "axle_mass", 1, 5) == [20000, 20000]
    other_discs = load(TRAIN, {"car": {"motor": {"disc_brake": {"discs": 3}}}}).vehicle
    assert of_axles(other_discs, "discs", 1, 3) == [6.0, 1.0]
    other_cars = load(TRAIN, {"car": {"all": {"axles": [1, 2, 3, 4, 5]}}}).vehicle
    assert {a.car for a in other_cars.axles} == {"all"}


@pytest.mark.parametrize(
    ("stated", "error", "hint"),
    [
        ({"car": {"a": {"axles": [1, 2]}, "b": {"axles": [2]}}}, "2 is in [car.a] and", "one of"),
        ({"car": {"a": {"friction": 0.3}}}, "car.a.axles", "axles = [1, 2"),
        ({"car": {"a": {"axles": [0]}}}, "car.a.axles", "axles = [1, 2"),
        ({"car": {"a": {"axles": [1, 1]}}}, "axle 1 is twice", ""),
        ({"car": {"a": {"axles": [1, 2, 3], "axle_mass": [1e4, 1e4]}}}, "the car has 3", "3"),
        ({"axle_mass": [1e4, 9e3], "car": {"a": {"axles": [3]}}}, "axle_mass has 2", "a list"),
        ({"axle_mass": [1e4, 9e3], "efficiency": [0.9, 0.9, 0.8]}, "axle_mass has 2 values", "3"),
        ({"car": {"a": {"axles": [1], "brake": 1}}}, "unknown vehicle parameter", ""),
        ({"car": {"a": {"axles": [1], "disc_brake": {"discs": 2}}}}, "[car.a]: ", "vehicle"),
    ],
)
def test_what_contradicts_itself_is_refused(stated: dict[str, Any], error: str, hint: str) -> None:
    with pytest.raises(UserError) as refused:
        load(stated)
    assert error in str(refused.value)
    assert hint in str(refused.value.hint)
    assert refused.value.code == 2


def test_an_axle_in_no_car_is_named() -> None:
    with pytest.raises(UserError, match=r"axle 6 of the log is in no car") as refused:
        load(TRAIN).vehicle.of_axle(6)
    assert "[car.trailer]" in str(refused.value.hint)
    with pytest.raises(UserError, match="lists for 2 axles, the log has an axle 3"):
        load({"axle_mass": [9000, 9500]}).vehicle.of_axle(3)


@pytest.mark.parametrize("stated", [TRAIN, {"axle_mass": [9000, 9500], "wheel_diameter": 0.9}])
def test_a_result_carries_every_axle(stated: dict[str, Any]) -> None:
    checked = load(stated)
    carried = settings.tree(checked, [])
    again = settings.Settings().over(carried)
    assert again.vehicle == checked.vehicle
    assert load({"friction": 0.2}).over(carried).vehicle.of_axle(1).friction.value == 0.2


@pytest.mark.parametrize("use", ["stated", "log"])
def test_unlike_cars_have_their_own_coefficient(tmp_path: Path, use: str) -> None:
    checked = load(TRAIN, {"analysis": {"vehicle": use}})
    truth = unlike_train.write(tmp_path / "train.csv", checked.vehicle, range(1, 6))
    result = analyze(tmp_path / "train.csv", checked, ["td"], train_speed=True)
    for axle in summarise(result, {}).axles:
        for a in axle.applications:
            inside = slice(round(a.start_s / 0.05), round(a.end_s / 0.05) + 1)
            assert a.coefficient is not None
            mean = float(np.mean(truth[axle.axle][inside]))
            assert a.coefficient.mean == pytest.approx(mean, rel=0.01)
    assert not [f for f in result.findings if f.severity == "warning"]


def test_the_log_moves_all_axles_alike(tmp_path: Path) -> None:
    stronger = load(TRAIN, {"car": {"motor": {"friction": 0.37}, "trailer": {"friction": 0.2643}}})
    unlike_train.write(tmp_path / "train.csv", stronger.vehicle, range(1, 6))
    result = analyze(tmp_path / "train.csv", load(TRAIN), ["td"])
    used, stated = result.identified.force_per_bar, result.identified.stated_force_per_bar
    assert used is not None
    assert stated is not None
    assert 1.02 < used.value / stated.value < 1.07
    share = [
        result.vehicle.of_axle(n).friction.value / load(TRAIN).vehicle.of_axle(n).friction.value
        for n in (1, 4)
    ]
    assert share[0] == pytest.approx(share[1], rel=1e-3)


def test_calibrate_writes_the_cars(tmp_path: Path) -> None:
    unlike_train.write(tmp_path / "train.csv", load(TRAIN).vehicle, range(1, 6))
    run = calibrate([tmp_path / "train.csv"], load(TRAIN))
    again = load(as_tables(run))
    assert again.vehicle.of_axle(4).axle_mass == pytest.approx(
        run.settings.vehicle.of_axle(4).axle_mass
    )
    assert again.vehicle.of_axle(1).discs.tolerance == 0.0


def test_every_screen_and_file_takes_a_train_of_cars(tmp_path: Path, run: Run) -> None:
    unlike_train.write(tmp_path / "train.csv", load(TRAIN).vehicle, range(1, 6))
    lines = [f"{key} = {toml.value(table)}" for key, table in TRAIN.items()]
    (tmp_path / "train.toml").write_text("\n".join(lines))
    for command in (
        ["analyze", "train.csv", "-a", "td", "--axle", "2", "--axle", "3", "-c", "train.toml"],
        ["report", "train.adhesion.mcap", "-o", "page.html"],
        ["analyze", "train.adhesion.mcap", "-a", "td", "-o", "again"],
        ["calibrate", "train.csv", "-c", "train.toml", "-o", "calibrated.toml"],
        ["vehicle", "-c", "calibrated.toml"],
    ):
        answer = run(*command)
        assert answer.returncode == 0, answer.stderr
        if command[0] == "analyze":
            assert "Car motor: " in answer.stdout
    assert "Car trailer: " in run("inspect", "train.csv", "-c", "train.toml").stdout


def test_cars_have_their_own_friction_tables(tmp_path: Path) -> None:
    falling = {"speed": [0, 40], "value": [0.32, 0.22], "tolerance": 0.1}
    checked = load(TRAIN, {"car": {"trailer": {"friction": falling}}})
    vehicle = checked.vehicle
    assert vehicle.of_axle(4).friction_table is not None
    assert vehicle.of_axle(1).friction_table is None
    truth = unlike_train.write(tmp_path / "train.csv", vehicle, range(1, 6))
    result = analyze(tmp_path / "train.csv", checked, ["td"])
    for axle in summarise(result, {}).axles:
        for a in axle.applications:
            inside = slice(round(a.start_s / 0.05), round(a.end_s / 0.05) + 1)
            assert a.coefficient is not None
            mean = float(np.mean(truth[axle.axle][inside]))
            assert a.coefficient.mean == pytest.approx(mean, rel=0.015)
    again = settings.Settings().over(settings.tree(checked, []))
    assert again.vehicle.of_axle(4).friction_table == vehicle.of_axle(4).friction_table


def test_axles_need_not_begin_with_the_first(tmp_path: Path) -> None:
    places = {"motor": {"axles": [3, 4]}, "trailer": {"axles": [5, 6, 7]}}
    checked = load(TRAIN, {"car": places, "track": {"gradient": 0.0}})
    truth = unlike_train.write(tmp_path / "train.csv", checked.vehicle, range(3, 8))
    result = analyze(tmp_path / "train.csv", checked, ["td"], train_speed=True)
    assert [a.record.axle for a in result.axles] == [3, 4, 5, 6, 7]
    first = summarise(result, {}).axles[0].applications[0].coefficient
    assert first is not None
    assert first.mean == pytest.approx(float(np.mean(truth[3][125:530])), rel=0.02)


def test_equal_cars_are_a_train_without_cars(tmp_path: Path) -> None:
    car = {k: v for k, v in TRAIN["car"]["motor"].items() if k != "axles"}
    car |= {"friction": {"speed": [0, 60], "value": [0.37, 0.30], "tolerance": 0.1}}
    layers = [{"vehicle": {"wheel_diameter": 0.84}}, {"vehicle": car}]
    alone, in_cars = (
        load(*layers),
        load(*layers, {"car": {"a": {"axles": [1]}, "b": {"axles": [2]}}}),
    )
    stronger = load(*layers, {"friction": 0.35})
    unlike_train.write(tmp_path / "train.csv", stronger.vehicle, [1, 2])
    results = [analyze(tmp_path / "train.csv", x, ["td"]) for x in (alone, in_cars)]
    assert results[0].brake is not None
    assert results[0].brake == results[1].brake
    assert np.array_equal(*(r.axles[1].reference.force for r in results), equal_nan=True)
