"""One colour per method, wherever it is drawn."""

import re
from pathlib import Path

from helpers.made_results import result
from helpers.recordings import static

from adhesion_cli.core import estimator
from adhesion_cli.results import palette, rrd
from adhesion_cli.studies.response import Response, panels
from adhesion_cli.wsp import controller


def test_every_method_has_its_own_colour() -> None:
    for registry in (estimator.registry(), controller.registry()):
        colours = [palette.of_method(name) for name in set(registry) & set(palette._METHODS)]
        assert len(set(colours)) == len(colours) >= 3
        assert not set(colours) & set(palette._FURTHER_COLOURS)  # of a new method, by its name
        assert all(re.fullmatch("#[0-9a-f]{6}", colour) for colour in colours)
    assert palette.of_method("a new one") in palette._FURTHER_COLOURS


def test_figures_and_viewer_agree(tmp_path: Path) -> None:
    made = result(1, 50)
    rrd.write_result(tmp_path / "a.rrd", made)
    names, colours = (
        static(tmp_path / "a.rrd", "/axle/1/force/estimates", of) for of in ("names", "colors")
    )
    t = made.axles[0].reference.force
    (gain, *_) = panels([Response(name, None, t, t, t, t) for name in names[1:]])
    drawn = [palette.rgba(line.colour) for line in gain.lines]
    assert drawn == colours[1:]
