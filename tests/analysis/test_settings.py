import ast
import re
import tomllib
from pathlib import Path
from string import Formatter

import pytest
from helpers.pasted import pasted
from hypothesis import example, given
from hypothesis import strategies as st

from adhesion_cli.analysis import settings
from adhesion_cli.cli.explain import entry
from adhesion_cli.core import estimator, toml
from adhesion_cli.core.errors import UserError
from adhesion_cli.core.finding import catalogue
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.studies.plan import read_plan

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(autouse=True)
def _elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def test_defaults_are_the_papers_vehicle() -> None:
    assert settings.load().vehicle == Vehicle()


def test_precedence_is_set_then_file_then_folder_then_base(tmp_path: Path) -> None:
    Path("adhesion.toml").write_text("[vehicle]\naxle_mass = 5000\nfriction = 0.2\n")
    base = {"vehicle": {"axle_mass": 6000.0, "wheelset_inertia": 100.0}}
    here = settings.load().over(base).vehicle
    assert (here.axle_mass.value, here.friction.value, here.wheelset_inertia.value) == (
        5000,
        0.2,
        100,
    )
    given = tmp_path / "given.toml"
    given.write_text("friction = 0.25\n")
    both = settings.load(given).vehicle  # what the file is silent on, the folder's says
    assert (both.axle_mass.value, both.friction.value) == (5000, 0.25)
    assert settings.load(given, ["vehicle.phi=0.28"]).vehicle.friction.value == 0.28


def test_of_several_files_the_later_one_counts(tmp_path: Path) -> None:
    first, second = tmp_path / "train.toml", tmp_path / "neso.toml"
    first.write_text("[vehicle]\naxle_mass = 5000\nfriction = 0.25\n")
    second.write_text("vehicle.friction = 0.3\n[neso]\nbeta1 = 50\n")
    both = settings.load([first, second])
    assert (both.vehicle.axle_mass.value, both.vehicle.friction.value) == (5000, 0.3)
    assert both.overrides["neso"]["beta1"] == 50.0
    assert settings.load([second, first]).vehicle.friction.value == 0.25


def test_what_is_stated_is_known_even_if_it_is_the_defaults_value(tmp_path: Path) -> None:
    given = tmp_path / "given.toml"
    given.write_text("[vehicle]\nwheel_diameter = 0.84\nm = 4797\n")
    stated = settings.load(given, ["vehicle.phi=0.28"]).over({"vehicle": {"discs": 2.0}}).stated
    assert stated == {"wheel_radius", "axle_mass", "friction"}


def test_a_value_without_tolerance_keeps_the_defaults_share() -> None:
    v = settings.load(assignments=["vehicle.friction=0.4"]).vehicle
    assert v.friction == Parameter(0.4, pytest.approx(0.04))
    v = settings.load(assignments=["vehicle.friction={value = 0.4, tolerance = 0.01}"]).vehicle
    assert v.friction == Parameter(0.4, 0.01)


def test_wheel_diameter_per_axle() -> None:
    v = settings.load(assignments=["vehicle.wheel_diameter=[0.84, 0.85]"]).vehicle
    assert [v.radius(n).value for n in (1, 2)] == [0.42, 0.425]


def test_estimator_parameters_come_from_the_registry() -> None:
    known = estimator.registry()
    s = settings.load(assignments=["neso.beta1=100"])
    assert s.params(known["neso"]).beta1 == 100.0
    assert s.params(known["leso"]) == known["leso"].Params()


def test_what_a_result_carries_loads_back() -> None:
    known = list(estimator.registry().values())
    s = settings.load(assignments=["vehicle.phi=0.28", "neso.beta1=100", "analysis.slowest=2"])
    again = settings.load().over(settings.tree(s, known))
    assert again.vehicle == s.vehicle
    assert again.analysis == s.analysis
    assert [again.params(e) for e in known] == [s.params(e) for e in known]


def test_channels() -> None:
    Path("c.toml").write_text(
        '[channels]\ntime = {channel = 1, unit = "s"}\ngroup = {channel = 2, equals = 5}\n'
        'pressure."axle 1" = {channel = "/brake/bc1", field = "value", unit = "bar"}\n'
        'speed."axle 2" = {channel = "w", unit = "count", teeth = 80}\ntrain_speed = "v"\n'
    )
    s = settings.load(Path("c.toml"))
    assert (s.read.time_channel, s.read.time_unit) == ("column 1", "s")
    assert (s.read.group_channel, s.read.group_equals) == ("column 2", "5")
    assert [(m.meaning, m.axle, m.channel) for m in s.mappings] == [
        ("pressure", 1, "/brake/bc1"), ("wheel_speed", 2, "w"), ("train_speed", None, "v"),
    ]  # fmt: skip
    assert s.mappings[1].teeth == 80


