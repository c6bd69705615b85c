"""A log file as channels: counters, wheels, optional channels."""

import math
from pathlib import Path

import numpy as np
import pytest
from helpers.pasted import pasted

from adhesion_cli.analysis.settings import load
from adhesion_cli.channels.log import read, survey, unchanged
from adhesion_cli.channels.meaning import Mapping
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Channel, Log, Parameter, Vehicle
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

COUNTER = (Mapping("wheel_speed", 1, "wheel", unit="count", teeth=100),)


def logged(path: Path, counts: np.ndarray, t: np.ndarray) -> Log:
    lines = ["t [s],bc pressure [bar],wheel"]
    lines += [f"{x:.3f},{3.0 * min(x, 1.0):.3f},{int(c)}" for x, c in zip(t, counts, strict=True)]
    path.write_text("\n".join(lines) + "\n")
    return read(open_source(path, ReadOptions()), COUNTER, Vehicle())


def speed_of(log: Log) -> Channel:
    return next(c for c in log.channels if c.meaning == "wheel_speed")


def codes(log: Log) -> dict[str, int]:
    return {f.code: f.count for f in log.findings}


@pytest.fixture
def turning() -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(0.0, 10.0, 0.02)
    return t, np.floor(100.0 * (40.0 * t - 1.0 * t**2) / (2.0 * math.pi))


def test_a_counter_becomes_the_mean_speed_of_each_interval(
    tmp_path: Path, turning: tuple[np.ndarray, np.ndarray]
) -> None:
    t, counts = turning
    log = logged(tmp_path / "a.csv", counts % 65536, t)
    speed = speed_of(log)
    true = 40.0 - 2.0 * speed.data.t / 1e9
    step = 2.0 * math.pi / 100 / 0.02
    assert np.abs(speed.data.value - true).max() < step
    assert speed.step == pytest.approx(step)
    assert "counter-reset" not in codes(log)


def test_a_counter_that_wraps_goes_on_and_one_that_resets_does_not(
    tmp_path: Path, turning: tuple[np.ndarray, np.ndarray]
) -> None:
    t, counts = turning
    wrapped = logged(tmp_path / "a.csv", counts % 4096, t)
    went_on = next(f for f in wrapped.findings if f.code == "counter-wrapped")
    assert went_on.count == len(went_on.spans) == int(counts[-1]) // 4096
    (stated,) = load(assignments=pasted(went_on.hint or ""), folder=False).mappings
    assert (stated.channel, stated.wrap) == ("wheel", 65_536)
    counts = np.where(t > 5.0, counts - counts[251], counts)
    reset = logged(tmp_path / "b.csv", counts, t)
    fell = next(f for f in reset.findings if f.code == "counter-reset")
    assert (fell.count, fell.channel, fell.spans) == (1, "wheel", ((5.0, 5.02),))
    assert np.abs(speed_of(reset).data.value).max() < 45.0


def test_a_gap_in_a_counter_gives_no_speed_over_it(
    tmp_path: Path, turning: tuple[np.ndarray, np.ndarray]
) -> None:
    t, counts = turning
    keep = (t < 4.0) | (t > 4.16)
    log = logged(tmp_path / "a.csv", counts[keep], t[keep])
    assert codes(log)["gap"] == 1
    assert np.diff(speed_of(log).data.t).max() > 0.16e9


def test_a_radius_for_each_axle_or_one_for_all(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "t [s],bc [bar],axle1 speed [m/s],axle2 speed [m/s],axle3 speed [m/s]\n"
        + "".join(f"{i / 10},1,10,10,10\n" for i in range(50))
    )
    source = open_source(tmp_path / "a.csv", ReadOptions())
    two = Vehicle(wheel_radius=(Parameter(0.42, 0.0), Parameter(0.43, 0.0)))
    with pytest.raises(UserError, match="axle 3"):
        read(source, (), two)


