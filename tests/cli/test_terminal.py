"""Tables on a terminal: nothing wider than it, nothing lost."""

from dataclasses import replace

import pytest
from helpers import made_results
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.cli.terminal import (
    findings,
    merge_zeros,
    scores,
    show,
    show_of_logs,
    table,
    wrote_sets,
)
from adhesion_cli.core import toml
from adhesion_cli.core.finding import Finding, catalogue
from adhesion_cli.core.model import Score
from adhesion_cli.core.summary import ChannelSummary
from adhesion_cli.results.vehicle_text import describe_motors

text = st.lists(st.text("abc_[]", min_size=1, max_size=30), max_size=6).map(" ".join)
figure = st.floats(-1e6, 1e6).map(lambda x: f"{x:.3f}")


@given(
    rows=st.lists(st.tuples(text, figure, figure, figure), min_size=1, max_size=4),
    names=st.tuples(*[st.sampled_from(["mass [kg]", "lag [s]", "a long name [N]"])] * 3),
    width=st.sampled_from([60, 80, 100]),
)
def test_a_table_fits_and_loses_nothing(rows, names, width):
    header = ["channel", *names]
    shown = table(header, rows, width=width)
    assert max(map(len, shown.splitlines())) <= max(width, 80)
    for row in rows:
        for cell in row[1:4]:
            assert cell in shown.split()
    known = [c for row in (header, *rows) for c in "".join(row)]
    assert all(shown.count(c) >= known.count(c) for c in set(known) - {" "})


def test_a_table_with_room_is_one_line_a_row():
    assert table(["axle", "lag [s]"], [["1", "0.12"], ["2", "-"]], width=80) == (
        "axle  lag [s]\n-------------\n1        0.12\n2           -"
    )


def test_the_table_of_scores_fits_80_columns():
    score = Score("gradient", "truth", 12345.0, -12345.0, -123456.0, -1.234, 1.234, 12.3, 12345.0)
    assert [len(line) for line in scores([("12", score)]).splitlines()] == [14, 80, 80, 80]


def test_what_looks_like_markup_is_text():
    assert "[red]:x:[/red]" in table(["a"], [["[red]:x:[/red]"]])


def test_findings_are_short_lines_grouped_by_severity():
    gap = {"values": {"longest_s": 3.0}, "spans": ((1.0, 4.0), (6.0, 9.0))}
    shown = findings(
        [
            *(Finding("standstill", "info", channel=f"axle {i}") for i in range(1, 9)),
            Finding("gap", "warning", channel="pressure " * 20 + "\x1b[31m", **gap),
        ],
        width=120,
    ).splitlines()
    assert [line for line in shown if not line.startswith("  ")] == [
        "warnings:", "notes:", "`adhesion explain CODE` shows cause, effect and remedy."
    ]  # fmt: skip
    assert max(map(len, shown)) <= 120
    assert "1.00–4.00 s and 1 more" in shown[1]
    assert "\x1b" not in shown[1]
    assert "axle 1, axle 2, axle 3 and 5 more" in shown[3]
    assert findings([]) == ""


def test_findings_that_differ_do_not_share_a_message():
    def shown(*gaps: float) -> list[str]:
        made = [Finding("gap", "info", channel=f"c{i}", values={"longest_s": g}) for i, g in gaps]
        return findings(made).splitlines()[1:-1]

    title = catalogue()["gap"].title
    assert len(shown(*enumerate([1.0, 1.0, 2.0, 3.0]))) == 3
    (line,) = shown(*enumerate([1.0, 2.0, 3.0, 4.0]))
    assert line.endswith(title)


def test_a_finding_is_folded_and_not_cut_off():
    values = {"factor": 0.91, "diameter_m": 0.85}
    spans = ((0.0, 31.98),) * 2
    names = {"reference": "the train"}
    found = Finding("wheel-diameter", "warning", "speed " * 9, 1, spans, values, names)
    for width in (80, 120):
        lines = findings([found], width).splitlines()
        assert max(map(len, lines)) <= width
        assert found.message in " ".join(line.strip() for line in lines)


def test_a_table_too_wide_for_the_terminal_has_narrower_gaps():
    row = ["1", *["-0.045±0.013"] * 5, "12.0±1.1"]
    header = ["axle", *(f"{c} [N]" for c in "abcdef")]
    assert max(map(len, table(header, [row], width=80).splitlines())) <= 80


def test_findings_of_logs_are_one_line_a_code_with_the_logs_that_have_it(capsys):
    common, alone = (Finding(code, "info", channel="axle 1") for code in ("standstill", "traction"))
    show_of_logs([("a.csv", [common]), ("b.csv", [common, alone]), ("c.csv", [common])], False)
    lines = capsys.readouterr().err.splitlines()
    codes = [line.split()[:4] for line in lines if line.startswith("  ") and line[2] != " "]
    assert codes[0] == ["standstill", "all", "3", "logs"]
    assert codes[1][:2] == ["traction", "b.csv"]
    assert len(codes) == 2


def test_forces_of_motors_are_named_where_the_log_has_them_and_force_is_known() -> None:
    channel = ChannelSummary("ED force [kN]", "", "ed_force", 1, "kN", "name")
    traction = replace(channel, meaning="traction_force")
    summary = summarise(made_results.result(1, 50), {})

    def text(*channels: ChannelSummary, known: bool = True) -> str:
        vehicle = replace(summary.vehicle, known=known)
        return describe_motors([replace(summary, vehicle=vehicle, channels=channels)])

    assert text(replace(channel, meaning="pressure")) == ""
    assert text(channel) == "Force and µ include the ED force of the log."
    assert text(channel, known=False) == ""
    assert "the ED force and the traction force of" in text(traction, channel)


