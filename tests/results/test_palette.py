"""One palette, whose colours in one picture differ for those who do not tell red from green."""

import re
from itertools import combinations
from pathlib import Path

import pytest
from helpers.colour_distance import DEFICIENT, distance
from helpers.made_results import result
from helpers.recordings import static

from adhesion_cli.core import estimator
from adhesion_cli.results import palette, report, rrd
from adhesion_cli.results.rrd import curve, parts
from adhesion_cli.wsp import controller

ESTIMATORS, CONTROLLERS = estimator.registry(), controller.registry()


def known(registry: object) -> list[str]:
    return [palette.of_method(name) for name in sorted(set(registry) & set(palette._METHODS))]  # type: ignore[call-overload]


def recorded(*colours: int) -> list[str]:
    """Colours as the viewer has them, with its ground."""
    return ["#101214", *(f"#{colour >> 8:06x}" for colour in colours)]


def of_states(*states: tuple[parts._State, ...]) -> list[str]:
    return recorded(*{colour for group in states for _, colour in group})


def marks() -> list[str]:
    css = (Path(report.__file__).parent / "page.css").read_text()
    return [re.findall(f"--{name}: (#......)", css)[0] for name in ("good", "slid", "unknown")]


PICTURES = {
    "forces in the viewer": [
        *recorded(parts.REFERENCE, parts.TRUTH), *known(ESTIMATORS)
    ],
    "errors on a page": [palette.WHITE, *known(ESTIMATORS)],
    "force on a page": [palette.WHITE, palette.BLACK, palette.GREEN],
    "axles on a page": [palette.WHITE, palette.BLACK, *map(palette.nth, range(8))],
    "axles in the viewer": [*recorded(parts.TRAIN), *map(palette.nth, range(8))],
    "speeds": recorded(parts.TRAIN, parts.WHEEL),
    "braking": recorded(parts.PRESSURE, parts.CLAMPING),
    "controllers": [*recorded(parts.TRAIN), *known(CONTROLLERS)],
    "states of an axle": of_states(parts.BRAKE, parts.REGION_STATES, parts.WHEELS),
    "valves": of_states(parts.VALVES),
    "slip-adhesion curve": recorded(
        curve._NOW_COLOUR, curve._PEAK_COLOUR, curve._FIT_COLOUR, parts.REGION_STATES[2][1]
    ),
    "marks": [palette.WHITE, *marks()],
}  # fmt: skip


@pytest.mark.parametrize("picture", PICTURES)
@pytest.mark.parametrize("kind", DEFICIENT)
def test_all_colours_of_a_picture_differ_for_everyone(kind: str, picture: str) -> None:
    for pair in combinations(dict.fromkeys(PICTURES[picture]), 2):
        assert distance(*pair, kind) >= 12.0, pair


def test_the_distance_is_the_published_one() -> None:
    """Values of colorspacious 1.1.2."""
    assert distance("#d55e00", "#e69f00", "deuteranope") == pytest.approx(15.2, abs=0.05)
    assert distance("#0072b2", "#cc79a7", "protanope") == pytest.approx(14.0, abs=0.05)


def test_every_method_has_its_own_colour() -> None:
    for registry in (ESTIMATORS, CONTROLLERS):
        colours = known(registry)
        assert len(set(colours)) == len(colours) >= 3
        assert not set(colours) & set(palette._FURTHER_COLOURS)  # of a new method, by its name
        assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in colours)
    assert palette.of_method("a new one") in palette._FURTHER_COLOURS


def test_the_viewer_has_the_colours_of_the_methods(tmp_path: Path) -> None:
    made = result(1, 50)
    rrd.write_results(tmp_path / "a.rrd", [made])
    names, colours = (
        static(tmp_path / "a.rrd", "/axle/1/force/estimates", of) for of in ("names", "colors")
    )
    assert [palette.rgba(palette.of_method(name)) for name in names[1:]] == colours[1:]
