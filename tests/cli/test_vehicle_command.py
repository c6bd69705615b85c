"""`adhesion vehicle`: presets, and the figures of a stated vehicle."""

import json
import math
import re
from pathlib import Path

import pytest
from helpers.unlike_train import TRAIN

from adhesion_cli.analysis.vehicle_presets import names
from adhesion_cli.cli.app import app
from adhesion_cli.core import toml
from adhesion_cli.core.errors import UserError


def run(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    app(["vehicle", *arguments], standalone_mode=False)
    return capsys.readouterr().out


def test_a_preset_gives_the_figures_to_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "my-train.toml"
    file.write_text(run(capsys, "Coach"), encoding="utf-8")
    shown = run(capsys, "-c", str(file))
    document = json.loads(run(capsys, "-c", str(file), "--json"))
    force = document["force_per_bar_n"]
    match = re.search(r"at the rail, per axle +([\d.]+) ± ([\d.]+) kN/bar", shown)
    assert match is not None
    assert [float(x) for x in match.groups()] == pytest.approx(
        [force["value"] / 1e3, force["u95"] / 1e3], abs=0.006
    )
    pad = re.search(r"one pad or block +([\d.]+)", shown)
    assert pad is not None
    assert float(pad[1]) == pytest.approx(2.2 * 0.95 * 0.0323655 * 1e2, abs=0.01)  # i η A p


def test_without_a_vehicle_the_presets_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    shown = run(capsys)
    assert all(f"  {name} " in shown for name in names())


def test_an_unknown_preset_names_the_nearest(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(UserError, match="unknown vehicle 'metroo'") as error:
        run(capsys, "metroo")
    assert "did you mean 'metro'" in error.value.hint
    with pytest.raises(UserError, match="no other option"):
        run(capsys, "metro", "--json")


def test_each_car_has_its_figures(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "train.toml"
    file.write_text(
        "\n".join(f"{key} = {toml.value(table)}" for key, table in TRAIN.items()), encoding="utf-8"
    )
    shown = run(capsys, "-c", str(file))
    assert "car motor, axles 1, 2:" in shown
    cars = json.loads(run(capsys, "-c", str(file), "--json"))["cars"]
    assert [car["axles"] for car in cars] == [[1, 2], [3, 4, 5]]
    area, spring = math.pi * 0.203**2 / 4.0, 1e3
    tread = 0.25 * 8.5 * 0.83 * area * 1e5
    assert cars[1]["force_per_bar_n"]["value"] == pytest.approx(tread)
    assert cars[1]["deceleration_per_bar"]["value"] == pytest.approx(tread / 12000 / 1.05)
    begins = re.findall(r"the brake begins +([\d.]+) bar", shown)
    assert float(begins[1]) == pytest.approx(spring / area / 1e5, abs=0.01)
    document = json.loads(run(capsys, "--set", "vehicle.axle_mass=[9000,12000]", "--json"))
    assert [car["axles"] for car in document["cars"]] == [[1], [2]]
