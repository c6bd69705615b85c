"""A page of a long train: an overview of all axles, and figures of the worst ones."""

from dataclasses import replace
from pathlib import Path

import pytest
from helpers.pages import analysed, figures, written

from adhesion_cli.core.errors import UserError
from adhesion_cli.results.report import page, words
from adhesion_cli.results.report.run import ReportRun, read


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Twelve axles; axle 2 slides."""
    return written(tmp_path_factory.mktemp("long") / "x.mcap", analysed(axles=12, n=800))


@pytest.fixture(scope="module")
def run(path: Path) -> ReportRun:
    return read(path)


def test_the_worst_axle_of_each_group_is_drawn_and_all_are_in_the_overview(run: ReportRun) -> None:
    assert len(run.detailed) == 3
    assert run.detailed[0] == 2
    text = page.page([run])
    roots = set(figures(text)["roots"].values())
    assert {root.split("-")[1] for root in roots if root.startswith("axle")} == set(
        map(str, run.detailed)
    )
    rows = words.brake_tables([run])[-1].rows
    assert [row["axles"] for row in rows] == ["1–4", "5–8", "9–12"]
    assert rows[0]["axle"] == "2"
    assert text.count('<div class="card ') == len(run.detailed)
    assert "axles 1–4" in str(figures(text))


def test_other_axles_are_drawn_on_request(path: Path) -> None:
    run = read(path, axles=[7])
    assert run.detailed == (7,)
    assert run.axles[6].has_values("lower")
    assert not run.axles[5].has_values("lower")
    assert run.axles[5].has_values("rim")
    assert 'id="axle-7"' in page.page([run])
    with pytest.raises(UserError, match="no axle 40"):
        read(path, axles=[40])


def test_many_rows_begin_with_a_row_per_stop(run: ReportRun) -> None:
    assert words.brake_tables([run]) == words.brake_tables([run], all_rows=True)
    axles = [
        replace(axle, summary=axle.summary._replace(applications=axle.applications * 3))
        for axle in run.axles
    ]
    long = replace(run, axles=tuple(axles))
    first, *_ = words.brake_tables([long])
    assert first.rows[0]["axle"] == "2"
    assert "One row per stop" in first.lead + first.note
