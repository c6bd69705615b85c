"""What `adhesion slip` shows: each word explained, no table of dashes, no slip above 100 %."""

import re

from adhesion_cli.cli.slip import table
from adhesion_cli.rail.events import Slide
from adhesion_cli.rail.rail_under_slides import Summary
from adhesion_cli.rail.slope import REGION_TITLES, REGIONS
from adhesion_cli.records.route import NOWHERE
from adhesion_cli.results.slip_text import note

SHARES = dict(zip(REGIONS, (0.1, 0.5, 0.3, 0.1), strict=True))


def slide(max_slip: float, energy: float | None) -> Slide:
    return Slide(slice(0, 9), 12_500_000_000, 4.0, 60.0, max_slip, energy, is_lower_bound=True)


SLID = Summary(2, SHARES, [slide(1.0, None), slide(0.15, 2e3)], None, None, None)
ROLLED = Summary(1, SHARES, [], None, None, None)


def test_every_region_is_explained_where_it_is_shown() -> None:
    lines = table([ROLLED], 0).splitlines()
    assert all(f"{region} [%]" in lines[0] for region in REGION_TITLES)
    assert all(
        any(re.match(f"  {region} +[a-zµ]", line) for line in lines) for region in REGION_TITLES
    )


def test_a_flat_part_far_beyond_the_peak_is_not_called_optimal() -> None:
    assert "optimal [%]" not in table([SLID], 0)
    assert "`optimal` in files" in table([SLID], 0)


def test_what_no_axle_has_is_no_table() -> None:
    assert "peak slip" not in table([ROLLED, SLID], 0)
    assert "Polach" not in table([ROLLED, SLID], 0)
    assert note(ROLLED, 0) == "no slide"


def test_a_locked_wheel_has_a_slip_of_100_percent() -> None:
    rows = table([SLID], 10_000_000_000).splitlines()[-2:]
    assert rows[0].split() == ["2", "2.50", "≥", "4.00", "≥", "60.0", "100", "-"]
    assert rows[1].split()[6:] == ["≥", "15.0", "≥", "2.0"]
    assert "2.50" in note(SLID, 10_000_000_000)


def test_the_clock_of_the_log_stands_beside_the_seconds() -> None:
    head, _, row, _ = table([SLID], 0, NOWHERE._replace(has_calendar=True)).splitlines()[-4:]
    assert "start [s]" in head
    assert "clock" in head
    assert "00:00:12" in row
    assert "clock" not in table([SLID], 0)


def test_of_many_slides_the_worst_are_shown_and_all_on_request() -> None:
    slides = [slide(0.1 + 0.001 * i, 1e3) for i in range(60)]
    many = SLID._replace(slides=slides)
    lines = table([many], 0).splitlines()
    first = next(i for i, line in enumerate(lines) if line.startswith("20 of 60 slides"))
    assert len(lines) == first + 3 + 20
    assert "15.9" in lines[first + 3]
    assert len(table([many], 0, all_rows=True).splitlines()) > 60
