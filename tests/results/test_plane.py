"""Places on a plane: equal lengths in all directions, and whole kilometres."""

import numpy as np
import pytest

from adhesion_cli.core.model import Column, Meaning
from adhesion_cli.records.route import NOWHERE, make_route
from adhesion_cli.results import plane
from adhesion_cli.results.plane import Plane, kilometre_posts


def test_a_plane_has_equal_kilometres_to_the_east_and_to_the_north() -> None:
    east, north = Plane(60.0, 10.0).at(np.array([[60.0, 10.0], [61.0, 11.0]]))
    assert (east[0], north[0]) == (0.0, 0.0)
    assert north[1] == pytest.approx(111.2, abs=0.1)
    assert east[1] == pytest.approx(55.6, abs=0.1)


@pytest.mark.parametrize(("start", "way", "names"), [
    (11_900.0, 3000.0, ["km 12", "km 13", "km 14"]),
    (14_500.0, -2000.0, ["km 14", "km 13"]),  # towards lower kilometres
])  # fmt: skip
def test_posts_stand_at_whole_kilometres(
    monkeypatch: pytest.MonkeyPatch, start: float, way: float, names: list[str]
) -> None:
    seconds = np.linspace(0.0, 150.0, 400)
    metres = start + way * seconds / 150.0
    t, usable = np.round(1e9 * seconds).astype(np.int64), np.ones(400, np.bool_)
    values: dict[Meaning, object] = {
        "position": metres, "latitude": 50.0 + metres / 1e5, "longitude": np.full(400, 8.6),
    }  # fmt: skip
    route = make_route({m: Column(t, x, usable) for m, x in values.items()})  # type: ignore[arg-type]
    found, places = kilometre_posts(route)
    assert found == names
    kilometres = np.array([float(x.removeprefix("km ")) for x in found])
    assert places[:, 0] == pytest.approx(50.0 + kilometres / 100.0, abs=1e-4)
    monkeypatch.setattr(plane, "_MOST_POSTS", 1)
    assert len(kilometre_posts(route)[0]) <= 1


def test_a_way_without_positions_has_no_posts() -> None:
    assert kilometre_posts(NOWHERE)[0] == []
