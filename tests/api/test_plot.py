"""Figures of a result in a notebook: its data, without a file and without a network."""

from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import adhesion_cli as adhesion
from adhesion_cli.core.bundled import folder
from adhesion_cli.results.report import run as reports


class Tags(HTMLParser):
    """The tags of a page and their attributes; not what stands inside of scripts."""

    def __init__(self) -> None:
        super().__init__()
        self.found: set[str] = set()
        self.attributes: set[str] = set()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.add(tag)
        self.attributes |= {name for name, _ in attrs}


SLID = folder("sample_logs") / "low-adhesion.mcap"


@pytest.fixture(scope="module")
def run() -> adhesion.Analysis:
    return adhesion.analyze(SLID, algos="neso", axles=[1, 3])


def test_the_figures_have_the_data_that_a_result_file_has(
    run: adhesion.Analysis, tmp_path: Path
) -> None:
    record, _ = run.write(tmp_path)
    for own, read in zip(
        reports.of_result(run.result, run._summary).axles, reports.read(record).axles, strict=True
    ):
        assert (own.number, own.applications) == (read.number, read.applications)
        (sigma,) = (a.reference.sigma for a in run.result.axles if a.record.axle == own.number)
        most: dict[str, Any] = {"slip": 2.0**-17}  # is rounded away
        most |= dict.fromkeys(("force", "lower", "upper"), np.nan_to_num(sigma) / 32.0)
        for name in ("t", "train", "rim", "pressure", "force", "lower", "upper", "slip", "truth"):
            one, other = getattr(own, name), getattr(read, name)
            within = most.get(name, 0.0) + 1e-3 * np.abs(one) + 1e-6
            np.testing.assert_array_equal(np.isnan(one), np.isnan(other))
            assert not (np.abs(one - other) > within).any(), name
        assert set(own.errors) == set(read.errors)


def test_a_notebook_gets_figures_that_need_no_network(run: adhesion.Analysis) -> None:
    overview, details = run.plot(), run.plot(axles=3)
    speed, *_, curve = details.layout.children
    assert len(overview.layout.children) == 2
    assert {len(set(map(len, r.data_source.data.values()))) for r in speed.renderers} == {1}
    assert "slip" in curve.xaxis[0].axis_label
    page = details._repr_html_()
    assert page.startswith("<iframe")
    assert page.count("<") == 2  # all else is escaped
    tags = Tags()
    tags.feed(details.html())
    assert "script" in tags.found
    assert not {"src", "href"} & tags.attributes
    with pytest.raises(adhesion.UserError, match="unknown axle '2'"):
        run.plot(2)
