"""Reports without a browser: what stands in the page, which samples are drawn, what is refused."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from bokeh.models import VArea
from helpers.pages import EVIL, Elements, analysed, figures, written

from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.annotated import as_json
from adhesion_cli.core.document import dumps, embedded, tagged
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import Finding, catalogue
from adhesion_cli.core.summary import (
    BrakeApplication,
    FindingSummary,
    MeanAndHighest,
    SlideSummary,
)
from adhesion_cli.results import mcap
from adhesion_cli.results.report import decimate, page, words
from adhesion_cli.results.report.plots import Figures
from adhesion_cli.results.report.run import ReportAxle, ReportRun, read


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> ReportRun:
    path = tmp_path_factory.mktemp("report") / "stop.adhesion.mcap"
    return read(written(path, analysed(axles=2, n=3000)))


@pytest.fixture(scope="module")
def text(run: ReportRun) -> str:
    return page.page([run])


def with_applications(
    axle: ReportAxle, *braked: BrakeApplication, number: int | None = None
) -> ReportAxle:
    """An axle with other brake applications, and another number."""
    number = number or axle.number
    return replace(axle, summary=axle.summary._replace(axle=number, applications=braked))


def test_a_result_is_read_as_it_was_written(run: ReportRun) -> None:
    made = analysed(axles=2, n=3000)
    assert [a.number for a in run.axles] == [1, 2]
    for axle, of in zip(run.axles, made.axles, strict=True):
        assert axle.t == pytest.approx(np.arange(3000) / 100.0, abs=1e-6)  # after the log's start
        most = float(np.nanmax(of.reference.sigma)) / 32.0  # a result is rounded by less
        np.testing.assert_allclose(axle.force, of.reference.force, atol=most)
        np.testing.assert_allclose(
            axle.upper - axle.force, of.reference.half_width, atol=2.0 * most
        )
        error = of.estimates["td"] - of.record.truth
        np.testing.assert_allclose(axle.errors["td"], error, atol=2.0 * most)
        assert axle.against == "truth"
        rolling = of.record.train_speed * (1.0 - axle.slip)
        known = np.isfinite(rolling) & (of.record.train_speed > 3.0)
        np.testing.assert_allclose(axle.rim[known], rolling[known], rtol=0.01)


def test_times_count_from_the_start_of_the_log_and_not_of_what_was_analysed(tmp_path: Path) -> None:
    made = analysed(axles=1, n=2000)
    (channel,) = made.log.channels
    early = replace(channel.data, t=channel.data.t - 5 * 10**9)
    log = replace(made.log, channels=(replace(channel, data=early),))
    run = read(written(tmp_path / "x.mcap", replace(made, log=log)))
    assert run.axles[0].t[0] == pytest.approx(5.0)
    (one,) = run.axles[0].applications
    (before,) = summarise(made, {}).axles[0].applications
    assert one.start_s == pytest.approx(before.start_s + 5.0)
    on = run.axles[0].t >= one.start_s
    assert run.axles[0].pressure[~on].max() < 2e4 < run.axles[0].pressure[on].max()


def test_the_same_result_gives_the_same_bytes(run: ReportRun, text: str) -> None:
    assert page.page([run]) == text  # Bokeh counts its models on
    assert not re.search(r'"p\d{4}"', json.dumps(figures(text)))


def test_nothing_is_loaded_from_anywhere(text: str) -> None:
    found = Elements(text)
    for tag, attributes in found.elements:
        assert tag not in ("link", "iframe", "img", "base")
        assert "src" not in attributes
        assert (attributes.get("href") or "#").startswith("#")
    style = next(t for t in found.texts if "color-scheme" in t)
    assert "url(" not in style
    assert "@import" not in style


def test_every_figure_has_its_place_and_shares_the_time(text: str) -> None:
    places = {a["id"] for tag, a in Elements(text).elements if a.get("class") == "figure"}
    of = figures(text)
    assert set(of["roots"].values()) == places  # type: ignore[attr-defined]
    assert len(places) == 2 + 2 * 5
    axes = [r["attributes"]["x_range"]["id"] for r in of["doc"]["roots"]]  # type: ignore[index]
    assert len(set(axes)) == 1 + 2  # of time, and of each curve over slip


def test_the_axle_that_slid_is_named_and_the_other_is_not(run: ReportRun) -> None:
    first, second = map(words.verdict, run.axles)
    assert (first.mark, second.mark) == ("good", "slid")
    assert words.headline(run) == ("slid", "Axle 2 slid in the brake application.")
    slid, rolled = run.axles[1].applications[0], run.axles[0].applications[0]

    def braked(*each: list[BrakeApplication]) -> str:
        axles = zip(run.axles, each, strict=True)
        own = (with_applications(a, *e) for a, e in axles)
        return words.headline(replace(run, axles=tuple(own)))[1]

    assert braked([rolled], [slid, rolled]) == "Axle 2 slid in 1 of 2 brake applications."
    assert braked([rolled], [slid, slid]) == "Axle 2 slid in 2 of 2 brake applications."
    said = braked([slid, rolled, slid], [slid, rolled, rolled])
    assert said == "Axles 1 and 2 slid in up to 2 of 3 brake applications."
    _, slides = words.brake_tables([run])
    assert [(row["axle"], row["slides"]) for row in slides.rows] == [("2", "1")]


def test_where_the_train_speed_is_missing_slides_are_not_denied(tmp_path: Path) -> None:
    made = analysed(axles=1, n=3000)
    (axle,) = made.axles
    assert axle.record.train_speed is not None
    lost = axle.record.train_speed.copy()
    lost[axle.applications[0].start + 100 : axle.applications[0].start + 300] = np.nan
    blind = replace(axle, record=replace(axle.record, train_speed=lost), events=())
    run = read(written(tmp_path / "x.mcap", replace(made, axles=(blind,))))
    assert words.headline(run)[0] == "unknown"
    assert words.verdict(run.axles[0]).mark == "unknown"
    assert "slides may be hidden" in words.brake_tables([run])[1].note


def test_without_slip_slides_are_not_denied(tmp_path: Path) -> None:
    made = analysed(axles=1, n=3000)
    (axle,) = made.axles
    blind = replace(axle, slip=None, record=replace(axle.record, train_speed=None))
    run = read(written(tmp_path / "x.mcap", replace(made, axles=(blind,))))
    assert words.headline(run)[0] == "unknown"
    assert "slides may be hidden" in words.brake_tables([run])[1].note


def test_a_mean_that_says_nothing_is_not_known(run: ReportRun) -> None:
    wide = MeanAndHighest(0.11, 0.27, None, 0.27)
    unsure = replace(run.axles[0].applications[0], coefficient=wide, other_brake=True)
    axle = with_applications(run.axles[0], unsure)
    ((row,), *_) = (x.rows for x in words.brake_tables([replace(run, axles=(axle,))]))
    assert row["µ mean"] == row["F [kN]"] == "not known"
    assert words.verdict(axle).adhesion == "not known"


def test_words_of_a_log_never_become_markup(tmp_path: Path) -> None:
    made = analysed(axles=1, n=1000, name=f"{EVIL}.csv".replace("/", "∕"))
    (channel,) = made.log.channels
    evil = replace(channel, name=EVIL, field="\x1b[2J\u202e", unit=EVIL, reason=EVIL, label=EVIL)
    told = Finding("csv-bad-cells", "warning", EVIL, values={"line": 3}, names={"example": EVIL})
    log = replace(made.log, channels=(evil,), findings=(told,), format=EVIL, sha256=EVIL)
    settings = {**made.settings, "csv": {EVIL: EVIL}}
    result = replace(made, log=log, findings=(told,), settings=settings, sources=(EVIL,))
    text = page.page([read(written(tmp_path / "x.mcap", result))])
    found = Elements(text)
    assert {tag for tag, _ in found.elements}.isdisjoint({"img", "b!", "object"})
    assert not [a for _, a in found.elements if any(name.startswith("on") for name in a)]
    assert sum(tag == "script" for tag, _ in found.elements) == 3
    assert "\x1b" not in text
    assert "\u202e" not in text
    assert "onerror" not in json.dumps(figures(text))  # Bokeh would read "$$" in a label as TeX
    assert any(EVIL in t for t in found.texts)  # it is there, as text


def test_findings_stand_with_their_explanation(run: ReportRun, text: str) -> None:
    (told,) = [of for of in words.finding_groups(run.summary.findings) if of.code == "gap"]
    assert told.severity == "warning"
    assert {name for name, _ in told.sections} >= {"Cause", "Effect on the result", "What to do"}
    assert told.lines[0]["Channel"] == "speed 2"
    links = {a.get("href") for tag, a in Elements(text).elements if tag == "a"}
    assert "#finding-gap" in links  # on the first screen, as it is a warning
    assert "#finding-no-application" not in links


def test_a_number_stays_on_the_line_of_its_signs() -> None:
    assert page._prose("µ ± 14 % of `F`") == "µ\xa0±\xa014\xa0% of <code>F</code>"


def test_the_findings_of_several_logs_name_them(run: ReportRun) -> None:
    (gap,) = [f for f in run.summary.findings if f.code == "gap"]
    other = replace(gap, channel="speed 9")
    pairs = [("a.csv", gap), ("b.csv", gap), ("b.csv", other)]
    (group,) = words.finding_groups_of_logs(pairs)
    assert [(line["Log"], line["Channel"]) for line in group.lines] == [
        ("a.csv, b.csv", gap.channel), ("b.csv", "speed 9"),
    ]  # fmt: skip
    assert words.summary_line(group).startswith("a.csv and b.csv, ")


def test_the_first_screen_says_where_a_warning_is(run: ReportRun) -> None:
    def said(*findings: FindingSummary) -> str:
        return "".join(map(words.summary_line, words.finding_groups(findings)))

    (gap,) = [f for f in run.summary.findings if f.code == "gap"]
    one = said(replace(gap, channel="speed 2", spans=((60.0, 67.5),)))
    assert "speed 2" in one
    assert "60.00–67.50 s" in one
    many = said(*(replace(gap, channel=f"a long name of channel {i}") for i in range(40)))
    assert "a long name of channel 0" in many
    assert len(many) < 400


def test_a_page_without_a_brake_application_points_to_the_reason(run: ReportRun) -> None:
    axles = tuple(map(with_applications, run.axles))
    none = words.headline(replace(run, axles=axles))
    finding = Finding("pressure-below-spring", "warning", "p").code
    told = replace(run.summary.findings[0], code=finding, severity="warning")
    why = words.headline(replace(run, axles=axles, summary=replace(run.summary, findings=[told])))
    assert none[0] == why[0] == "unknown"
    assert why[1] != none[1]
    assert catalogue()[finding].title in why[1]


def test_a_speed_that_the_log_does_not_have_is_not_called_that_of_the_train(run: ReportRun) -> None:
    made = replace(run.summary.findings[0], code="reference-speed", severity="info")
    labels = []
    for of in (run, replace(run, summary=replace(run.summary, findings=[made]))):
        drawn = Figures()
        shown = drawn.of_run(of)
        every = drawn.figures_of([*shown.overview, *shown.axles[1]])
        items = [i for fig in every for legend in fig.legend for i in legend.items]
        labels.append({i.label.value for i in items})
    assert "train" in labels[0]
    assert "train" not in labels[1]


def test_the_picture_keeps_every_extreme_and_every_sample_of_a_slide() -> None:
    rng = np.random.default_rng(1)
    n, most = 200_000, 4000
    t = np.arange(n) * 0.01
    columns = [rng.normal(0, 1, n), np.sin(t)]
    columns[0][123_456] = 40.0  # one sample
    columns[1][777] = -9.0
    slide, braked = (1000.0, 1005.0), (990.0, 1040.0)
    kept = decimate.rows(t, columns, [[slide], [braked]], most)
    assert len(kept) <= 1.1 * most
    assert {123_456, 777, 0, n - 1} <= set(kept.tolist())
    assert (np.diff(kept) > 0).all()
    whole = np.flatnonzero((t >= slide[0]) & (t <= slide[1]))
    assert set(whole.tolist()) <= set(kept.tolist())
    inside = ((t[kept] >= braked[0]) & (t[kept] <= braked[1])).sum()
    assert inside > 0.4 * most  # of 50 s in 2000
    for column in columns:  # of equal parts of the brake application
        for part in np.array_split(np.arange(99_000, 104_000), 20):
            mine = kept[(kept >= part[0]) & (kept <= part[-1])]
            assert column[mine].max() > np.quantile(column[part], 0.99)


def test_a_short_log_is_drawn_in_full() -> None:
    t = np.arange(500) * 0.01
    assert len(decimate.rows(t, [t], [], 4000)) == 500


def test_what_is_not_known_has_no_empty_picture(run: ReportRun) -> None:
    def blank(x: np.ndarray) -> np.ndarray:
        return np.full(len(x), np.nan)

    axles = tuple(
        replace(
            axle, force=blank(axle.force), lower=blank(axle.lower), upper=blank(axle.upper),
            truth=blank(axle.truth), errors={k: blank(x) for k, x in axle.errors.items()},
        )
        for axle in run.axles
    )  # fmt: skip
    drawn = Figures().of_run(replace(run, axles=axles))
    assert drawn.overview == ["overview-speed"]
    assert {n: len(places) for n, places in drawn.axles.items()} == dict.fromkeys(drawn.axles, 2)


def test_a_line_is_broken_at_a_gap_and_where_time_was_set_back() -> None:
    t = np.concatenate([np.arange(100) * 0.01, 5.0 + np.arange(100) * 0.01, np.arange(50) * 0.01])
    kept = decimate.with_gaps(t, np.arange(len(t)))
    assert np.flatnonzero(kept < 0).tolist() == [100, 201]


def test_the_band_has_no_height_where_nothing_is_known(run: ReportRun) -> None:
    (axle, *_) = run.axles
    force, lower, upper = (np.full(3000, x) for x in (5e3, 4e3, 6e3))
    unknown = (slice(700, 1200), slice(1300, 1301), slice(2000, 2900))
    for column in (force, lower, upper):
        for span in unknown:
            column[span] = np.nan
    gap = axle.t + np.where(np.arange(3000) >= 1600, 20.0, 0.0)
    of = replace(axle, t=gap, force=force, lower=lower, upper=upper)
    drawn = Figures()
    places = drawn.of_run(replace(run, axles=(of,))).axles[axle.number]
    (area,) = [
        r for fig in drawn.figures_of(places) for r in fig.renderers if isinstance(r.glyph, VArea)
    ]  # fmt: skip
    t, low, high = (np.asarray(area.data_source.data[k], float) for k in ("t", "lower", "upper"))
    known = np.isfinite(low)  # Bokeh's area goes past the others
    assert (known == np.isfinite(high)).all()

    def height(at: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.interp(at, t[known], (high - low)[known])
        return found

    for span in unknown:
        assert height(gap[span]).max() < 1e-6
    assert height(np.linspace(gap[1599] + 0.1, gap[1600] - 0.1, 9)).max() < 1e-6
    inside = np.setdiff1d(np.arange(3000), np.concatenate([np.r_[s] for s in unknown]))
    assert np.median(height(gap[inside])) == pytest.approx(2.0)


def test_of_a_recording_the_result_is_named() -> None:
    with pytest.raises(UserError) as refused:
        read(Path("a stop.adhesion.rrd"))
    assert '"a stop.adhesion.mcap"' in refused.value.hint


@pytest.mark.parametrize("kind", ["log", "comparison", "older", "damaged"])
def test_what_is_no_result_is_refused_with_the_remedy(kind: str, tmp_path: Path) -> None:
    made, path = analysed(axles=1, n=500), tmp_path / "x.mcap"
    if kind == "log":
        mcap.write_log(path, made.log)
    elif kind == "comparison":
        mcap.write_results(path, [made, made], embedded([summarise(made, {})]))
    elif kind == "older":
        of = as_json(summarise(made, {}))
        for axle in of["axles"]:
            axle["applications"] = [{"start_s": 0.0}]
        mcap.write_results(path, [made], dumps(tagged("result", results=[of])))
    else:
        written(path, made)
        path.write_bytes(path.read_bytes()[:-3000])
    with pytest.raises(UserError) as refused:
        read(path)
    assert str(path) in refused.value.text
    assert refused.value.hint
    if kind in ("log", "older"):
        assert "adhesion analyze" in refused.value.hint


def test_a_day_of_brake_applications_has_room(run: ReportRun) -> None:
    """Thousands of rows: those with slides stay in the table, whenever they were."""
    calm, slid = run.axles
    (one,) = calm.applications
    many = [replace(one, start_s=10.0 * i, end_s=10.0 * i + 5.0) for i in range(3000)]
    last = replace(slid.applications[0], start_s=40_000.0, end_s=40_010.0)
    day = with_applications(calm, *many, last)
    text = page.page([replace(run, axles=(day, slid))])
    assert len(text) < 3_000_000
    assert any("40000.0" in t for t in Elements(text).texts)
    rows = [tag for tag, _ in Elements(text).elements].count("tr")
    assert 500 < rows < 1000


@pytest.mark.slow
def test_an_hour_of_four_axles_has_room(run: ReportRun) -> None:
    """Numbers of pure noise, which nothing can pack, with sixty brake applications."""
    rng, n = np.random.default_rng(3), 360_000
    (one,) = run.axles[1].applications
    braked = [
        replace(
            one,
            start_s=s,
            end_s=s + 30.0,
            slide_list=(SlideSummary(s + 5.0, 4.0, 80.0, 0.2, None, False),),
        )
        for s in np.arange(10.0, 3600.0, 60.0).tolist()
    ]
    names = ("train", "rim", "pressure", "clamping", "force", "lower", "upper", "slip", "truth")
    axles = tuple(
        replace(
            with_applications(run.axles[1], *braked, number=k),
            t=np.arange(n) * 0.01, errors={a: rng.normal(size=n) for a in "abcdef"},
            **{name: rng.normal(size=n) for name in names},
        )
        for k in range(1, 5)
    )  # fmt: skip
    text = page.page([replace(run, axles=axles)])
    assert 1_500_000 < len(text) < 3_000_000