def test_an_empty_channel_is_told_and_breaks_nothing(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "t [s],bc [bar],wheel speed [m/s],train speed [m/s]\n"
        + "".join(f"{i / 10},1,10,\n" for i in range(50))
    )
    source = open_source(tmp_path / "a.csv", ReadOptions())
    assert [len(c.data.t) for c in survey(source, (), Vehicle()).channels] == [50, 50, 0]
    log = read(source, (), Vehicle())
    assert {c.meaning for c in log.channels} == {"pressure", "wheel_speed"}
    assert codes(log)["empty-channel"] == 1
    copied = unchanged(open_source(tmp_path / "a.csv", ReadOptions()), ())
    assert [c.name for c in copied.channels] == ["bc [bar]", "wheel speed [m/s]"]
    assert codes(copied)["empty-channel"] == 1
    (tmp_path / "b.csv").write_text("t [s],bc [bar]\n0,\n1,\n2,\n")
    with pytest.raises(UserError, match="no channel holds a number"):
        unchanged(open_source(tmp_path / "b.csv", ReadOptions()), ())


def test_a_pressure_from_vacuum_is_suspected_and_can_be_stated(tmp_path: Path) -> None:
    lines = [f"{i / 10},{101.3 + max(i - 20, 0) * 10},10" for i in range(50)]
    (tmp_path / "a.csv").write_text("t [s],bc [kPa],wheel speed [m/s]\n" + "\n".join(lines) + "\n")
    source = open_source(tmp_path / "a.csv", ReadOptions())
    (found,) = (f for f in read(source, (), Vehicle()).findings if f.severity == "warning")
    assert (found.code, found.channel, found.names["unit"]) == (
        "pressure-absolute", "bc [kPa]", "kPa",
    )  # fmt: skip
    stated = read(source, (Mapping("pressure", None, "bc", unit="kPa abs"),), Vehicle())
    assert "pressure-absolute" not in codes(stated)
    pressure = next(c for c in stated.channels if c.meaning == "pressure")
    assert abs(pressure.data.value[0]) < 100.0


def test_a_stated_zero_is_taken_off_and_may_not_be_larger_than_every_value(tmp_path: Path) -> None:
    lines = [f"{i / 10},{10 + max(i - 20, 0) * 10},10" for i in range(50)]
    (tmp_path / "a.csv").write_text("t [s],bc [kPa],wheel speed [m/s]\n" + "\n".join(lines) + "\n")
    source = open_source(tmp_path / "a.csv", ReadOptions())

    def pressure(zero: float) -> Channel:
        mapping = Mapping("pressure", None, "", zero=Parameter(zero, 1.0))
        return read(source, (mapping,), Vehicle()).channels[0]

    assert pressure(10.0).data.value[0] == 0.0
    assert pressure(10.0).zero == Parameter(10e3, 1e3)
    with pytest.raises(UserError, match=r"zero = 500 kPa is larger than every value.* 300 kPa"):
        pressure(500.0)


def test_a_needed_name_above_two_columns_is_reported_and_can_be_mapped(tmp_path: Path) -> None:
    path = tmp_path / "log.csv"
    rows = "".join(f"{k / 50},{k % 7},{k % 5},{50 - k / 50}\n" for k in range(200))
    path.write_text("time [s],BCP 1 [bar],BCP 1 [bar],axle 1 [km/h]\n" + rows)
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    (found,) = (f for f in log.findings if f.severity == "warning")
    assert (found.code, found.channel) == ("channel-ambiguous", "BCP 1 [bar] (2)")
    second = Mapping("pressure", 1, "BCP 1 [bar] (2)", unit="bar")
    log = read(open_source(path, ReadOptions()), (second,), Vehicle())
    pressure = log.find("pressure", 1)
    assert pressure is not None
    assert pressure.data.value[:6].tolist() == [0, 1e5, 2e5, 3e5, 4e5, 0]


def table(path: Path, stamps: np.ndarray, channels: int) -> Path:
    names = [f"bc pressure {k} [bar],wheel {k} [rad/s]" for k in range(1, channels + 1)]
    rows = [f"{t:g}{f',{k % 5},{90 - k / 8}' * channels}" for k, t in enumerate(stamps)]
    path.write_text("\n".join([",".join(["t [s]", *names]), *rows]) + "\n")
    return path


def test_a_fault_of_one_clock_is_told_once(tmp_path: Path) -> None:
    t = np.arange(100) / 10
    path = table(tmp_path / "a.csv", np.where(t < 5.0, t, t + 60.0), 4)
    log = survey(open_source(path, ReadOptions()), (), Vehicle())
    (gap,) = (f for f in log.findings if f.severity != "info")
    assert (gap.code, gap.count, gap.spans) == ("gap", 1, ((4.9, 65.0),))
    assert gap.values == {"longest_s": pytest.approx(60.1), "limit_s": 61.0}
    assert "--set analysis.max_gap=61`" in (gap.hint or "")
    assert gap.channel == ", ".join(c.title for c in log.channels)