def test_a_quiet_run_shows_what_sets_its_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    gap = {"longest_s": 2.0}
    of_log = [
        Finding("gap", "warning", values=gap),
        Finding("gap", "info", values=gap),
        Finding("no-position", "warning"),
    ]
    show(of_log, quiet=True)
    of_one = capsys.readouterr().err
    show_of_logs([("a.csv", of_log)], quiet=True)
    for text in (of_one, capsys.readouterr().err):
        assert text.count("  gap") == 1
        assert "notes:" not in text
        assert "no-position" not in text
    show(of_log[1:], quiet=True)
    assert not capsys.readouterr().err


def test_the_line_of_a_band_says_what_the_band_holds() -> None:
    rows = [
        (axle, Score("imm", target, 10.0, band_n=20.0, within=within))
        for axle, target, within in (("1", "truth", 0.9), ("2", "reference", 0.97))
    ]
    assert scores(rows).splitlines()[-2:] == [
        "imm: own 95 % band ± 20 N, holds the truth in 90 % of the samples",
        "imm: own 95 % band ± 20 N, holds the reference in 97 % of the samples",
    ]


def test_a_long_name_of_a_channel_keeps_its_axle_and_several_names_keep_the_first() -> None:
    names = "Pressione cilindro freno asse 2 [bar]", "Velocità asse 1, Velocità asse 2, GPS"
    values = {"coefficient": 9.0}
    shown = "".join(
        findings([Finding("coefficient-too-high", "warning", x, 1, (), values)]) for x in names
    )
    assert "o asse 2 [bar]" in shown
    assert "Velocità asse 1, Velocità" in shown
    assert "GPS" not in shown


def test_the_option_of_a_remedy_is_whole_below_its_warning(
    capsys: pytest.CaptureFixture[str],
) -> None:
    channel = "Rychlost nápravy 3 podle otáček nápravového čidla [km/h]"
    names = {"option": toml.option(f'channels.speed.axle3.channel = "{channel}"')}
    speed = {"reference": "the train speed"}
    values = {"scale": 0.278, "factor": 3.6}
    suspect = Finding("speed-unit-suspect", "warning", channel, values=values, names=speed | names)
    absolute = Finding("pressure-absolute", "warning", "p1", names={"unit": "bar", "use": "-"})
    unknown = Finding(
        "speed-unit-suspect", "warning", "v4", values=values, names=speed
    )  # says no option
    note = Finding(
        "date-order-guessed",
        "info",
        names={"example": "-", "taken": "-", "other": "-", "option": "`--set a=1`"},
    )
    lines = findings([suspect, absolute, unknown, note], 60).splitlines()
    assert f'      --set "channels.speed.axle3.channel={channel}"' in lines
    condition = "If the pressure is absolute, "
    assert f'      {condition}`--set "channels.pressure.unit=bar abs"`' in lines
    assert sum("--set" in line for line in lines) == 2
    by_log = [("a.csv", [suspect]), ("b.csv", [suspect])]
    show_of_logs(by_log, quiet=False)
    assert capsys.readouterr().err.count(names["option"].strip("`")) == 1


def test_names_of_logs_without_room_lose_their_middle_where_they_still_differ() -> None:
    names = ["26_03_provoz_suche_tam.csv", "26_04_provoz_suche_zpet.csv"]
    rows = [(str(k), name, "60 km/h", *["61.0±0.6"] * 7) for k, name in enumerate(names)]
    header = ["stop", "log", "group", *"abcdefg"]
    _, _, *lines = table(header, rows, text_columns=3, width=90).splitlines()
    assert len(lines) == 2
    for line, name in zip(lines, names, strict=True):
        start, _, end = line.split()[1].partition("…")
        assert len(start) >= 6
        assert name.startswith(start)
        assert name.endswith(end)
    alike = [(*row[:1], f"same_begin_{row[0]}_of_a_long_end.csv", *row[2:]) for row in rows]
    shown = table(header, alike, text_columns=3, width=90)
    assert "…" not in shown
    assert "".join(line.split()[1] for line in table(header, rows, 3, 200).splitlines()[2:]) == (
        "".join(names)
    )


def test_a_table_of_all_logs_is_written_where_it_says() -> None:
    sets = [["r/a.adhesion.mcap", "r/a.adhesion.rrd", "all.xlsx"], ["r/b.adhesion.mcap"]]
    assert wrote_sets(sets).splitlines() == [
        "wrote r/a.adhesion.mcap, .rrd, .sha256",
        "wrote r/b.adhesion.mcap, .sha256",
        "wrote all.xlsx",
    ]


def test_zeros_of_one_sensor_in_several_logs_are_one_option() -> None:
    pressure = "--set channels.pressure.axle{}.zero={}"
    options = [pressure.format(*x) for x in ((1, 0.25), (2, 0.1), (1, 0.27), (2, 0.3), (1, 0.25))]
    unlike = [pressure.format(2, 0.1), pressure.format(2, 0.3)]
    assert merge_zeros([*options, "--set a={b=1}"]) == [
        pressure.format(1, 0.26),
        *unlike,
        "--set a={b=1}",
    ]
