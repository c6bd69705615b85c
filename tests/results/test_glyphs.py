"""No text of a recording has a letter that ends the native viewer."""

import re
from dataclasses import replace
from pathlib import Path

from helpers.made_results import result

from adhesion_cli.core.finding import Finding
from adhesion_cli.results import rrd
from adhesion_cli.results.rrd.glyphs import drawable, drawable_names


def test_latin_greek_cyrillic_and_our_signs_stay() -> None:
    text = "Geschwindigkeit größer µ ω̇ ± ≥ ≈ – · km/h ■ скорость ταχύτητα F̂₁ m/s²"
    assert drawable(text) == text


def test_names_stay_different() -> None:
    names = drawable_names(
        ["1架制动缸压力（bar）", "2架制动缸压力（bar）", "制动.csv", "列车管.csv"]
    )
    assert names == ["1…(bar)", "2…(bar)", "log.csv", "log.csv (2)"]


def test_a_recording_of_chinese_names_has_only_letters_of_the_viewer(tmp_path: Path) -> None:
    made = [result(1, 200, name=name) for name in ("制动试验.csv", "第二次.csv")]
    values = {"longest_s": 1.0, "limit_s": 2.0}
    finding = Finding("gap", "warning", "1轴速度", spans=((0.5, 0.6),), values=values)
    made = [replace(x, findings=(*x.findings, finding)) for x in made]
    rrd.write_results(tmp_path / "a.rrd", [made[0]])
    rrd.write_results(tmp_path / "b.rrd", made)
    for path in (tmp_path / "a.rrd", tmp_path / "b.rrd"):
        text = path.read_bytes().decode("utf-8", "ignore")
        assert not re.search("[制动试验第二次轴速度]{2}", text)
