"""Stops of an analysed log: the adhesion and the energy of their slides, against truth."""

import shlex
from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.errors import UserError

SAMPLES = Path(__file__).parents[2] / "sample_logs"


def test_command_valves_and_sanding_of_a_log_are_read(tmp_path: Path) -> None:
    """They need no unit."""
    head, *lines = (SAMPLES / "low-adhesion.csv").read_text().splitlines()
    rows = [f"{head},brake command,vent valve axle 1,sanding"]
    for line in lines:
        t = float(line.split(",")[0])
        command, opened, sand = t >= 2.0, t >= 10.0 and t % 2.0 < 0.5, 10.0 <= t < 15.0
        rows.append(f"{line},{command:d},{opened:d},{sand:d}")
    log = tmp_path / "states.csv"
    log.write_text("\n".join(rows) + "\n")
    stated = settings.load(None, ["analysis.vehicle=stated"])
    (stop,) = summarise(analyze(log, stated, ["td"], axles=[1, 3]), {}).stops
    assert stop.command_from == "channel"
    assert stop.start_s == pytest.approx(2.0, abs=0.05)
    assert stop.sanding_s == pytest.approx(5.0, abs=0.05)
    first, second = stop.axles
    assert (first.valves_from, second.valves_from) == ("valves", "pressure")
    assert first.vented_s == pytest.approx(0.5 * first.valve_actions, rel=0.1)


def test_a_valve_of_an_unknown_kind_is_reported_with_a_setting_that_works(tmp_path: Path) -> None:
    head, *lines = (SAMPLES / "low-adhesion.csv").read_text().splitlines()
    opened = [float(line.split(",")[0]) % 2.0 < 0.5 for line in lines]
    columns = [f"{line},{x:d},20" for line, x in zip(lines, opened, strict=True)]
    log = tmp_path / "valves.csv"
    log.write_text("\n".join([f"{head},Ventil 2,Ventil Temperatur [°C]", *columns, ""]))
    result = analyze(log, settings.load(folder=False), ["td"], axles=[3])
    (finding,) = [f for f in result.findings if f.code == "valve-unclear"]
    assert (finding.severity, finding.channel) == ("info", "Ventil 2")
    _, setting = shlex.split(finding.names["setting"].strip("`"))
    again = analyze(log, settings.load(None, [setting], folder=False), ["td"], axles=[2])
    assert "valve-unclear" not in {f.code for f in again.findings}
    (stop,) = summarise(again, {}).stops
    assert stop.axles[0].valves_from == "valves"


def test_the_setting_of_a_valve_without_a_number_states_no_axle(tmp_path: Path) -> None:
    head, *lines = (SAMPLES / "low-adhesion.csv").read_text().splitlines()
    log = tmp_path / "valves.csv"
    log.write_text("\n".join([f"{head},Ventil", *(f"{line},1" for line in lines), ""]))
    result = analyze(log, settings.load(folder=False), ["td"], axles=[3])
    (finding,) = [f for f in result.findings if f.code == "valve-unclear"]
    _, setting = shlex.split(finding.names["setting"].strip("`"))
    with pytest.raises(UserError, match="is no axle and no bogie"):
        settings.load(None, [setting], folder=False)


@pytest.mark.parametrize("axles", [[1], [1, 2, 3, 4]])
def test_a_stop_whose_pressure_has_outliers_is_measured_by_its_speed(
    axles: list[int], tmp_path: Path
) -> None:
    """2 s of a broken pressure sensor leave speed and distance as they are."""
    sample = SAMPLES / "low-adhesion.csv"
    head, *lines = sample.read_text(encoding="utf-8").splitlines()
    table = np.array([line.split(",") for line in lines])
    t = table[:, 0].astype(float)
    for axle in axles:
        table[(t > 14.0) & (t < 16.0), axle] = "9.90"
    log = tmp_path / "broken.csv"
    log.write_text("\n".join([head, *map(",".join, table.tolist()), ""]), encoding="utf-8")
    stated = settings.load(None, ["analysis.vehicle=stated"], folder=False)
    (whole,), (broken,) = (
        summarise(result, {}).stops
        for result in (analyze(path, stated, ["td"]) for path in (sample, log))
    )
    assert broken.valid
    assert whole.distance_m is not None
    assert broken.distance_m is not None
    assert broken.distance_m.value == pytest.approx(whole.distance_m.value, rel=1e-3)
    assert broken.coefficient is not None