@pytest.mark.parametrize(
    ("assignment", "says"),
    [
        ("nesso.beta1=1", "neso"),
        ("neso.beta9=1", "beta1"),
        ("vehicle.frictoin=1", "friction"),
        ("vehicle.friction=7", "φ"),
        ("vehicle.friction='x'", "number"),
        ("neso.beta1", "--set neso.beta1=100"),
        ("channels.presure='x'", "pressure"),
        ("channels.pressure.left='x'", "axle1"),
        ("analysis.slowest=-1", "slip"),
        ("csv.header='no'", "true or false"),
        ("channels.time={source='sensor'}", "publish"),
        ("channels.speed={channel='x', teeth='many'}", "whole number"),
        ("channels.pressure={channel='x', unti='bar'}", "unit"),
        ("channels.pressure.bogie0='x'", "bogies count from 1"),
        ("channels.pressure.bogie1={channel='x', axles=[]}", "bogie1.axles=[1, 2]"),
        ("channels.pressure={bogie1='x', axle2='y'}", "axle 2 twice: 'bogie 1' and 'axle 2'"),
        ("channels.pressure.axle1.zero='x'", "number"),
        ("channels.pressure.axle1.zero={value=0.1, tolerance=-1}", "from 0"),
        ("channels.speed.axle1={channel='x', zero=1}", "channels.speed has a zero"),
        ("channels.pressure.delay=1", "channels.pressure has a delay"),
    ],
)
def test_a_mistake_is_an_error_that_names_the_remedy(assignment: str, says: str) -> None:
    with pytest.raises(UserError) as error:
        settings.load(assignments=[assignment])
    assert says in error.value.hint + error.value.text
    assert error.value.code == 2


def test_a_broken_file_is_named() -> None:
    Path("bad.toml").write_text("vehicle = [")
    with pytest.raises(UserError, match=r"bad\.toml"):
        settings.load(Path("bad.toml"))


def test_a_missing_file_has_the_nearest_one_as_its_hint(tmp_path: Path) -> None:
    def hint(path: Path) -> str:
        with pytest.raises(UserError, match="no such file") as error:
            settings.load(path)
        assert error.value.code == 2
        return error.value.hint

    for name in ("my-train", "fleet"):
        (tmp_path / f"{name}.toml").write_text("")
    assert str(tmp_path / "my-train.toml") in hint(tmp_path / "mytrain.toml")
    assert "fleet.toml, my-train.toml" in hint(tmp_path / "x.toml")
    assert repr(str(tmp_path / "none")) in hint(tmp_path / "none" / "my-train.toml")


def test_numbers_as_people_write_them() -> None:
    assert settings.load(assignments=["vehicle.phi=.35"]).vehicle.friction.value == 0.35
    assert settings.load(assignments=["vehicle.n=4."]).vehicle.discs.value == 4.0
    assert settings.load(assignments=["channels.group={channel='a'}", "channels.group.equals=007"])
    stated = settings.load(assignments=["channels.group.equals=007"]).read.group_equals
    assert stated == "007"  # a name


def test_flags_that_contradict_each_other_are_refused() -> None:
    with pytest.raises(UserError, match="wheel_radius is stated twice"):
        settings.load(assignments=["vehicle.wheel_diameter=0.9", "vehicle.wheel_radius=0.4"])
    v = settings.load(assignments=["vehicle.phi=0.2", "vehicle.phi=0.3"]).vehicle
    assert v.friction.value == 0.3  # the same flag again: the last one counts, as everywhere


def test_one_channel_for_all_axles_gives_way_to_one_per_axle() -> None:
    Path("adhesion.toml").write_text('[channels]\nspeed = {channel = "v", unit = "km/h"}\n')
    Path("c.toml").write_text('[channels]\nspeed."axle 2" = {channel = "w", unit = "rad/s"}\n')
    (m,) = settings.load(Path("c.toml")).mappings
    assert (m.axle, m.channel, m.unit) == (2, "w", "rad/s")


def test_thresholds_of_checks_are_settings() -> None:
    s = settings.load(assignments=["diagnostics.vehicle.sigmas=5"])
    assert s.checks["vehicle"].sigmas == 5.0
    assert s.checks["pressure_zero"] == settings.load().checks["pressure_zero"]
    again = settings.load().over(settings.tree(s, []))
    assert again.checks == s.checks
    with pytest.raises(UserError, match=r"diagnostics\.vehicel"):
        settings.load(assignments=["diagnostics.vehicel.sigmas=5"])
    with pytest.raises(UserError, match="sigmas"):
        settings.load(assignments=["diagnostics.vehicle.sigmas=0.1"])
    with pytest.raises(UserError, match="sigma"):
        settings.load(assignments=["diagnostics.vehicle.sigma=5"])


