"""The main job in one process: what a result file must give back."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers import simulated

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.summarise import brake_applications, summarise
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Result, Vehicle, quantities
from adhesion_cli.results import mcap

SAMPLES = Path(__file__).resolve().parents[2] / "sample_logs"


def analysed(path: Path, **given: object) -> Result:
    return analyze(path, settings.load(None, ()), **given)  # type: ignore[arg-type]


@pytest.mark.parametrize("rate", [20.0, 100.0])
@pytest.mark.parametrize(
    ("sensor", "few"),
    [({"teeth": 2}, True), ({"teeth": 16}, True), ({"teeth": 60}, False), ({"kmh": 1.0}, False)],
)
def test_pulses_too_few_to_show_slides_are_said(
    tmp_path: Path, sensor: dict[str, Any], few: bool, rate: float
) -> None:
    log = simulated.write(
        tmp_path / "a.csv", simulated.recordings("leaf-film", rate=rate, **sensor)
    )
    told = [f.severity for f in analysed(log, algos=["td"]).findings if f.code == "few-pulses"]
    assert told == ["warning"] * few


def test_pads_that_lag_the_pressure_are_said(tmp_path: Path) -> None:
    recordings = simulated.recordings("low-adhesion", rate=100.0)
    late = [replace(r, t=r.t + 40_000_000 * ("pressure" not in r.name)) for r in recordings]
    lags = []
    for name, log in (("at once", recordings), ("late", late)):
        path = simulated.write(tmp_path / f"{name}.csv", log)
        findings = analysed(path, algos=["td"], axles=[1]).findings
        lags.append([f.values["lag_s"] for f in findings if f.code == "pads-lag"])
    assert lags == [[], [pytest.approx(0.04, abs=0.011)]]


@cache
def noisy(folder: Path, noise: str) -> Result:
    """The bundled service brake with more noise of its wheel speed.

    It is white, before a filter of 0.2 s, or thirty times stronger from the middle of the log on.
    """
    header, *rows = (SAMPLES / "service-brake.csv").read_text().splitlines()
    cells = [row.split(",") for row in rows]
    y = np.array([float(row[2]) for row in cells])
    sigma = np.full(len(y), 0.3)
    if noise == "growing":
        sigma[: len(y) // 2] = 0.01
    y += np.random.default_rng(1).normal(0.0, sigma) * (y > 1.0)
    for i in range(1, len(y) * (noise == "filtered")):
        y[i] = y[i - 1] + (1.0 - math.exp(-0.01 / 0.2)) * (y[i] - y[i - 1])
    for row, value in zip(cells, y, strict=True):
        row[2] = f"{value:.4f}"
    path = folder / f"{noise}.csv"
    path.write_text("\n".join([header, *map(",".join, cells)]) + "\n")
    return analysed(path, algos=["imm", "td"])


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("noise")


@pytest.mark.parametrize("noise", ["white", "filtered", "growing"])
def test_noise_that_a_filter_cannot_learn_contradicts_its_model(folder: Path, noise: str) -> None:
    result = noisy(folder, noise)
    findings = [f for f in result.findings if f.code == "noise-model"]
    grows = noise == "growing"
    assert [(f.severity, f.channel) for f in findings] == [("warning", "axle 1")] * grows
    (axle,) = summarise(result, {}).axles
    nis = {s.algo: s.nis for s in axle.estimators}
    assert nis["td"] is None
    assert axle.reference.nis is not None
    assert (imm := nis["imm"]) is not None
    assert imm.low < 1.0 < imm.high
    if grows:
        assert findings[0].values["nis"] == imm.mean > 1.1
        loose = analyze(
            folder / "growing.csv",
            settings.load(None, ["diagnostics.noise_model.nis=10"]),
            algos=["imm"],
        )
        assert not any(f.code == "noise-model" for f in loose.findings)


@pytest.mark.parametrize("noise", ["white", "filtered"])
def test_noise_that_imm_learns_is_in_its_band(folder: Path, noise: str) -> None:
    result = noisy(folder, noise)
    (axle,), (truth,) = result.axles, [c for c in result.log.channels if c.meaning == "truth"]
    braked = axle.applications[0]
    force = np.interp(axle.record.t[braked], truth.data.t, truth.data.value)
    error = np.abs(axle.estimates["imm"][braked] - force)
    assert np.mean(error < 1.96 * axle.sigmas["imm"][braked]) > 0.9


@pytest.mark.parametrize("pressure_every", [1, 20])
def test_a_result_read_back_gives_the_same_numbers(tmp_path: Path, pressure_every: int) -> None:
    lines = (SAMPLES / "service-brake.csv").read_text().splitlines()
    header, *rows = [line.split(",") for line in lines]
    for i, row in enumerate(rows):
        if i % pressure_every:
            row[1] = ""
    log = tmp_path / "a.csv"
    log.write_text("\n".join(",".join(r) for r in (header, *rows)) + "\n")
    first = analysed(log)
    mcap.write_results(tmp_path / "a.mcap", [first], "{}")
    second = analysed(tmp_path / "a.mcap")
    (a,), (b,) = first.axles, second.axles
    np.testing.assert_array_equal(a.record.t, b.record.t)
    for name, estimate in a.estimates.items():
        np.testing.assert_allclose(b.estimates[name], estimate, atol=1e-6)
    np.testing.assert_allclose(b.reference.force, a.reference.force, atol=1.0)
    np.testing.assert_allclose(b.reference.sigma, a.reference.sigma, rtol=0.1, atol=0.5)
    # A speed in km/h depends on the wheel radius; that it was logged so is known of the result.
    np.testing.assert_allclose(b.reference.tolerance, a.reference.tolerance, rtol=1e-6)
    assert [s.algo for s in a.scores] == [s.algo for s in b.scores]


def test_a_train_speed_that_all_inputs_hold_is_written_once(tmp_path: Path) -> None:
    log = tmp_path / "a.csv"
    rows = (SAMPLES / "low-adhesion.csv").read_text().splitlines()
    log.write_text("\n".join([rows[0], *rows[1::10]]) + "\n")  # rows with all values
    first = analysed(log, algos=["td"], axles=[1, 3])
    mcap.write_results(tmp_path / "a.mcap", [first], "{}")
    second = analysed(tmp_path / "a.mcap", algos=["td"])
    (train,) = [c for c in second.log.channels if c.meaning == "train_speed"]
    assert (train.name, train.axle) == ("/axle/1/input", None)
    assert second.shared_train() is train
    for a, b in zip(first.axles, second.axles, strict=True):
        assert a.slip is not None
        assert b.slip is not None
        np.testing.assert_allclose(b.slip, a.slip, atol=1e-12)
    # Where axles do not hold it as it was logged, it has a topic of its own.
    logged = analysed(SAMPLES / "low-adhesion.mcap", algos=["td"], axles=[1, 2])
    mcap.write_results(tmp_path / "b.mcap", [logged], "{}")
    third = analysed(tmp_path / "b.mcap", algos=["td"])
    assert [c.name for c in third.log.channels if c.meaning == "train_speed"][-1] == "/train_speed"


def cut(log: Path, column: str, begin: float, end: float = 99.0) -> Path:
    """low-adhesion.csv without the cells of a column between two times."""
    header, *lines = (SAMPLES / "low-adhesion.csv").read_text().splitlines()
    at = header.split(",").index(column)
    rows = [line.split(",") for line in lines]
    for row in rows:
        if begin <= float(row[0]) < end:
            row[at] = ""
    log.write_text("\n".join([header, *(",".join(row) for row in rows)]) + "\n")
    return log


@pytest.fixture(scope="module")
def whole() -> Result:
    """An axle that slides, and one that rolls."""
    return analysed(SAMPLES / "low-adhesion.csv", algos=["td"], axles=[1, 3])


@pytest.mark.parametrize("end", [18.0, 99.0])
def test_a_train_speed_that_is_lost_hides_slides(tmp_path: Path, end: float, whole: Result) -> None:
    log = cut(tmp_path / "a.csv", "train_speed [km/h]", 10.0, end)
    part = analysed(log, algos=["td"], axles=[1, 3])
    assert not any(f.code == "slip-unknown" for f in whole.findings)
    found = [f for f in part.findings if f.code == "slip-unknown"]
    assert {(f.channel, f.severity) for f in found} == {(f"axle {i}", "warning") for i in (1, 3)}
    braked = brake_applications(part)
    for f in found:
        begin, until = f.spans[0][0], f.spans[-1][1]
        assert begin == pytest.approx(10.0, abs=0.5)
        assert until <= end + 0.3
        (one,) = braked[int(f.channel[-1])]
        assert one.slip_unknown_s == pytest.approx(f.values["unknown_s"])
        assert one.slip_unknown_s == pytest.approx(until - begin, abs=1.0)
        assert one.to_mps is not None
        assert one.to_mps < 2.0  # of the wheel, where the train's is not known
    for (one,) in brake_applications(whole).values():
        assert one.slip_unknown_s < 0.5


@pytest.mark.parametrize(("begin", "severity"), [(12.0, "warning"), (33.5, None)])
def test_a_wheel_speed_that_ends_while_braked_is_reported(
    tmp_path: Path, begin: float, severity: str | None
) -> None:
    log = cut(tmp_path / "a.csv", "wheel_speed_3 [km/h]", begin)
    result = analysed(log, algos=["td"], axles=[3])
    found = [f for f in result.findings if f.code == "no-wheel-speed"]
    if begin < 20.0:
        (f,) = found
        assert (f.channel, f.severity) == ("wheel_speed_3 [km/h]", severity)
        assert f.spans[0][0] == pytest.approx(begin + 1.0, abs=0.2)
        assert f.spans[-1][1] > 30.0
    else:  # the wheel stands
        assert all(f.severity == "info" for f in found)


def test_a_sensor_that_reads_zero_below_its_lowest_speed_spoils_no_score(tmp_path: Path) -> None:
    """Tachometers do; the step to zero is no deceleration of 30 m/s²."""
    lines = (SAMPLES / "service-brake.csv").read_text().splitlines()
    header, *rows = [line.split(",") for line in lines]
    noise = np.random.default_rng(1).normal(0.0, 0.1, len(rows))  # about the lowest speed
    for row, n in zip(rows, noise, strict=True):
        if float(row[2]) + n < 2.0:
            row[2] = "0"
    (tmp_path / "a.csv").write_text("\n".join(",".join(r) for r in (header, *rows)) + "\n")
    one, other = (
        analysed(log, algos=["imm", "td"]).axles[0]
        for log in (SAMPLES / "service-brake.csv", tmp_path / "a.csv")
    )
    whole, cut = ({s.algo: s for s in a.scores} for a in (one, other))
    for algo in ("imm", "td"):
        assert cut[algo].rmse_n == pytest.approx(whole[algo].rmse_n, rel=0.5)
    assert np.nanmax(other.reference.force) < 1.1 * np.nanmax(one.reference.force)


def test_unknown_names_are_refused() -> None:
    with pytest.raises(UserError, match="algorithm 'nesso'"):
        analysed(SAMPLES / "service-brake.csv", algos=["nesso"])
    with pytest.raises(UserError, match="no axle 9"):
        analysed(SAMPLES / "service-brake.csv", axles=[9])


def test_a_comparison_of_one_log_is_a_log_and_one_of_several_is_not(tmp_path: Path) -> None:
    one = analysed(SAMPLES / "service-brake.csv", algos=["neso"])
    mcap.write_results(tmp_path / "one.mcap", [one], "{}")
    again = analysed(tmp_path / "one.mcap", algos=["neso"])
    assert again.axles[0].scores[0].rmse_n == pytest.approx(one.axles[0].scores[0].rmse_n)
    mcap.write_results(tmp_path / "two.mcap", [one, one], "{}")
    with pytest.raises(UserError, match="a comparison of several logs"):
        analysed(tmp_path / "two.mcap")


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Every tenth row of the bundled service brake."""
    head, *rows = (SAMPLES / "service-brake.csv").read_text().splitlines()
    path = tmp_path_factory.mktemp("coarse") / "log.csv"
    path.write_text("\n".join([head, *rows[::10], ""]))
    return path


