"""Reports in a real browser: figures are drawn and linked, paper and dark screens look right."""

import base64
import io
import re
import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from helpers import browser
from helpers.browser import Tab
from helpers.pages import analysed, written
from PIL import Image

from adhesion_cli.core.summary import Measured, StopSummary
from adhesion_cli.results.report import page
from adhesion_cli.results.report.campaign import Bar, Bars, Campaign
from adhesion_cli.results.report.protocol import Protocol
from adhesion_cli.results.report.run import read
from adhesion_cli.results.text_tables import TitledTable
from adhesion_cli.stops.series import SeriesStop, StopSeries

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(browser.PROGRAM is None, reason="no Chromium on this computer"),
]
_CANVASES = """(() => {
  const found = [];
  const walk = (node) => {
    if (node.shadowRoot) walk(node.shadowRoot);
    for (const child of node.children ?? []) walk(child);
    if (node.tagName === "CANVAS") found.push(node);
  };
  walk(document.body);
  return found.map((canvas) => {
    if (!canvas.width || !canvas.height) return 0;
    const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const colours = new Set();
    for (let i = 0; i < data.length; i += 4)
      if (data[i + 3] > 0) colours.add((data[i] << 16) | (data[i + 1] << 8) | data[i + 2]);
    return colours.size;
  });
})()"""


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A page of one run, and one of two."""
    folder = tmp_path_factory.mktemp("pages")
    runs = [
        read(written(folder / f"{n}.mcap", analysed(axles=2, n=n, name=f"<b>{n}.csv")))
        for n in (3000, 4000)
    ]
    paths = folder / "one.html", folder / "two.html"
    paths[0].write_text(page.page(runs[:1]), "utf-8")
    paths[1].write_text(page.page(runs), "utf-8")
    return paths


@pytest.fixture
def tab(tmp_path: Path) -> Iterator[Tab]:
    with browser.tab(tmp_path / "profile") as found:
        found.call("Emulation.setDeviceMetricsOverride", width=1280, height=900,
                   deviceScaleFactor=1, mobile=False)  # fmt: skip
        yield found


def picture(tab: Tab) -> np.ndarray:
    """What the page looks like at its top, (height, width, 3)."""
    shot = base64.b64decode(tab.call("Page.captureScreenshot", format="png")["data"])
    return np.asarray(Image.open(io.BytesIO(shot)).convert("RGB"))


@pytest.mark.parametrize("which", [0, 1])
def test_every_figure_is_drawn_without_an_error_and_without_a_network(
    tab: Tab, reports: tuple[Path, Path], which: int
) -> None:
    tab.open(reports[which])
    figures = tab.value("document.querySelectorAll('.figure').length")
    drawn = [colours for colours in tab.value(_CANVASES) if colours > 3]
    assert len(drawn) >= figures >= 4
    assert tab.faults() == []
    assert tab.requested() <= {"file", "data", "blob"}


def test_the_figures_of_a_fleet_are_drawn(tab: Tab, tmp_path: Path) -> None:
    day = 86_400_000.0
    bars = [Bar(str(i), i * day, (i + 1) * day, 0.05, 0.1, 0.15, 0.04, 3) for i in range(4)]
    figures = Bars("speed", bars), Bars("day", bars, dated=True), Bars("by", bars, named=True)
    tables = [TitledTable(of.label, [{"a": "b"}], figure=of) for of in figures]
    path = tmp_path / "fleet.html"
    path.write_text(page.campaign_page(Campaign("fleet", "three figures", "", tables)), "utf-8")
    tab.open(path)
    assert len([colours for colours in tab.value(_CANVASES) if colours > 3]) >= 3
    assert tab.faults() == []
    assert tab.requested() <= {"file", "data", "blob"}


def test_a_time_that_is_enlarged_in_one_figure_is_enlarged_in_all(
    tab: Tab, reports: tuple[Path, Path]
) -> None:
    tab.open(reports[0])
    ranges = "Bokeh.documents[0].roots().map((f) => [f.x_range.start, f.x_range.end])"
    before = tab.value(ranges)
    where = "document.getElementById('axle-2-2')"
    tab.value(f"{where}.scrollIntoView({{block: 'center'}})")
    box = tab.value(f"(({{x, y, width, height}}) => [x, y, width, height])"
                    f"({where}.getBoundingClientRect())")  # fmt: skip
    x, y, width, height = box
    for kind, share in (("mousePressed", 0.4), ("mouseMoved", 0.5), ("mouseReleased", 0.6)):
        tab.call("Input.dispatchMouseEvent", type=kind, x=x + share * width, y=y + height / 2,
                 button="left", buttons=1, clickCount=1)  # fmt: skip
    tab.until(f"{ranges}[0][0] > {before[0][0] + 1.0}", 20.0)
    after = [r for r, old in zip(tab.value(ranges), before, strict=True) if old == before[0]]
    assert len(after) == 2 + 2 * 4  # all over time, and not those over slip
    assert len({tuple(r) for r in after}) == 1
    assert after[0][1] - after[0][0] == pytest.approx(0.2 * (before[0][1] - before[0][0]), rel=0.3)
    assert tab.faults() == []


def test_it_is_dark_where_the_screen_is_and_light_on_paper(
    tab: Tab, reports: tuple[Path, Path], tmp_path: Path
) -> None:
    tab.open(reports[0])
    light = picture(tab)
    dark = [{"name": "prefers-color-scheme", "value": "dark"}]
    tab.call("Emulation.setEmulatedMedia", features=dark)
    tab.value("document.getElementById('overview-speed').scrollIntoView({block: 'start'})")
    shown = picture(tab)
    assert np.median(light) > 240
    assert np.median(shown) < 40
    assert np.mean(shown[:150] > 200) < 0.1  # the figures, too
    data = tab.call("Page.printToPDF", preferCSSPageSize=True, printBackground=True)["data"]
    printed = tmp_path / "report.pdf"
    printed.write_bytes(base64.b64decode(data))
    sizes = re.findall(rb"/MediaBox\s*\[\s*0 0 ([\d.]+) ([\d.]+)", printed.read_bytes())
    assert 4 <= len(sizes) <= 12
    for width, height in sizes:  # A4 in points
        assert (float(width), float(height)) == pytest.approx((595.0, 842.0), abs=1.5)
    if shutil.which("pdftoppm"):
        subprocess.run(["pdftoppm", "-r", "40", "-png", printed, tmp_path / "p"], check=True)
        for path in sorted(tmp_path.glob("p-*.png")):
            sheet = np.asarray(Image.open(path).convert("RGB"))
            assert np.median(sheet) > 250
            ink = np.flatnonzero((sheet < 200).any(axis=(0, 2))) / sheet.shape[1]
            assert ink.min() > 0.03  # nothing is cut at an edge
            assert ink.max() < 0.97
            assert ink.max() > 0.6 or path == sorted(tmp_path.glob("p-*.png"))[-1]


@pytest.mark.parametrize(("width", "media"), [(1280, "screen"), (1000, "screen"), (703, "print")])
def test_the_stops_of_a_protocol_fit_screen_and_a4(
    tab: Tab, tmp_path: Path, width: int, media: str
) -> None:
    value = {"value": 1234.5678, "u95": 12.3}
    quantities = {
        name: Measured(**value)
        for name in (
            "initial_speed_mps", "distance_m", "duration_s", "delay_s", "response_time_s",
            "mean_deceleration", "equivalent_deceleration", "jerk", "corrected_distance_m",
            "coefficient",
        )
    } | {"ed_share": Measured(0.5678, 0.0123)}  # fmt: skip
    stop = StopSummary(
        start_s=1234.5, end_s=1290.0, command_from="channel", speed_from="train",
        nominal_speed_kmh=80.0, valid=True, time="2026-03-01T08:00:00Z", position_m=12345.0,
        position_from="position", pressure_bar=3.6, **quantities,
    )  # fmt: skip
    short = replace(
        stop, time=None, position_m=None, equivalent_deceleration=None, pressure_bar=None
    )
    for fewer in (
        stop,
        short,
        replace(short, response_time_s=None),
        replace(short, response_time_s=None, jerk=None),
    ):
        of = (
            SeriesStop(f"2026-03-01_run_{i}_car_7.csv", "wet 100 km/h", None, fewer)
            for i in range(3)
        )
        series = StopSeries(tuple(of), (), (), (), ())
        path = tmp_path / "stops.html"
        path.write_text(page.protocol_page(Protocol("stops", {}, series, [], {})), "utf-8")
        tab.call("Emulation.setDeviceMetricsOverride", width=width, height=800,
                 deviceScaleFactor=1, mobile=False)  # fmt: skip
        tab.call("Emulation.setEmulatedMedia", media=media)
        tab.open(path)
        widths = "[...document.querySelectorAll('.table')].map(x => x.scrollWidth - x.clientWidth)"
        assert max(tab.value(widths)) <= 0


def test_a_narrow_screen_needs_no_sideways_scrolling(tab: Tab, reports: tuple[Path, Path]) -> None:
    tab.call("Emulation.setDeviceMetricsOverride", width=400, height=800,
             deviceScaleFactor=1, mobile=True)  # fmt: skip
    for path in reports:
        tab.open(path)
        assert tab.value("document.documentElement.scrollWidth") <= 400