def test_thresholds_that_a_later_version_dropped_do_not_block_a_result() -> None:
    stated = {"former_check": {"share": 0.5}}
    name = next(iter(settings.Settings().checks))
    known = settings.Settings().checks[name]
    key = known._fields[0]
    stated[name] = {key: getattr(known, key), "former": 1.0}
    again = settings.load(folder=False).over({"diagnostics": stated})
    assert again.checks[name] == known


def test_a_unit_without_a_channel_is_one_for_all() -> None:
    Path("c.toml").write_text('[channels]\npressure = {unit = "bar"}\n')
    (m,) = settings.load(Path("c.toml")).mappings
    assert (m.meaning, m.axle, m.channel, m.unit) == ("pressure", None, "", "bar")
    (m,) = settings.load(Path("c.toml"), ['channels.pressure."axle 2" = {channel = "p"}']).mappings
    assert (m.axle, m.channel, m.unit) == (2, "p", "")


def test_a_bogie_serves_two_axles_or_those_that_it_states() -> None:
    lines = ["channels.pressure.bogie2='p'", "channels.speed={channel='v', axles=[1, 2]}"]
    lines += ["channels.pressure.bogie1={channel='q', axles=[1]}"]
    loaded = settings.load(assignments=lines)
    assert [(m.channel, m.axle) for m in loaded.mappings] == [
        ("p", 3), ("p", 4), ("q", 1), ("v", 1), ("v", 2),
    ]  # fmt: skip
    carried = {"channels": settings.tree(loaded, [])["channels"]}
    assert settings.load([carried]).mappings == loaded.mappings


def test_a_zero_is_added_to_what_other_lines_state_of_the_channel() -> None:
    Path("c.toml").write_text('channels.pressure = {unit = "bar", "axle 1" = {channel = "p"}}')
    loaded = settings.load(Path("c.toml"), ["channels.pressure.axle1.zero={value=1, tolerance=2}"])
    assert [(m.channel, m.unit, m.axle, m.zero) for m in loaded.mappings] == [
        ("", "bar", None, None), ("p", "", 1, Parameter(1.0, 2.0)),
    ]  # fmt: skip
    carried = {"channels": settings.tree(loaded, [])["channels"]}
    assert settings.load([carried]).mappings == loaded.mappings


@pytest.mark.parametrize(
    "line",
    [
        pytest.param("vehicle." + ".".join("a" * 100_000) + " = 1", id="dots"),
        pytest.param("vehicle." + ".".join("a" * 1_000) + " = 1", id="fewer dots"),
        pytest.param("vehicle = " + "[" * 1_000 + "]" * 1_000, id="deep"),
        pytest.param("vehicle = " + "[" * 300 + "]" * 300, id="less deep"),
        pytest.param("vehicle.friction = " + "9" * 5_000, id="digits"),
        pytest.param("vehicle.friction = " + "9" * 1_000, id="fewer digits"),
        "vehicle.friction = {value = 0.3, tolerance = inf}",
        "vehicle.friction = {value = 0.3, tolerance = 1e17}",
        "vehicle.friction = nan",
        "analysis.max_gap = inf",
        "analysis.max_gap = nan",
        "analysis.max_gap = 1e17",
        "analysis.max_gap = 1e308",
        "neso.beta1 = inf",
        "channels.speed = {channel = 'n', wrap = inf}",
    ],
)
def test_what_is_too_large_or_not_finite_is_refused_by_its_key(line: str) -> None:
    key = line.split("=")[0].strip().split(".")[0]
    Path("c.toml").write_text(line + "\n")
    for source in ({"config": Path("c.toml")}, {"assignments": [line]}):
        with pytest.raises(UserError, match=key) as error:
            settings.load(**source)
        assert error.value.code == 2
        assert len(error.value.text) < 200


def test_lists_that_nest_over_many_lines_are_refused() -> None:
    Path("c.toml").write_text("vehicle = " + "[\n" * 10_000)
    with pytest.raises(UserError, match="vehicle is nested deeper"):
        settings.load(Path("c.toml"))
    Path("c.toml").write_text("#\n" * 1_000_000)
    with pytest.raises(UserError, match="larger than 1 MiB"):
        settings.load(Path("c.toml"))


def test_every_setting_in_a_remedy_can_be_pasted() -> None:
    """In TOML quotes, or between backticks; fields in braces stand for a number or a key."""
    found = []
    for code, words in catalogue().items():
        fields = {name: 7 for _, name, _, _ in Formatter().parse(words.remedy) if name}
        fields |= {"key": "speed", "diameters": [0.9, 0.92]}
        for options in re.findall(r"`([^`]*--set [^`]+)`", words.remedy):
            stated = pasted(options.format(**fields))
            settings.load(assignments=stated, folder=False)
            found += [code] * len(stated)
            shown = entry(words)
            assert "{…}" not in str(shown["remedy"])
        assert words.remedy.count("--set") == found.count(code), code
        assert not re.search(r"\[(channels|vehicle)\]", words.remedy), code  # a line, not a place
    assert len(found) >= 35