def test_what_of_the_vehicle_nobody_stated_is_told_with_its_value(coarse: Path) -> None:
    def told(*stated: str) -> list[tuple[str, str]]:
        result = analyze(coarse, settings.load(None, stated), algos=["td"])
        found = [f for f in result.findings if f.code == "vehicle-default"]
        return [(f.severity, f.names["parameters"]) for f in found]

    ((severity, text),) = told()
    assert severity == "warning"
    assert "axle_mass 4797 kg" in text
    assert "lever_ratio 1," in text
    ((_, text),) = told("vehicle.axle_mass=5200", "vehicle.phi=0.31")
    assert "axle_mass" not in text
    assert "friction" not in text
    assert "wheel_radius 0.42 m" in text
    names = quantities(Vehicle)
    assert not told(
        *(
            f"vehicle.{n}={getattr(Vehicle(), n).value}"  # also where it is the default's
            for n in names
            if n != "wheel_radius"
        ),
        "vehicle.wheel_radius=[0.43]",
    )


def test_of_the_vehicle_few_defaults_are_named_in_the_line_and_all_are_counted(
    coarse: Path,
) -> None:
    every = {k: getattr(Vehicle(), k).value for k in quantities(Vehicle) if k != "wheel_radius"}
    stated = [f"vehicle.{k}={v}" for k, v in every.items() if not k.startswith("friction_")]

    def told(left_out: int) -> Finding:
        result = analyze(coarse, settings.load(None, stated[left_out:]), algos=["td"])
        (found,) = [f for f in result.findings if f.code == "vehicle-default"]
        assert found.values == {"defaults": left_out + 1, "of": len(stated) + 1}
        assert found.count == left_out + 1
        assert len(found.message) <= 100
        return found

    assert "wheel_radius 0.42 m" in told(0).message
    assert all(name in told(2).message for name in ("wheel_radius", *list(every)[:2]))
    three = told(3)
    assert "wheel_radius" not in three.message
    assert "wheel_radius 0.42 m" in (three.hint or "")
