"""Figures of a result in a notebook: its data, without a file and without a network."""

from html.parser import HTMLParser

import pytest

import adhesion_cli as adhesion
from adhesion_cli.core.bundled import folder


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
