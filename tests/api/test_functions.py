"""The functions of the package: the figures of the command line, as records, arrays and tables."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import adhesion_cli as adhesion
from adhesion_cli.cli.app import app
from adhesion_cli.core.bundled import SAMPLE, folder
from adhesion_cli.core.model import quantities

LOGS = folder("sample_logs")
BRAKE, SLID = LOGS / SAMPLE, LOGS / "low-adhesion.mcap"
Document = Callable[..., dict[str, Any]]


@pytest.fixture
def printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> Document:
    """What a command prints with --json."""

    def run(*arguments: object, out: bool = True) -> dict[str, Any]:
        folder = ["-o", str(tmp_path / "cli")] if out else []
        app([*map(str, arguments), *folder, "--json", "--quiet"], standalone_mode=False)
        document: dict[str, Any] = json.loads(capsys.readouterr().out)
        return document

    return run


def without_outputs(document: dict[str, Any]) -> dict[str, Any]:
    """A document as JSON holds it, without the names of files that only the command writes."""
    found: dict[str, Any] = json.loads(json.dumps(document))
    for of in (found, *found.get("results", ())):
        of.pop("outputs", None)
    return found


@pytest.fixture(scope="module")
def run() -> adhesion.Analysis:
    return adhesion.analyze(SLID, algos=["neso", "imm"])


def python(code: str) -> str:
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_import_loads_nothing_heavy_and_shows_every_name() -> None:
    heavy = {"numpy", "scipy", "numba", "pyarrow", "rerun", "pandas", "bokeh", "typer", "rich"}
    code = (
        "import sys, adhesion_cli as a\n"
        f"assert not {heavy} & set(sys.modules), set(sys.modules) & {heavy}\n"
        "assert set(a.__all__) <= set(dir(a))\n"
        "print([getattr(a, name).__name__ for name in a.__all__] == a.__all__)"
    )
    assert python(code) == "True\n"
    with pytest.raises(AttributeError, match="analyse"):
        adhesion.analyse  # noqa: B018


def test_the_figures_and_the_record_are_those_of_the_command(
    tmp_path: Path, printed: Document
) -> None:
    chosen = ["-a", "neso", "-a", "td", "--set", "vehicle.phi=0.28", "--reference", "butterworth"]
    document = printed("analyze", SLID, *chosen, "--axle", 1, "--from", 1, "--to", 20)
    run = adhesion.analyze(
        SLID, algos=["neso", "td"], vehicle={"phi": 0.28}, reference="butterworth",
        axles=1, from_s=1, to_s=20,
    )  # fmt: skip
    assert without_outputs(run.document) == without_outputs(document)
    files = run.write(tmp_path / "api")
    assert [f.name for f in files] == [
        Path(f).name for f in document["results"][0]["outputs"].values()
    ]
    assert files[0].read_bytes() == (tmp_path / "cli" / files[0].name).read_bytes()
    with pytest.raises(adhesion.UserError, match="exists already") as told:
        run.write(tmp_path / "api")
    assert told.value.hint == "add force=True to replace it, or write elsewhere"
    *_, page = run.write(tmp_path / "api", force=True, report=True)
    assert f"Adhesion report: {SLID.name}" in page.read_text()


def test_slides_and_rails_are_those_of_the_command(tmp_path: Path, printed: Document) -> None:
    document = printed("slip", SLID, "--axle", 1)
    found = adhesion.slip(SLID, axles=1)
    assert without_outputs(found.document) == without_outputs(document)
    slides = found.to_arrow()
    assert slides.num_rows == len(document["axles"][0]["slides"]) > 0
    assert slides.column("duration_s").to_pylist() == [x.duration for x in found.axles[1].slides]
    assert found.to_arrow("axles").column("utilisation").to_pylist() == [
        document["axles"][0]["utilisation"]
    ]
    record, _ = found.write(tmp_path / "api")
    assert record.read_bytes() == (tmp_path / "cli" / record.name).read_bytes()


def test_a_comparison_is_that_of_the_command(tmp_path: Path, printed: Document) -> None:
    document = printed("compare", BRAKE, SLID, "-a", "td", "-a", "neso", "--axle", 1)
    found = adhesion.compare([BRAKE, SLID], algos=("td", "neso"), axles=1)
    assert without_outputs(found.document) == without_outputs(document)
    assert {s.algo for s in found.estimators} == {"td", "neso"}
    assert found.to_arrow().num_rows == sum(
        len(axle["estimators"]) for one in document["results"] for axle in one["axles"]
    )
    record, _ = found.write(tmp_path / "api")
    assert record.read_bytes() == (tmp_path / "cli" / record.name).read_bytes()


def test_what_is_in_a_log_is_as_the_command_says(printed: Document) -> None:
    document = printed("inspect", BRAKE, out=False)
    found = adhesion.inspect(BRAKE)
    assert without_outputs(found.document) == without_outputs(document)
    assert [c.meaning for c in found.channels] == ["pressure", "wheel_speed", "truth"]
    assert found.to_arrow().column("unit").to_pylist() == ["bar", "km/h", "N"]
    assert found.to_arrow("findings").num_rows == len(found.findings)


def test_a_calibration_gives_settings_that_analyze_takes(tmp_path: Path, printed: Document) -> None:
    logs = [tmp_path / "leaf-film.mcap", BRAKE]
    adhesion.convert(adhesion.simulate("leaf-film"), logs[0])
    app(
        ["calibrate", *map(str, logs), "-o", str(tmp_path / "cli.toml"), "-q"],
        standalone_mode=False,
    )
    found = adhesion.calibrate(logs)
    toml = found.write(tmp_path / "api.toml")
    assert toml.read_text() == (tmp_path / "cli.toml").read_text()
    assert found.parameters["friction"].posterior == found.vehicle.friction.value
    assert found.to_arrow().num_rows == len(found.parameters)
    by_file = adhesion.analyze(BRAKE, settings=toml, algos="td").settings["vehicle"]
    by_tables = adhesion.analyze(BRAKE, settings=found.settings, algos="td").settings["vehicle"]
    assert by_file["friction"]["value"] == pytest.approx(found.vehicle.friction.value, rel=1e-8)
    assert by_tables["friction"]["value"] == found.vehicle.friction.value
    with pytest.raises(adhesion.UserError, match="settings are TOML"):
        found.write(tmp_path / "api.json")


def test_records_and_arrays_have_names_shapes_and_units(run: adhesion.Analysis) -> None:
    (entry,) = run.document["results"]
    for axle in entry["axles"]:
        own = run.axles[axle["axle"]]
        assert [a.start_s for a in own.applications] == [a["start_s"] for a in axle["applications"]]
        assert [a.coefficient and a.coefficient.mean for a in own.applications] == [
            a["coefficient"]["mean"] for a in axle["applications"]
        ]
        assert {f.name for f in fields(own.applications[0])} == {"axle", *axle["applications"][0]}
        assert set(own.estimates) == {"neso", "imm"}
        assert set(own.sigmas) == {"imm"}
        for name in quantities(adhesion.Axle):
            column = getattr(own, name)
            assert column is None or column.shape == own.t_s.shape
        known = np.isfinite(own.force)
        np.testing.assert_array_less(own.lower[known], own.upper[known])
        assert own.t_s[0] == pytest.approx(0.0, abs=1.0)
    assert [a.axle for a in run.applications] == sorted(a.axle for a in run.applications)


def test_tables_state_their_units(run: adhesion.Analysis) -> None:
    table = run.to_arrow()
    assert table.num_rows == len(run.applications)
    assert table.schema.field("force_n_mean").metadata == {b"unit": b"N"}
    axle = run.axles[1]
    series = axle.to_arrow()
    units = {f.name: f.metadata[b"unit"].decode() for f in series.schema}
    assert units["pressure"] == "Pa"
    assert units["estimate_neso"] == units["sigma_imm"] == "N"
    np.testing.assert_array_equal(series.column("force").to_numpy(), axle.force)
    with pytest.raises(adhesion.UserError) as told:
        run.to_arrow("aplications")
    assert "did you mean 'applications'" in told.value.hint


def test_pandas_is_optional(run: adhesion.Analysis, monkeypatch: pytest.MonkeyPatch) -> None:
    frame = pytest.importorskip("pandas") and run.axles[1].to_pandas()
    assert len(frame) == len(run.axles[1].t_s)
    assert frame.attrs["units"]["train_speed"] == "m/s"
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(adhesion.UserError, match="pandas is not installed"):
        run.to_pandas()


def test_a_text_shows_the_whole_stops_of_the_train() -> None:
    run = adhesion.analyze(LOGS / "low-adhesion.csv", algos=["imm"])
    (stop,) = run.stops
    assert stop.distance_m
    assert f"{stop.distance_m.value:.0f}±" in repr(run)


def test_a_brake_test_is_that_of_the_command(tmp_path: Path) -> None:
    plan = tmp_path / "plan.toml"
    shutil.copy(LOGS / "low-adhesion.csv", tmp_path / "wet.csv")
    plan.write_text('[group.wet]\nlogs = ["wet.csv"]\n[limits]\ndistance_m = {max = 100}\n')
    test = adhesion.brake_test(plan=plan, stops={"dead_time": 0.3})
    (stop,) = test.series.stops
    assert (stop.group, stop.stop.valid) == ("wet", True)
    assert [x.verdict for x in test.series.limits] == ["fail"]
    assert test.to_arrow()["group"].to_pylist() == ["wet"]
    assert test.document["schema"] == "adhesion.stops/1"
    assert "Limits" in repr(test)
    (other,) = adhesion.brake_test(tmp_path / "wet.csv").series.stops
    assert other.stop.start_s == pytest.approx(stop.stop.start_s + 0.3)
    with pytest.raises(adhesion.UserError, match="in memory"):
        adhesion.brake_test([adhesion.simulate("low-adhesion")])


def test_a_text_shows_every_brake_application(run: adhesion.Analysis) -> None:
    means = [x.coefficient.mean for x in run.applications if x.coefficient]
    assert means
    assert all(f"{mean:.3f}" in repr(run) for mean in means)


@pytest.mark.parametrize(
    ("wrong", "text", "hint"),
    [
        ({"axle": 1}, "unknown keyword 'axle'", "did you mean 'axles'"),
        ({"neso": {"beta": 1}}, "neso", "beta1"),
        ({"vehicle": {"fi": 1}}, "vehicle parameter 'fi'", "phi"),
        ({"vehicle": 0.3}, "vehicle=0.3 is no table", "vehicle={'KEY': value}"),
        ({"vehicle": {"phi": 40}}, "vehicle.friction = 40", "0.01 to 1"),
        ({"vehicle": {"phi": float("nan")}}, "not finite", "plain number"),
        ({"settings": {"axle_mass": float("inf")}}, "not finite", "plain number"),
        ({"algos": "nesso"}, "algorithm 'nesso'", "neso"),
        ({"reference": "s"}, "reference 's'", "smoother"),
        ({"axles": [0]}, "no axles", "from 1"),
        ({"axles": 9}, "no axle 9", ""),
        ({"from_s": 5, "to_s": 5}, "from_s=5 and to_s=5", "to_s is later than from_s"),
        ({"from_s": 900}, "between from_s and to_s", ""),
        ({"from_s": "1"}, "from_s='1'", "seconds"),
        ({"settings": "none.toml"}, "none.toml: no such file", "TOML"),
    ],
)
def test_a_wrong_keyword_is_a_clear_error(wrong: dict[str, Any], text: str, hint: str) -> None:
    with pytest.raises(adhesion.UserError) as told:
        adhesion.analyze(BRAKE, **wrong)
    assert text in told.value.text
    assert hint in told.value.hint
    assert "--" not in told.value.text + told.value.hint


def test_remedies_are_keywords_that_can_be_pasted(tmp_path: Path) -> None:
    log = tmp_path / "a.csv"
    header, *rows = BRAKE.read_text().splitlines()
    log.write_text("\n".join([header.replace("bc_pressure [bar]", "bc_pressure"), *rows]))
    with pytest.raises(adhesion.UserError, match="its unit is not stated") as told:
        adhesion.analyze(log, algos="td")
    remedy = "channels={'pressure': {'unit': 'bar'}}"
    assert f"state it, as {remedy};" in told.value.hint
    assert told.value.__notes__ == [f"hint: {told.value.hint}"]
    stated = eval(f"dict({remedy})")
    assert adhesion.analyze(log, algos="td", **stated).applications
    with pytest.raises(adhesion.UserError, match="no such file"):
        adhesion.inspect(tmp_path / "none.csv")


def test_settings_count_in_the_order_of_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "adhesion.toml").write_text("friction = 0.21\naxle_mass = 5001\ndiscs = 3\n")
    (tmp_path / "a.toml").write_text("friction = 0.22\naxle_mass = 5002\n")
    settings = ["a.toml", {"vehicle": {"axle_mass": 5003}, "analysis": {"vehicle": "stated"}}]
    used = adhesion.analyze(BRAKE, settings=settings, vehicle={"phi": np.float64(0.24)}, algos="td")
    vehicle = used.settings["vehicle"]
    names = ("friction", "axle_mass", "discs")
    assert [vehicle[name]["value"] for name in names] == [0.24, 5003, 3]


def test_nothing_is_printed_and_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    run = adhesion.analyze(BRAKE, algos="td")
    assert run.to_arrow().num_rows
    assert run.axles
    assert run.document
    assert repr(run)
    assert capfd.readouterr() == ("", "")
    assert not list(tmp_path.iterdir())


def test_an_axle_that_was_not_analysed_is_an_error_that_names_the_others(
    run: adhesion.Analysis,
) -> None:
    with pytest.raises(adhesion.UserError) as error:
        run.axles[9]
    assert isinstance(error.value, KeyError)
    assert "9" in str(error.value)
    assert all(str(n) in error.value.hint for n in run.axles)
    assert 9 not in run.axles


def test_a_text_of_several_logs_has_the_log_of_each_finding() -> None:
    both = adhesion.compare([BRAKE, SLID], algos="td")
    lines = repr(both).splitlines()
    for one in both.analyses:
        for f in one.findings:
            (line, *_) = [x for x in lines if one.log.path in x and f"({f.code})" in x]
            assert line.startswith(one.log.path)
    assert all(line == line.rstrip() for line in lines)


def test_a_text_has_no_blanks_at_the_ends_of_lines(run: adhesion.Analysis) -> None:
    assert all(line == line.rstrip() for line in repr(run).splitlines())
