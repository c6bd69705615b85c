"""What `reproduce` must show of the paper."""

import functools
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from helpers.commands import in_process

from adhesion_cli.cli.reproduce import report
from adhesion_cli.core import estimator, methods
from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.studies import reproduce

DOCS = Path(__file__).resolve().parents[2] / "docs"

TABLE_2 = {  # as printed
    "td": (1.52, 49.0), "leso": (2.99, 5.0), "neso": (0.61, 19.0), "gradient": (0.95, 25.0),
    "kalman": (0.28, -109.0),
}  # fmt: skip


@pytest.fixture(scope="module")
def made() -> reproduce.Reproduction:
    return reproduce.reproduce()


def test_response_times_of_table_2(made: reproduce.Reproduction) -> None:
    rows = made.document["conditions"]["constant"]
    ours = {algo: rows[algo]["response_s"] for algo in TABLE_2}
    for algo, within in (
        ("leso", 0.02), ("neso", 0.25), ("gradient", 0.25), ("kalman", 0.25), ("td", 0.15),
    ):  # fmt: skip
        assert ours[algo] == pytest.approx(TABLE_2[algo][0], rel=within)
        low, high = rows[algo]["response_interval_s"]
        assert low - 1e-9 <= ours[algo] <= high + 1e-9
        assert (rows[algo]["paper_response_s"], rows[algo]["paper_max_error_n"]) == TABLE_2[algo]
    assert sorted(ours, key=ours.__getitem__) == sorted(TABLE_2, key=lambda a: TABLE_2[a][0])


def test_maximum_errors_are_near_the_printed_ones(made: reproduce.Reproduction) -> None:
    rows = made.document["conditions"]["constant"]
    for algo in ("leso", "neso", "kalman"):
        assert abs(rows[algo]["max_error_n"]) == pytest.approx(abs(TABLE_2[algo][1]), rel=0.25)
    assert rows["kalman"]["max_error_n"] < 0.0


def test_another_reading_gives_what_the_page_says() -> None:
    """As printed, the state of LESO is slow; a filter step of three intervals calms td."""
    slow = reproduce.printed("leso", 4e-3) | {"beta2": 216.0 * wheelset(Vehicle(), 1).a}
    assert reproduce.measure_constant("leso", [1], parameters=slow)["response_s"] is None
    calm = reproduce.printed("td", 4e-3) | {"h0": 12e-3}
    error = reproduce.measure_constant("td", range(1, 6), parameters=calm)["max_error_n"]
    assert abs(error) == pytest.approx(TABLE_2["td"][1], rel=0.25)


def test_varying_condition_reduces_and_delays(made: reproduce.Reproduction) -> None:
    """The paper: amplitude reduced, phase late; the describing functions say by how much."""
    for algo, row in made.document["conditions"]["varying"].items():
        fastest = row["frequency"][-1]
        assert 0.0 < fastest["gain"] < 0.95, algo
        assert reproduce.DELAY < row["lag_s"] < 1.5
        assert row["rmse_n"] > 0.0
    s = 2j * math.pi * 2.0
    exact = 216.0 / (s * s + 216.0 * s + 216.0) * np.exp(-s * reproduce.DELAY)
    at_2 = next(
        x for x in made.document["conditions"]["varying"]["leso"]["frequency"]
        if x["frequency_hz"] == 2.0
    )  # fmt: skip
    assert at_2["gain"] == pytest.approx(abs(exact), rel=0.1)
    late = -np.angle(exact) % (2.0 * math.pi) / (2.0 * math.pi * 2.0)
    assert at_2["lag_s"] == pytest.approx(late, abs=0.01)


def test_harmonic_is_exact_beside_a_slope() -> None:
    t = np.arange(2000) * 1e-3
    x = 3.0 - 0.7 * t + 2.0 * np.sin(2.0 * math.pi * t) - 0.5 * np.cos(2.0 * math.pi * t)
    assert reproduce.harmonic(t, x, 1.0) == pytest.approx(2.0 - 0.5j)


def test_printed_parameters_are_table_1s() -> None:
    known = estimator.registry()
    for algo in TABLE_2:
        p = methods.validate(known[algo], reproduce.printed(algo, 4e-3))
        assert p.euler == 1.0
    kalman = reproduce.printed("kalman", 4e-3)
    assert kalman["b"] ** (4e-3 / 1e-3) == pytest.approx(0.95)
    assert kalman["q"] == 0.0


def numbers(text: str) -> list[float]:
    return [float(x) for x in re.findall(r"[-+]?\d+\.?\d*", text)]


def test_the_page_on_the_paper_shows_what_comes_out(
    made: reproduce.Reproduction, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "120")  # tables fold to the terminal
    page = (DOCS / "explanation" / "paper.md").read_text("utf-8")
    blocks = [b.strip() for b in page.split("```")[1::2]]
    tables = [t for b in blocks if b.startswith(("Table 2", "varying")) for t in b.split("\n\n")]
    shown = [t for t in report(made.document) if t.startswith(("Table 2", "varying"))]
    assert len(tables) == len(shown) == 3
    for ours, page_s in zip(shown, tables, strict=True):
        assert re.sub(r"[-+\d. ]+", " ", ours) == re.sub(r"[-+\d. ]+", " ", page_s)
        assert numbers(page_s) == pytest.approx(numbers(ours), rel=0.01, abs=0.11)
    for name in re.findall(r"!\[.*\]\((.*)\)", page):
        assert (DOCS / "explanation" / name).stat().st_size < 200_000


def test_command_writes_and_states_everything(
    made: reproduce.Reproduction, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(reproduce, "reproduce", lambda progress: made)
    run = functools.partial(in_process, tmp_path, "reproduce")

    done = run("--json")
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert document["schema"] == "adhesion.reproduce/1"
    assert document["readings"] == list(reproduce.READINGS)
    assert set(document["conditions"]["constant"]) == set(TABLE_2)
    for row in document["conditions"]["varying"].values():
        assert {"rmse_n", "lag_s", "gain"} <= set(row)
    for path in document["outputs"].values():
        assert (tmp_path / path).stat().st_size > 1000
    refused = run()
    assert refused.returncode == 1
    assert "--force" in refused.stderr
