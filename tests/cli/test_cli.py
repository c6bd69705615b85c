"""The command as users run it: real processes, real files."""

import hashlib
import json
import re
import subprocess
from pathlib import Path
from typing import Any

import pytest
from helpers.commands import Run
from helpers.forked import Forked
from helpers.trains import rows, three_trains

from adhesion_cli.analysis import inspection, settings
from adhesion_cli.cli.app import app
from adhesion_cli.core.model import Log
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_logs"


def test_analyze_writes_both_files_and_says_so(run: Run, tmp_path: Path) -> None:
    done = run("analyze", SAMPLES / "service-brake.csv")
    assert done.returncode == 0, done.stderr
    assert "neso" in done.stdout
    assert "µ mean" in done.stdout
    assert max(map(len, done.stdout.splitlines()[1:])) <= 80
    for kind in ("mcap", "rrd", "sha256"):
        assert f"wrote service-brake.adhesion.{kind}\n" in done.stdout
    names = {p.name for p in tmp_path.iterdir()}
    assert {"service-brake.adhesion.mcap", "service-brake.adhesion.rrd"} <= names

    first = (tmp_path / "service-brake.adhesion.mcap").read_bytes()
    refused = run("analyze", SAMPLES / "service-brake.csv")
    assert refused.returncode == 1
    assert "--force" in refused.stderr
    again = run("analyze", SAMPLES / "service-brake.csv", "--force", "--json")
    assert again.returncode == 0
    assert (tmp_path / "service-brake.adhesion.mcap").read_bytes() == first

    document = json.loads(again.stdout)
    assert document["schema"] == "adhesion.result/1"
    (result,) = document["results"]
    assert result["log"]["rows_read"] == result["log"]["rows_used"] == 2601
    assert result["log"]["duration_s"] == 26.0
    (axle,) = result["axles"]
    assert axle["reference"]["method"] == "smoother"
    assert axle["reference"]["sigma_n"] < axle["reference"]["band_n"]
    (braked,) = axle["applications"]
    assert 0.0 < braked["start_s"] < braked["end_s"] < 26.0
    assert braked["coefficient"]["mean"] < braked["coefficient"]["max"] < 0.1
    assert braked["slides"] == 0
    assert result["findings"][0]["code"] == "vehicle-default"
    assert result["findings"][0]["severity"] == "warning"
    ran = {e["algo"] for e in axle["estimators"]}
    assert ran == {"gradient", "imm", "kalman", "leso", "neso", "td"}
    assert {e["against"] for e in axle["estimators"]} == {"truth"}
    assert min(e["relative"] for e in axle["estimators"]) == 1.0

    compared = run("compare", "--algo", "neso", "--json")
    assert compared.returncode == 0, compared.stderr
    assert "service-brake.adhesion.mcap" in compared.stderr  # it says which log it took
    (neso,) = json.loads(compared.stdout)["results"][0]["axles"][0]["estimators"]
    before = next(e for e in axle["estimators"] if e["algo"] == "neso")
    assert neso["rmse_n"] == pytest.approx(before["rmse_n"], rel=1e-6)


def test_a_comparison_is_a_log_again_and_clean(run: Run, tmp_path: Path) -> None:
    folder = ("-o", "again")
    (tmp_path / "again").mkdir()
    first = run("analyze", SAMPLES / "low-adhesion.mcap", "-a", "td", "--axle", "1", "--json")
    assert first.returncode == 0
    assert run("compare", "-a", "td").returncode == 0  # its topics begin with low-adhesion.adhesion
    done = run("analyze", "low-adhesion.compare.mcap", "-a", "td", "--json", *folder)
    assert done.returncode == 0, done.stderr
    again = json.loads(done.stdout)["results"][0]["axles"]
    for axle, of in zip(again, json.loads(first.stdout)["results"][0]["axles"], strict=True):
        (td,), (same,) = axle["estimators"], of["estimators"]
        assert td["against"] == "truth"
        assert td["rmse_n"] == pytest.approx(same["rmse_n"], rel=1e-6)
    for kind in ("adhesion", "compare"):
        done = run("inspect", f"low-adhesion.{kind}.mcap", "--json")
        assert done.returncode == 0, done.stdout
        (log,) = json.loads(done.stdout)["logs"]
        assert not [f["code"] for f in log["findings"] if f["severity"] != "info"]
        assert "adhesion.Event" not in {c["reason"].split(":")[0] for c in log["channels"]}