def test_stamps_too_coarse_are_named_where_nothing_is_left(tmp_path: Path) -> None:
    sizes = np.random.default_rng(0).integers(4, 12, 30)
    path = table(tmp_path / "a.csv", np.repeat(np.arange(30.0), sizes), 1)
    (coarse,) = survey(open_source(path, ReadOptions()), (), Vehicle()).findings[-1:]
    assert (coarse.code, coarse.values["apart_s"]) == ("time-coarse", 1.0)
    with pytest.raises(UserError, match="no usable sample"):
        read(open_source(path, ReadOptions()), (), Vehicle())


@pytest.mark.parametrize("row", ["BC pressure axle 1 [kPa]\ns,bar", "BC [kPa] axle 1 [bar]\n,"])
def test_a_unit_stated_twice_is_refused_unless_mapped(tmp_path: Path, row: str) -> None:
    path = tmp_path / "a.csv"
    names, units = row.split("\n")
    rows = "".join(f"{k / 100},{k / 10},{k}\n" for k in range(200))
    path.write_text(f"t [s],{names},axle 1 speed [rpm]\n{units},rpm\n{rows}")
    for of in (lambda s, m: read(s, m, Vehicle()), unchanged):
        with pytest.raises(UserError, match=r"(?m)stated twice: 'bar' .* and 'kPa' .in the name.$"):
            of(open_source(path, ReadOptions()), ())
    mapping = Mapping("pressure", 1, names, unit="kPa")
    log = read(open_source(path, ReadOptions()), (mapping,), Vehicle())
    pressure = log.find("pressure", 1)
    assert pressure is not None
    assert pressure.data.value.max() == pytest.approx(19.9e3)


def test_what_cannot_be_used_without_its_unit_is_left_out_if_it_is_not_needed(
    tmp_path: Path,
) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{k / 10},1,{50 - k},{60 - k}\n" for k in range(40))
    path.write_text("t [s],bc [bar],wheel speed [m/s],train speed [foo]\n" + rows)
    log = read(open_source(path, ReadOptions()), (), Vehicle())
    (left_out,) = (f for f in log.findings if f.severity == "warning")
    assert (left_out.code, left_out.channel) == ("unit-unknown", "train speed [foo]")
    assert left_out.names["meaning"] == "train speed"
    assert "foo" in left_out.names["reason"]


def test_every_message_of_the_findings_here_can_be_written(tmp_path: Path) -> None:
    t = np.r_[0:200, 300:400, 350:500] / 50
    path = table(tmp_path / "a.csv", t, 2)
    for f in survey(open_source(path, ReadOptions()), (), Vehicle()).findings:
        assert f.message


