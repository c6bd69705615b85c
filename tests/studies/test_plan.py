"""The plan of a series: what it states, and what is wrong with it."""

from pathlib import Path

import pytest

from adhesion_cli.core.errors import UserError
from adhesion_cli.stops.series import Group, GroupLimit, Statistic, judge
from adhesion_cli.studies.brake_test import _find_unused_rules
from adhesion_cli.studies.plan import Plan, PlannedGroup, planned_logs, read_plan

PLAN = """
[group.old]
logs = ["old_*.csv"]
nominal_speed = 100
vehicle = "old.toml"
[group.new]
logs = ["new_1.csv"]
rail = "wet"
label = "sinter"
[compare]
pairs = [["old", "new"]]
[limits]
distance_m = {max = 300}
jerk = {min = 0.1, max = 4}
[wsp]
dry = "old"
wet = "new"
[protocol]
line = "depot"
"""


def test_a_plan_is_read(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(PLAN)
    plan = read_plan(path)
    old, new = plan.groups
    assert old == PlannedGroup("old", ("old_*.csv",), tmp_path / "old.toml", 100.0)
    assert (new.rail, new.label) == ("wet", "sinter")
    assert plan.pairs == (("old", "new"),)
    assert plan.limits == (GroupLimit("distance_m", 300, None), GroupLimit("jerk", 4, 0.1))
    assert (plan.wet_pairs, plan.protocol) == ((("old", "new"),), {"line": "depot"})
    assert plan.group_of(Path("runs/old_7.csv")) == old
    with pytest.raises(UserError, match="in no group"):
        plan.group_of(Path("other.csv"))
    twice = plan._replace(groups=(old, old._replace(name="again")))
    with pytest.raises(UserError, match="in the groups old and again"):
        twice.group_of(Path("old_1.csv"))
    for name in ("old_2.csv", "old_1.csv", "new_1.csv", "x.csv"):
        (tmp_path / name).touch()
    names = [p.name for p in planned_logs(plan)]
    assert names == ["old_1.csv", "old_2.csv", "new_1.csv"]


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no group"),
        ("[groups.a]\nlogs=['a']", "groups"),
        ("[group.a]\nlogs = []", "names no logs"),
        ("[group.a]\nlogs = ['a']\nspeed = 3", "speed"),
        ("[group.a]\nlogs = ['a']\nnominal_speed = 'x'", "nominal_speed = 'x' is no number"),
        ("[group.a]\nlogs = ['a']\nrail = 'icy'", "icy"),
        ("[group.a]\nlogs = ['a']\n[compare]\npairs = [['a', 'b']]", "'b'"),
        ("[group.a]\nlogs = ['a']\n[compare]\npairs = [['a']]", "no list of pairs"),
        (
            "[group.a]\nlogs = ['a']\n[compare]\npairs = [['a', 'a']]",
            "compares group 'a' with itself",
        ),
        ("[group.a]\nlogs = ['a']\n[compare]\na = 'a'", "key of [compare] 'a'"),
        ("[group.a]\nlogs = ['a']\n[limits]\nlength = {max = 3}", "length"),
        ("[group.a]\nlogs = ['a']\n[limits]\njerk = 3", "jerk = 3 is no limit"),
        ("[group.a]\nlogs = ['a']\n[limits]\nstandard = 'TSI'", "standard in"),
        ("[group.a]\nlogs = ['a']\n[limits]\nstandard = ['TSI']", "standard in"),
        ("[group.a]\nlogs = ['a']\n[limits]\njerk = {most = 3}", "is no limit"),
        ("[group.a]\nlogs = ['a']\n[wsp]\ndry = 'a'", "needs dry and wet"),
        ("[group.a]\nlogs = ['a']\n[wsp]\npairs = ['a']", "wsp.pairs = ['a'] is no list of pairs"),
        ("[group.a]\nlogs = ['a']\nlimits = 3", "limits = 3 is no table"),
    ],
)
def test_a_wrong_plan_says_what_and_where(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(text)
    with pytest.raises(UserError) as error:
        read_plan(path)
    assert said in error.value.text
    assert error.value.hint


def test_a_group_may_have_limits_and_a_plan_several_wet_groups(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(
        """
[group.dry]
logs = ["dry.csv"]
[group.soap]
logs = ["soap.csv"]
limits = {distance_m = {max = 400}}
[group.oil]
logs = ["oil.csv"]
[limits]
jerk = {max = 4}
[wsp]
pairs = [["dry", "soap"], ["dry", "oil"]]
"""
    )
    plan = read_plan(path)
    assert plan.wet_pairs == (("dry", "soap"), ("dry", "oil"))
    every_group, soap_alone = plan.limits
    assert every_group == GroupLimit("jerk", 4, None)
    assert soap_alone == GroupLimit("distance_m", 400, None, group="soap")


def test_a_group_without_a_log_is_an_error(tmp_path: Path) -> None:
    plan = Plan((PlannedGroup("a", ("none_*.csv",)),), folder=tmp_path)
    with pytest.raises(UserError, match="no log matches none_"):
        planned_logs(plan)


@pytest.mark.parametrize(("name", "response"), [("TSI LOC&PAS", 5.0), ("TSI LOC&PAS 250", 3.0)])
def test_the_limits_of_a_published_rule_are_known_by_its_name(
    tmp_path: Path, name: str, response: float
) -> None:
    path = tmp_path / "plan.toml"
    path.write_text(f'[group.a]\nlogs = ["a"]\n[limits]\nstandard = "{name}"\njerk = {{max = 3}}')
    *published, own = read_plan(path).limits
    assert {(x.quantity, x.highest, x.lowest) for x in published} == {
        ("response_time_s", response, None), ("delay_s", 2.0, None), ("jerk", 4.0, None),
        ("mean_deceleration", 2.5, None),
    }  # fmt: skip
    assert {x.source for x in published} == {"Regulation (EU) No 1302/2014"}
    assert own == GroupLimit("jerk", 3, None)


def test_tram_limits_go_by_the_speed_of_the_stops(tmp_path: Path) -> None:
    path = tmp_path / "plan.toml"
    path.write_text('[group.a]\nlogs = ["a"]\n[limits]\nstandard = "StrabVO"')
    plan = read_plan(path)

    def group(name: str, kmh: float, scatter: float = 0.0) -> Group:
        values = {"initial_speed_mps": kmh / 3.6, "mean_deceleration": 2.5}
        return Group(
            name,
            2,
            {
                k: Statistic(2, x, 0.0, 0.01, 0.0, scatter, (), None, None)
                for k, x in values.items()
            },
        )

    slow, fast, odd = group("slow", 40.9), group("fast", 69.0), group("odd", 80.0)
    mixed = group("mixed", 60.0, scatter=0.2)
    verdicts = judge([], [slow, fast, odd, mixed], plan.limits)
    assert [(x.group, x.limit, x.verdict) for x in verdicts] == [
        ("slow", 2.29, "pass"), ("fast", 2.73, "fail"),
    ]  # fmt: skip
    findings = [*_find_unused_rules([slow, odd, mixed], plan)]
    assert [(f.code, f.names["group"]) for f in findings] == [
        ("limit-not-applied", "odd"), ("limit-not-applied", "mixed"),
    ]  # fmt: skip
    assert findings[0].message == (
        "StrabVO (Austria), annex 1 has limits for 30, 40, 50, 60 and 70 km/h only: none is "
        "applied to group odd."
    )


def test_logs_of_a_plan_are_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    for name in ("run_10.csv", "run_9.csv", "run_9b.csv"):
        (tmp_path / name).touch()
    plan = Plan((PlannedGroup("all", ("run_*.csv",)),), folder=tmp_path)
    assert [p.name for p in planned_logs(plan)] == ["run_9.csv", "run_9b.csv", "run_10.csv"]