def test_compare_ranks_several_logs(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    converted = run("convert", "a.csv", "b.mcap")
    assert converted.returncode == 0, converted.stderr
    done = run("compare", "a.csv", "b.mcap", "--algo", "neso", "--algo", "leso", "--json")
    assert done.returncode == 0, done.stderr
    first, second = json.loads(done.stdout)["results"]
    assert first["axles"] == second["axles"]
    assert [e["against"] for e in first["axles"][0]["estimators"]] == ["reference"] * 2
    assert (tmp_path / "a.compare.mcap").exists()
    assert (tmp_path / "a.compare.rrd").exists()


def test_convert_there_and_back_loses_nothing(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows(40))
    assert run("convert", "a.csv", "b.mcap").returncode == 0
    assert run("convert", "b.mcap", "c.csv").returncode == 0
    documents = [json.loads(run("inspect", f, "--json").stdout) for f in ("a.csv", "c.csv")]
    first, last = (
        {(c["meaning"], c["unit"], c["rows"], c["rate_hz"]) for c in d["logs"][0]["channels"]}
        for d in documents
    )
    assert first == last
    again = (tmp_path / "c.csv").read_text().splitlines()[1:]
    for line, original in zip(again, rows(40).splitlines()[1:], strict=True):
        assert [float(x) for x in line.split(",")] == [float(x) for x in original.split(",")]


def test_convert_takes_no_channel_for_anything(run: Run, tmp_path: Path) -> None:
    header = "time [s],bogie 1 bc pressure [bar],left wheel speed [km/h],right wheel speed [km/h]\n"
    (tmp_path / "a.csv").write_text(
        header + "".join(f"{i},0,{70 - i},{70 - i}\n" for i in range(9))
    )
    assert run("inspect", "a.csv").returncode == 3  # which wheel speed it is
    done = run("convert", "a.csv", "b.csv")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "b.csv").read_text().splitlines()[0].replace('"', "") == header.strip()


def test_compare_says_which_log_a_finding_is_from(run: Run, tmp_path: Path) -> None:
    lines = rows(600).splitlines()
    (tmp_path / "whole.csv").write_text(rows(600))
    (tmp_path / "cut.csv").write_text("\n".join(lines[:300] + lines[400:]) + "\n")
    done = run("compare", "whole.csv", "cut.csv", "-a", "td")
    assert done.returncode == 3
    told = done.stderr.splitlines()
    at = told.index("cut.csv:")
    assert any(line.startswith("  gap ") for line in told[at:])
    assert not any(line.startswith("  gap ") for line in told[:at])


def test_settings_change_the_result_and_a_result_keeps_them(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())

    def rmse(*arguments: str) -> float:
        done = run("compare", *arguments, "--algo", "neso", "--json", "--force")
        assert done.returncode == 0, done.stderr
        (axle,) = json.loads(done.stdout)["results"][0]["axles"]
        return float(axle["estimators"][0]["rmse_n"])

    stated = ("--set", "neso.beta1=100", "--set", "vehicle.phi=0.28")
    assert run("analyze", "a.csv", *stated).returncode == 0
    changed = rmse("a.csv", *stated)
    assert changed != pytest.approx(rmse("a.csv"), rel=0.1)
    assert rmse("a.adhesion.mcap") == pytest.approx(changed, rel=1e-6)


