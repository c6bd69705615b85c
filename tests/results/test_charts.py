"""Charts: the same bytes again, and texts that are texts."""

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.results import charts, palette

X = np.arange(2_000.0)
PANEL = charts.Panel(
    "a $title$ & <b>", "x", "y", [
        charts.Line("line", X, np.where(X % 100 == 0, np.nan, X), "#123456"),
        charts.Line("", X, -X, palette.GREY, dashed=True),
    ],
)  # fmt: skip


def test_the_bytes_are_the_same_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for name in ("a", "b"):
        charts.write(tmp_path / name, "title", [PANEL, PANEL])
        (tmp_path / "matplotlibrc").write_text("font.size: 20")  # a user's style changes nothing
    content = (tmp_path / "a").read_bytes()
    assert content == (tmp_path / "b").read_bytes()
    assert content.startswith(b"<?xml")
    assert len(content) < 100_000


def test_texts_and_the_legend_stand_in_an_svg(tmp_path: Path) -> None:
    charts.write(tmp_path / "a", "all of it", [PANEL])
    texts = [e.text for e in ET.parse(tmp_path / "a").iter() if e.tag.endswith("text")]
    assert {"all of it", "a $title$ & <b>", "line"} <= set(texts)
    assert "_" not in texts


def test_a_logarithmic_axis_has_plain_numbers_and_leaves_zero_out(tmp_path: Path) -> None:
    y = np.array([0.1, 0.0, 10.0, 1000.0])
    line = charts.Line("", np.arange(4.0), y, "#123456")
    charts.write(tmp_path / "a", "", [charts.Panel("", "", "", [line], log_y=True)])
    texts = {e.text for e in ET.parse(tmp_path / "a").iter() if e.tag.endswith("text")}
    assert {"0.1", "10", "1000"} <= texts