def test_all_units_that_lack_are_asked_for_at_once(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{k / 100},{k / 10},{200 - k},{200 - k}\n" for k in range(200))
    path.write_text(f"t [s],BC pressure,axle 1 speed,axle 2 speed\n{rows}")
    with pytest.raises(UserError, match=r"'BC pressure'.*'axle 1 speed'") as error:
        read(open_source(path, ReadOptions()), (), Vehicle())
    settings = load(assignments=pasted(error.value.hint))
    log = read(open_source(path, ReadOptions()), settings.mappings, Vehicle())
    assert [c.unit for c in log.channels] == ["bar", "km/h", "km/h"]
    by_number = load(
        assignments=[
            "channels.pressure.channel=column 2",
            "channels.pressure.unit=bar",
            "channels.speed.unit=km/h",
        ]
    )
    log = read(open_source(path, ReadOptions()), by_number.mappings, Vehicle())
    assert log.channels[0].name == "BC pressure"


@pytest.mark.parametrize(
    ("names", "line"),
    [
        ("bc_press[0],bc_press[1]", 'channels.pressure = {unit = "bar"}'),
        (
            "BC 1 [kPa],BC pressure 2",
            'channels.pressure = {"axle 1" = {channel = "BC 1 [kPa]", unit = "kPa"}, '
            '"axle 2" = {channel = "BC pressure 2", unit = "bar"}}',
        ),
    ],
)
def test_the_hint_on_a_missing_unit_can_be_given_as_it_stands(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, names: str, line: str
) -> None:
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "a.csv"
    rows = "".join(f"{k / 100},{k / 10},{k / 10},{200 - k},{200 - k}\n" for k in range(200))
    path.write_text(f"t [s],{names},axle 1 [km/h],axle 2 [km/h]\n{rows}")
    with pytest.raises(UserError, match="its unit is not stated") as error:
        read(open_source(path, ReadOptions()), (), Vehicle())
    stated = pasted(error.value.hint)
    assert load(assignments=stated) == load(assignments=[line])
    Path("c.toml").write_text(line)
    for settings in (load(assignments=stated), load(Path("c.toml"))):
        log = read(open_source(path, ReadOptions()), settings.mappings, Vehicle())
        assert [c.axle for c in log.channels if c.meaning == "pressure"] == [1, 2]


def test_a_copy_says_what_it_lacks_and_what_it_assumes(tmp_path: Path) -> None:
    rows = "".join(f"24.11.2026 10:15:0{k},2\n" for k in range(9))
    (tmp_path / "a.csv").write_text(f"Train;A7\nRoute;north\ntime,p [bar]\n{rows}")
    copied = unchanged(open_source(tmp_path / "a.csv", ReadOptions()), ())
    assert {f.code for f in copied.findings} == {"zone-not-stated", "preamble-not-copied"}
    remarks = "".join(f"{line},note {k}\n" for k, line in enumerate((rows * 3).splitlines()))
    (tmp_path / "a.csv").write_text(f"time,p [bar],remark\n{remarks}")
    copied = unchanged(open_source(tmp_path / "a.csv", ReadOptions()), ())
    [left_out] = [f for f in copied.findings if f.code == "texts-not-copied"]
    assert left_out.names["columns"] == "'remark'"
    zoned = rows.replace(",", "+01:00,")
    (tmp_path / "a.csv").write_text(f"time,p [bar]\n{zoned}")
    assert not unchanged(open_source(tmp_path / "a.csv", ReadOptions()), ()).findings


@pytest.mark.parametrize(("decimals", "is_reported"), [(0, True), (1, False)])
def test_a_train_speed_in_whole_units_is_reported(
    tmp_path: Path, decimals: int, is_reported: bool
) -> None:
    rows = (
        f"{k / 10},{min(k, 30) / 10},{80 - k / 7:.2f},{80 - k / 7:.{decimals}f}" for k in range(200)
    )
    path = tmp_path / "a.csv"
    path.write_text(
        "t [s],bc pressure [bar],wheel speed [km/h],GPS speed [km/h]\n" + "\n".join(rows) + "\n"
    )
    log = survey(open_source(path, ReadOptions()), (), Vehicle())
    notes = [f for f in log.findings if f.code == "train-speed-rounded"]
    assert [f.message for f in notes] == ["Train speed is rounded to 1 km/h."] * is_reported


def test_a_channel_in_an_unknown_language_is_proposed_by_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "".join(f"{k / 50},{k % 7},{k},{70 - k / 50}\n" for k in range(200))
    path.write_text(f"t [s],Ilungo [bar],variance,wheel speed [km/h]\n{rows}")
    proposals = survey(open_source(path, ReadOptions()), (), Vehicle()).proposals
    assert set(proposals) == {"pressure"}
    settings = load(assignments=pasted(proposals["pressure"]), folder=False)
    log = survey(open_source(path, settings.read), settings.mappings, Vehicle())
    assert next((c.name, c.meaning) for c in log.channels) == ("Ilungo [bar]", "pressure")


def test_a_stated_channel_that_one_of_many_logs_lacks_is_refused_with_the_name_of_the_log(
    tmp_path: Path,
) -> None:
    (tmp_path / "two.csv").write_text("t [s],bc [bar],wheel speed [m/s]\n0,1,9\n1,1,8\n")
    source = open_source(tmp_path / "two.csv", ReadOptions())
    with pytest.raises(UserError, match=r"two\.csv: unknown channel 'radar'") as error:
        read(source, (Mapping("train_speed", None, "radar", unit="m/s"),), Vehicle())
    assert error.value.code == 2