def test_inspect_explains_every_channel(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    done = run("inspect", "a.csv", "missing.csv", "--json")
    assert done.returncode == 1  # one log's failure does not stop the others
    good, bad = json.loads(done.stdout)["logs"]
    assert good["status"] == "ok"
    assert good["rows_read"] == 400
    channels = {c["meaning"]: c for c in good["channels"]}
    assert channels["pressure"]["unit"] == "bar"
    assert "bar" in channels["pressure"]["reason"]
    assert channels["wheel_speed"]["rate_hz"] == pytest.approx(50.0)
    assert bad["status"] == "error"
    assert "missing.csv" in bad["error"]


HEADER = "time [s],bc pressure [bar],wheel speed [km/h]\n"
GOOD = "analyze a.csv"


@pytest.mark.parametrize(
    ("command", "content", "code", "says"),
    [
        ("analyze missing.csv", None, 1, "missing.csv"),
        (GOOD, "", 1, "empty"),
        ("analyze a.mcap", "not an mcap file at all", 1, "a.mcap"),
        (GOOD, HEADER, 1, "a.csv"),
        (GOOD, HEADER + "0.0,1.0,70.0\n", 1, "a.csv"),
        (GOOD, HEADER + "".join(f"{i},nan,nan\n" for i in range(50)), 1, "no usable"),
        (GOOD, HEADER + "".join(f"1.0,{i},{70 - i}\n" for i in range(50)), 1, "a.csv"),
        (GOOD, rows().replace("[bar]", "[furlong]"), 1, "unknown unit 'furlong'"),
        (GOOD, rows().replace(" [bar]", ""), 1, "unit"),
        (GOOD, rows().replace("bc pressure", "temperature").replace("bar", "degC"), 1, "pressure"),
        (GOOD + " --algo nesso", rows(), 2, "neso"),
        (GOOD + " --set neso.beta9=1", rows(), 2, "beta1"),
        (GOOD + " --reference smother", rows(), 2, "smoother"),
        (GOOD + " -c missing.toml", rows(), 2, "missing.toml"),
        (GOOD + " -c map.toml", rows(), 2, "bc pressure"),
        (GOOD + " -o a.csv", rows(), 1, "a.csv"),
        (GOOD + " -o a.csv/new", rows(), 1, "a.csv/new"),
        (GOOD + " --algo td -o new/er --axle 7", rows(), 2, "axle 7"),
        (GOOD + " --from nan", rows(), 2, "--from nan"),
        (GOOD + " --to inf", rows(), 2, "--to inf"),
        ("analyze -", None, 1, "a log is a file"),
        (GOOD + " --axle 7", rows(), 2, "axle 7"),
        (GOOD + " --from 900", rows(), 2, "--from"),
        ("analyse a.csv", rows(), 2, "analyze"),
        ("a.csv", rows(), 2, "`adhesion analyze a.csv`"),
        (".", None, 2, "`adhesion fleet . -o DIR`"),
        ("analyze .", None, 1, "`adhesion fleet . -o DIR`"),
        ("analyze a.csv --bogus", rows(), 2, "--bogus"),
        ("convert a.csv a.xyz", rows(), 2, ".mcap"),
        ("view nothing.rrd", None, 1, "nothing.rrd"),
    ],
)
def test_bad_input_is_one_error_one_hint_and_no_file(
    run: Run, tmp_path: Path, command: str, content: str | None, code: int, says: str
) -> None:
    for name in ("a.csv", "a.mcap"):
        if content is not None and name in command:
            (tmp_path / name).write_text(content)
    (tmp_path / "map.toml").write_text(
        '[channels]\npressure."axle 1" = {channel = "bc presure", unit = "bar"}\n'
    )
    before = set(tmp_path.iterdir())
    done = run(*command.split())
    assert done.returncode == code, done.stderr
    lines = done.stderr.splitlines()
    assert [line.split(":")[0] for line in lines] == ["error", "hint"], done.stderr
    assert says in done.stderr
    assert not done.stdout
    assert set(tmp_path.iterdir()) == before


BAD = {
    "inspect": ("inspect --bogus", 2, "--bogus"),
    "analyze": ("analyze missing.csv", 1, "missing.csv"),
    "compare": ("compare missing.csv", 1, "missing.csv"),
    "stops": ("stops missing.csv", 1, "missing.csv"),
    "slip": ("slip missing.csv", 1, "missing.csv"),
    "calibrate": ("calibrate missing.csv", 1, "missing.csv"),
    "tune": ("tune missing.csv other.csv -a leso", 1, "missing.csv"),
    "antiskid": ("antiskid nowhere", 2, "nowhere"),
    "simulate": ("simulate nowhere -o a.csv", 2, "nowhere"),
    "reproduce": ("reproduce -o missing.csv/a", 1, "missing.csv/a"),
    "convert": ("convert missing.csv a.mcap", 1, "missing.csv"),
    "report": ("report missing.mcap -o a.html", 1, "missing.mcap"),
    "fleet": ("fleet missing.csv -o out", 1, "missing.csv"),
    "live": ("live missing.csv", 1, "missing.csv"),
    "estimators": ("estimators -a nesso", 2, "nesso"),
    "export-c": ("export-c nesso", 2, "nesso"),
    "explain": ("explain pressure-dely", 2, "pressure-dely"),
    "vehicle": ("vehicle -c missing.toml", 2, "missing.toml"),
}


@pytest.mark.parametrize("name", [c.name for c in app.registered_commands if c.name != "view"])
def test_errors_as_json(run: Run, tmp_path: Path, name: str) -> None:
    command, code, says = BAD[name]
    if name == "reproduce":
        (tmp_path / "missing.csv").touch()  # where a folder cannot be made
    before = set(tmp_path.iterdir())
    done = run(*command.split(), "--json")
    assert done.returncode == code
    assert not done.stderr
    document = json.loads(done.stdout)
    assert document["schema"] == "adhesion.error/1"
    assert says in document["error"]
    assert document["hint"]
    assert set(tmp_path.iterdir()) == before


@pytest.mark.parametrize(
    ("command", "url"),
    [
        ("fleet service-brake.csv -o s3://trains/2026", "s3://trains/2026"),
        ("fleet service-brake.csv -o memory://", "memory://"),
        ("analyze service-brake.csv -o s3://trains/2026", "s3://trains/2026"),
        ("simulate service-brake -o s3://trains/a.csv", "s3://trains/a.csv"),
        ("analyze s3://trains/a.csv", "s3://trains/a.csv"),
    ],
)
def test_a_url_is_refused_where_a_path_is_needed(
    run: Run, tmp_path: Path, command: str, url: str
) -> None:
    before = set(tmp_path.iterdir())
    done = run(*command.split())
    error, hint = done.stderr.splitlines()
    assert done.returncode in (1, 2)
    assert error.startswith(f"error: {url}: ")
    assert "this machine" in hint or "adhesion fleet" in hint
    assert set(tmp_path.iterdir()) == before


def test_flag_beats_set_beats_file_beats_folder_beats_default(run: Run, tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("[neso]\nbeta1 = 60\nbeta2 = 61\n")

    def values(*options: str) -> list[float]:
        shown = json.loads(run("estimators", "-a", "neso", "--json", *options).stdout)
        of = {p["name"]: p["value"] for p in shown["estimators"][0]["parameters"]}
        return [of["beta1"], of["beta2"], of["delta"]]

    assert values() == [216.0, 216.0, 0.02]
    (tmp_path / "adhesion.toml").write_text("[neso]\nbeta1 = 50\nbeta2 = 51\ndelta = 0.05\n")
    assert values() == [50.0, 51.0, 0.05]
    assert values("-c", "own.toml") == [60.0, 61.0, 0.05]
    assert values("-c", "own.toml", "--set", "neso.beta1=70") == [70.0, 61.0, 0.05]

    (tmp_path / "a.csv").write_text(rows())
    stated = ("--set", 'analysis.reference="smoother"', "--reference", "butterworth")
    done = run("analyze", "a.csv", "-a", "td", "--json", *stated)
    (axle,) = json.loads(done.stdout)["results"][0]["axles"]
    assert axle["reference"]["method"] == "butterworth"


def test_no_overlap_in_time(run: Run, tmp_path: Path) -> None:
    lines = ["time [s],bc pressure [bar],wheel speed [km/h]"]
    lines += [f"{i / 10},{min(i / 20, 3)}," for i in range(100)]
    lines += [f"{100 + i / 10},,{70 - i / 5}" for i in range(100)]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    done = run("analyze", "a.csv")
    assert done.returncode == 1
    assert "share no time" in done.stderr


def test_lost_data_is_told_with_exit_code_3(run: Run, tmp_path: Path) -> None:
    lines = rows(600).splitlines()
    del lines[300:400]
    lines[50] = lines[50].rsplit(",", 1)[0] + ",broken"
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    done = run("analyze", "a.csv", "--json")
    assert done.returncode == 3, done.stderr
    findings = {f["code"]: f for f in json.loads(done.stdout)["results"][0]["findings"]}
    assert findings["gap"]["count"] == 1
    assert findings["gap"]["first_s"] == pytest.approx(5.96)
    assert "broken" in findings["csv-bad-cells"]["message"]


def test_the_registry_is_shown_as_set(run: Run, tmp_path: Path) -> None:
    done = run("estimators", "--json")
    assert done.returncode == 0
    listed = {e["algo"]: e for e in json.loads(done.stdout)["estimators"]}
    beta1 = next(p for p in listed["neso"]["parameters"] if p["name"] == "beta1")
    assert beta1["default"] == 216.0
    assert beta1["value"] == 216.0
    assert "  neso.beta1 = 100 " in run("estimators", "--set", "neso.beta1=100").stdout
    (tmp_path / "adhesion.toml").write_text("[neso]\nbeta1 = 50\n")
    (neso,) = json.loads(run("estimators", "--json", "-a", "neso").stdout)["estimators"]
    values = {p["name"]: (p["value"], p["default"]) for p in neso["parameters"]}
    assert values["beta1"] == (50.0, 216.0)
    for wrong in ("--set neso.nonsense=100", "-c nope.toml", "--axle 1", "-o .", "--force"):
        assert run("estimators", *wrong.split()).returncode == 2, wrong


def test_a_log_of_three_trains(run: Run, tmp_path: Path) -> None:
    (tmp_path / "trains.csv").write_text(three_trains())
    mapping = ROOT / "tests" / "data" / "three-trains.toml"
    seen = json.loads(run("inspect", "trains.csv", "-c", mapping, "--json").stdout)["logs"][0]
    frozen = next(f for f in seen["findings"] if f["code"] == "speed-stuck")
    assert frozen["first_s"] == pytest.approx(91.0)
    interleaved = next(f for f in seen["findings"] if f["code"] == "one-device-read")
    assert "'3', '4', '5'" in interleaved["message"]
    unmapped = json.loads(run("inspect", "trains.csv", "--json").stdout)["logs"][0]
    assert unmapped["status"] == "error"
    done = run("analyze", "trains.csv", "-c", mapping, "--json")
    assert done.returncode == 3
    axles = json.loads(done.stdout)["results"][0]["axles"]
    assert [a["axle"] for a in axles] == [1, 2]
    assert all(e["rmse_n"] is not None for a in axles for e in a["estimators"])


def test_options_a_command_has_no_use_for_are_refused(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows(40))
    for command in (
        "inspect a.csv --algo neso", "convert a.csv b.mcap --from 1", "view a.rrd --set neso.k=1",
        "convert a.csv b.mcap --axle 1", "estimators --view", "inspect a.csv --force",
    ):  # fmt: skip
        done = run(*command.split())
        assert done.returncode == 2, command
        assert "No such option" in done.stderr
    assert {p.name for p in tmp_path.iterdir()} == {"a.csv"}


def test_debug_adds_the_traceback_and_changes_nothing_else(run: Run) -> None:
    for command in ("analyze missing.csv --json", "analyze missing.csv", "analyze --bogus"):
        plain, debug = run(*command.split()), run(*command.split(), "--debug")
        assert (debug.returncode, debug.stdout) == (plain.returncode, plain.stdout)
        assert debug.stderr.endswith(plain.stderr)
        assert "Traceback" in debug.stderr
        assert "Traceback" not in plain.stderr


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("--algo nesso", "unknown algorithm 'nesso'"),
        ("--set nesso.k=1", "unknown setting 'nesso'"),
        ("--reference s", "unknown reference 's'"),
        ("--axle 0", "Invalid value for '--axle'"),
        ("--from 5 --to 5", "--from 5 and --to 5 are not two times in order"),
    ],
)
def test_wrong_arguments_are_told_before_existing_results(
    run: Run, tmp_path: Path, wrong: str, says: str
) -> None:
    (tmp_path / "a.csv").write_text(rows(40))
    for kind in ("adhesion", "compare"):
        (tmp_path / f"a.{kind}.mcap").write_text("kept")
    for command in ("analyze", "compare"):
        done = run(command, "a.csv", *wrong.split())
        assert done.returncode == 2
        assert says in done.stderr