def test_every_setting_in_a_page_can_be_pasted() -> None:
    """Lines of `--set` and blocks of TOML; those of a scenario or a plan are no settings."""
    lines, of_scenarios = 0, 0
    for page in (ROOT / "README.md", *(ROOT / "docs").rglob("*.md")):
        if page.name == "findings.md":  # remedies with "…" for what a finding states itself
            continue
        text = page.read_text(encoding="utf-8")
        assert "--set '" not in text  # cmd knows no single quotes
        for line in pasted(text):
            if not re.match(r"name=|\S*(NAME|CHECK)\b", line):
                settings.load(assignments=[line])
                lines += 1
        for block in re.findall(r"^```toml\n(.*?)^```$", text, re.M | re.S):
            if tomllib.loads(block).keys() <= {"rail"}:
                of_scenarios += 1
            elif "group" in tomllib.loads(block):
                Path("plan.toml").write_text(block)
                read_plan(Path("plan.toml"))
            else:
                Path("page.toml").write_text(block)
                settings.load(Path("page.toml"))
    assert lines >= 10
    assert of_scenarios == 1


def test_every_setting_in_a_hint_can_be_pasted() -> None:
    """Those of which the source states the whole line."""
    found = set()
    for path in (ROOT / "adhesion_cli").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                found |= {x for x in re.findall(r"`--set (\S+)`", node.value) if "{" not in x}
            elif isinstance(node, ast.Call) and ast.unparse(node.func) == "toml.option":
                for line in node.args:
                    assert "…" not in ast.unparse(line), path.name
                    found |= {line.value} if isinstance(line, ast.Constant) else set()
    assert len(found) >= 6
    for line in found:
        settings.load(assignments=[line])


@pytest.mark.parametrize(
    "wrong",
    [
        "channels.speed = {teeth = 80, wrap = 65536.0}",
        'channels.pressure.first = "p"',
        "vehicle.wheel_radius = []",
    ],
)
def test_the_line_in_the_hint_of_a_wrong_setting_is_accepted(wrong: str) -> None:
    with pytest.raises(UserError) as error:
        settings.load(assignments=[wrong])
    assert pasted(error.value.hint)
    settings.load(assignments=pasted(error.value.hint))


@given(name=st.text(st.characters(exclude_categories=["C"]), min_size=1, max_size=12))
@example(name="""driver's "valve" \\ 1""")
@example(name="1.50")
@example(name="true")
@example(name="nan")
@example(name=".5")
@example(name="2026-01-01")
def test_a_hint_states_any_name_and_needs_no_single_quotes(name: str) -> None:
    line = f"channels.group = {{channel = {toml.quoted(name)}, equals = '1'}}"
    option = toml.option(line)
    if "in adhesion.toml" in option:
        assert option == f"`{line}` in adhesion.toml"
    else:
        assert not set("'$\\!") & set(option)
        assert settings.load(assignments=pasted(option), folder=False).read.group_channel in (
            name,
            f"column {name}" * name.isdigit(),
        )


@pytest.mark.parametrize("word", settings.MARKS)
def test_a_mark_may_be_stated_in_a_word(word: str) -> None:
    mark = settings.load(assignments=[f"csv.delimiter={word}"], folder=False).read.delimiter
    assert mark == settings.MARKS[word]


def test_a_unit_is_added_to_a_channel_that_is_stated_by_its_name() -> None:
    Path("c.toml").write_text('channels.pressure = "my_p"\nchannels.speed."axle 1" = "v1"')
    stated = ["channels.pressure.unit=bar", "channels.speed.axle1.unit=km/h"]
    by_meaning = {m.meaning: m for m in settings.load(Path("c.toml"), stated).mappings}
    pressure, speed = by_meaning["pressure"], by_meaning["wheel_speed"]
    assert (pressure.channel, pressure.axle, pressure.unit) == ("my_p", None, "bar")
    assert (speed.channel, speed.axle, speed.unit) == ("v1", 1, "km/h")


def test_an_axle_needs_no_quotes() -> None:
    stated = ["channels.speed.axle2.channel=v2", "channels.speed.axle2.unit=km/h"]
    Path("c.toml").write_text('channels.speed."axle 2" = {channel = "other", teeth = 80}')
    (mapping,) = settings.load(Path("c.toml"), stated).mappings
    assert (mapping.channel, mapping.axle, mapping.unit, mapping.teeth) == ("v2", 2, "km/h", 80)