def test_a_fault_of_ours_in_one_log_stops_no_other_s_inspection(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    logs = [str(tmp_path / name) for name in ("a.csv", "b.csv", "c.csv")]
    for log in logs:
        Path(log).write_text(rows(400))
    real = inspection.align_log

    def fails(log: Log, *more: Any, **settings: Any) -> Any:
        if log.path == logs[1]:
            raise ValueError("math domain error")
        return real(log, *more, **settings)

    monkeypatch.setattr(inspection, "align_log", fails)
    assert app(["inspect", *logs, "--json", "--debug"], standalone_mode=False) == 1
    out, err = capsys.readouterr()
    first, second, third = json.loads(out)["logs"]
    assert first["status"] == third["status"] == "ok"
    assert first["channels"]
    assert second["status"] == "error"
    assert second["error"] == "internal error: ValueError: math domain error"
    assert "--debug" in second["hint"]
    assert "Traceback" in err


def test_of_several_logs_all_are_written_or_none_if_strict(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    (tmp_path / "b.csv").write_text(rows(start=7.0))
    (tmp_path / "bare.csv").write_text(rows().replace(" [bar]", ""))  # opens, says no unit
    (tmp_path / "empty.csv").write_text("")
    before = {p.name for p in tmp_path.iterdir()}
    for bad in ("bare.csv", "empty.csv", "missing.csv"):
        done = run("analyze", "a.csv", bad, "b.csv", "-a", "td", "--json", "--strict")
        assert done.returncode == 1
        assert bad in json.loads(done.stdout)["error"]
        assert {p.name for p in tmp_path.iterdir()} == before
    done = run("analyze", "a.csv", "b.csv", "--json", "--algo", "td", "--algo", "td")
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)["results"]
    assert [r["outputs"]["mcap"] for r in results] == ["a.adhesion.mcap", "b.adhesion.mcap"]
    assert all((tmp_path / path).exists() for r in results for path in r["outputs"].values())
    assert [e["algo"] for e in results[0]["axles"][0]["estimators"]] == ["td"]


def test_an_axle_named_twice_is_analysed_once(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    once, twice = (
        json.loads(run("compare", "a.csv", *axles, "--json", "--force").stdout)
        for axles in (("--axle", "1"), ("--axle", "1", "--axle", "1"))
    )
    assert once == twice


def test_mappings_of_raw_logs_do_not_concern_results(run: Run, tmp_path: Path) -> None:
    text = rows().replace("bc pressure [bar]", "x").replace("wheel speed [km/h]", "y")
    (tmp_path / "raw.csv").write_text(text)
    (tmp_path / "map.toml").write_text(
        '[channels]\npressure = {channel = "x", unit = "bar"}\nspeed."axle 1" = '
        '{channel = "y", unit = "km/h"}\n[vehicle]\nfriction = 0.28\n'
    )
    chosen = ("-c", "map.toml", "--algo", "td", "--json")
    first = run("analyze", "raw.csv", *chosen, "--from", "1", "--axle", "1")
    assert first.returncode == 0, first.stderr + first.stdout
    (result,) = json.loads(first.stdout)["results"]
    assert [(c["name"], c["meaning"], c["unit"]) for c in result["channels"]] == [
        ("x", "pressure", "bar"), ("y", "wheel_speed", "km/h"),
    ]  # fmt: skip
    done = run("compare", "raw.adhesion.mcap", "raw.csv", *chosen, "--from", "1")
    assert done.returncode == 0, done.stderr + done.stdout
    seen = run("inspect", "raw.adhesion.mcap", "-c", "map.toml", "--json")
    assert seen.returncode == 0, seen.stdout

    metadata = open_source(tmp_path / "raw.adhesion.mcap", ReadOptions()).metadata
    carried = settings.nested(metadata["adhesion.settings"])
    assert carried["channels"]["pressure"] == {"channel": "x", "unit": "bar"}
    assert carried["channels"]["wheel_speed"]["axle 1"] == {"channel": "y", "unit": "km/h"}
    assert carried["selection"] == {"from": 1.0, "axles": [1], "strict": False}
    again = settings.load(folder=False).over(carried)
    assert again.mappings == ()
    # The vehicle that was used: what is stated, with what the log shows.
    assert again.analysis.vehicle == "stated"
    assert 0.28 < again.vehicle.friction.value < 0.34
    metrics = json.loads(metadata["adhesion.metrics"]["json"])
    assert metrics["results"][0]["channels"] == result["channels"]


def test_errors_of_the_reference_are_those_while_braking(run: Run, tmp_path: Path) -> None:
    lines = rows(3000).splitlines()
    lines[501:] = [line.rsplit(",", 2)[0] + ",0.0,54.0" for line in lines[501:]]
    (tmp_path / "a.csv").write_text("\n".join(lines) + "\n")
    done = run("analyze", "a.csv", "--algo", "td", "--json")
    (axle,) = json.loads(done.stdout)["results"][0]["axles"]
    assert axle["reference"]["band_n"] > 100.0  # 10 % of the pad friction on some kN


def viewed(folder: Path, name: str) -> subprocess.CompletedProcess[str]:
    """`adhesion view`, which then tells what it would show: no window in a test."""
    code = "from adhesion_cli.cli import view; view.show_recording = print"
    code += "; os.environ['DISPLAY'] = ':0'"
    pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    process = Forked(folder, ["view", name], code, **pipes)
    out, err = process.communicate(timeout=60)
    return subprocess.CompletedProcess(name, process.returncode, out, err)


def test_the_summary_of_every_command_is_whole(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        app(["--help"], terminal_width=80)
    listed = capsys.readouterr().out.partition("Commands:\n")[2].strip().splitlines()
    assert len(listed) == len(app.registered_commands)
    assert all(line.endswith(".") and "..." not in line for line in listed), listed


# These take long, and have tests of their own.
LONG_EXAMPLES = [
    "antiskid", "calibrate", "compare", "estimators", "fleet", "live", "reproduce", "slip", "stops",
    "tune",
]  # fmt: skip


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_the_examples_of_the_help_run_as_they_stand(run: Run, tmp_path: Path, whole: bool) -> None:
    examples = {
        c.name: re.findall(r"Example: adhesion (.*)", c.callback.__doc__ or "")
        for c in app.registered_commands
        if c.callback
    }
    assert all(len(found) == 1 for found in examples.values()), examples
    assert max(len(found[0]) for found in examples.values()) <= 60  # on one line: it can be pasted
    (tmp_path / "sample_logs").symlink_to(SAMPLES)
    for name in LONG_EXAMPLES if not whole else ():
        del examples[name]
    (shown,) = examples.pop("view")
    for (example,) in [examples.pop("simulate"), *examples.values()]:  # makes what the others take
        done = run(*example.split())
        assert done.returncode in (0, 3), (example, done.stderr)  # leaf-film's train speed is late
    assert viewed(tmp_path, shown.split()[1]).stdout == "service-brake.adhesion.rrd\n"


def test_view_makes_a_recording_anew_and_keeps_the_set_whole(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    assert run("analyze", "a.csv", "--algo", "td", "--set", "vehicle.phi=0.28").returncode == 0
    recording, manifest = tmp_path / "a.adhesion.rrd", tmp_path / "a.adhesion.sha256"
    record = tmp_path / "a.adhesion.mcap"
    (tmp_path / "adhesion.toml").write_text("friction = 0.25\n")  # came later than the result
    for spoil in (recording.unlink, lambda: recording.write_bytes(b"another's"), manifest.unlink):
        spoil()
        done = viewed(tmp_path, record.name)
        assert done.returncode == 0, done.stderr
        assert done.stdout == "a.adhesion.rrd\n"
        told = dict(reversed(x.split("  ")) for x in manifest.read_text().splitlines()[1:])
        assert told == {
            p.name: hashlib.sha256(p.read_bytes()).hexdigest() for p in (record, recording)
        }
    made = recording.stat().st_mtime_ns
    record.touch()  # later than the recording, and the same
    assert viewed(tmp_path, record.name).returncode == 0
    assert recording.stat().st_mtime_ns == made


def test_view_makes_no_recording_of_what_is_no_analysis(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(rows())
    assert run("convert", "a.csv", "raw.mcap").returncode == 0
    assert run("compare", "a.csv", "raw.mcap", "-a", "td").returncode == 0
    assert viewed(tmp_path, "a.compare.mcap").stdout == "a.compare.rrd\n"
    (tmp_path / "a.compare.rrd").write_bytes(b"another's")
    before = {p: p.read_bytes() for p in tmp_path.iterdir()}
    for name in ("raw.mcap", "a.compare.mcap"):
        done = viewed(tmp_path, name)
        assert done.returncode == 1
        assert done.stderr.startswith(
            f"error: {name}: {Path(name).stem}.rrd is missing, or was not"
        )
    assert {p: p.read_bytes() for p in tmp_path.iterdir()} == before


def test_inspect_of_an_empty_channel_and_of_a_calendar(run: Run, tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text(
        "time,bc pressure [bar],wheel speed [km/h],train speed [km/h]\n"
        + "".join(f"2024-11-05T07:12:0{i}Z,{i}.0,{70 - i},\n" for i in range(4))
    )
    done = run("inspect", "a.csv", "--json")
    (log,) = json.loads(done.stdout)["logs"]
    assert log["status"] == "ok"
    assert log["start"] == "2024-11-05T07:12:00Z"
    (train,) = (c for c in log["channels"] if c["meaning"] == "train_speed")
    assert (train["rows"], train["valid"]) == (4, 0)
    (empty,) = (f for f in log["findings"] if f["code"] == "empty-channel")
    assert (empty["severity"], empty["channel"]) == ("info", "train speed [km/h]")
    (tmp_path / "b.csv").write_text(
        "time [s],p [bar],v [km/h]\n" + "".join(f"{i},,{70 - i}\n" for i in range(4))
    )
    done = run("inspect", "b.csv")
    assert done.returncode == 3
    assert "warnings:\n  not-analysable" in done.stdout
    (tmp_path / "c.csv").write_text(rows().replace("[bar]", "[furlong]"))
    done = run("inspect", "c.csv", "--json")
    (told,) = json.loads(done.stdout)["logs"][0]["findings"]
    assert told["code"] == "not-analysable"
    assert "unknown unit 'furlong'" in told["names"]["reason"]
    assert "`--set channels.pressure.unit=bar`" in told["hint"]
    shown = run("inspect", "c.csv").stdout
    assert re.search(r"pressure +\S+ +not stated", shown)
    line = next(x for x in shown.splitlines() if x.startswith("hint: "))
    assert "`--set channels.pressure.unit=bar`" in line


def test_each_row_of_a_table_of_signals_counts_once(run: Run, tmp_path: Path) -> None:
    signals = "".join(
        f"{k / 20},{name},{value}\n"
        for k in range(200)
        for name, value in (("bcp_1 [bar]", 2 + k % 2), ("wheel_speed_1 [km/h]", 90 - k / 4))
    )
    (tmp_path / "log.csv").write_text("time [s],signal,value\n" + signals)
    (result,) = json.loads(run("analyze", "log.csv", "--json").stdout)["results"]
    assert result["log"]["rows_used"] == result["log"]["rows_read"] == 400


def test_inspect_fits_a_screen(run: Run) -> None:
    """A row per channel, columns for faults that some have, one line for channels taken alike."""
    done = run("inspect", SAMPLES / "low-adhesion.mcap")
    lines = done.stdout.splitlines()
    assert len(lines) < 40
    assert "unused, gaps, duplicates, backward: none" in lines
    assert [x for x in lines if x.startswith("pressure 1, 2, 3, 4: name has")]


def test_inspect_shows_a_force_of_two_axles_in_one_row(run: Run, tmp_path: Path) -> None:
    head = "time [s],wheel speed 1 [km/h],wheel speed 2 [km/h],BCP 1 [bar],BCP 2 [bar]"
    head += ",ED force bogie 1 [kN]"
    rows = (f"{k / 50},60,60,0.{k % 2},0.{k % 3},0.{k % 5}" for k in range(400))
    (tmp_path / "a.csv").write_text("\n".join([head, *rows, ""]))
    lines = run("inspect", "a.csv").stdout.splitlines()
    (row,) = [line for line in lines if line.startswith("ED force bogie 1 [kN]  ")]
    assert row.split()[6:9] == ["1,", "2", "kN"]
