"""What the slides of a log show, as rows of text: for the screen and for a recording."""

from collections.abc import Sequence

from ..rail.events import Slide
from ..rail.fit import RailFit
from ..rail.rail_under_slides import Summary
from ..records.route import NOWHERE, Route
from . import text_tables
from .text_tables import bounded_number, number, when_and_where

OF_CURVE = (
    "Constants of Polach's creep law, or of the law nearest to it. The peak's interval also holds "
    "for other laws (docs/explanation/slip.md)."
)
_CONSTANTS = {"f0": "f0", "A": "A", "B [s/m]": "B", "kA": "k_a", "kS": "k_s"}


def note(summary: Summary, start_ns: int, route: Route = NOWHERE) -> str:
    """What a recording says of an axle: as `table`, without regions."""
    width, rail = text_tables.NARROW, summary.rail
    values = [*rail_row(rail).items(), *constants([rail])] if rail else []
    blocks = [text_tables.table(["axle", str(summary.axle)], values, width=width)] if rail else []
    blocks += [text_tables.folded(OF_CURVE, width=width)] if rail else []
    if slides := slide_rows([summary], start_ns, route):
        blocks.append(text_tables.records(slides, width))
    return "\n".join(blocks) or "no slide"


def _spread(x: tuple[float, float, float] | None, digits: int, factor: float = 1.0) -> str:
    if x is None:
        return "-"
    value, lower, upper = (number(factor * v, digits) for v in x)
    return f"{value} ({lower}–{upper})"


def rail_row(rail: RailFit) -> dict[str, str]:
    """What the slides show of the curve's peak, and a dash for what they do not."""
    peak = _spread(rail.peak_slip, 2, 100.0)
    if rail.peak_slip_limit and not rail.peak_slip:
        peak = f"below {number(100.0 * rail.peak_slip_limit, 2)}"
    return {
        "peak slip [%]": peak,
        "peak µ": _spread(rail.peak_mu, 3),
        "speed [km/h]": number(3.6 * rail.speed if rail.peak_slip_limit else None, 1),
        "utilisation": _spread(rail.utilisation, 3),
    }


def constants(rails: Sequence[RailFit]) -> list[list[str]]:
    """A row for each constant that is known of some rail."""
    return [
        [label, *(_spread(rail.constants.get(name), 3) for rail in rails)]
        for label, name in _CONSTANTS.items()
        if any(name in rail.constants for rail in rails)
    ]


def slide_rows(
    summaries: Sequence[Summary], start_ns: int, route: Route = NOWHERE
) -> list[dict[str, str]]:
    """A row for each slide, with its own rail where an axle slid at several places."""
    pairs = [(s, slide) for s in summaries for slide in s.slides]
    if all(len(s.places) < 2 for s in summaries):
        return [slide_row(s.axle, slide, start_ns, route) for s, slide in pairs]
    rows = []
    for s, slide in pairs:
        place = s.place_of(slide)
        rail = place.rail if place else None
        used_share = rail.utilisation if rail else None
        own = {
            "µ": number(rail.mean_mu if rail else None, 3),
            "peak µ": _spread(rail.peak_mu if rail else None, 3),
            "used [%]": number(used_share and 100.0 * used_share.value),
        }
        rows.append(slide_row(s.axle, slide, start_ns, route) | own)
    return rows


def slide_row(axle: int, slide: Slide, start_ns: int, route: Route = NOWHERE) -> dict[str, str]:
    """When and how far a wheel slid; the time counts from the start of the log."""
    bound = slide.is_lower_bound
    place = route.at(slide.start)
    km = place.position_km if route.position_from == "position" else None
    return {
        "axle": str(axle),
        "start [s]": number((slide.start - start_ns) / 1e9, 2),
        **when_and_where(place.time, km),
        "duration [s]": bounded_number(slide.duration, 2, bound)
        if slide.duration_u95 is None
        else text_tables.with_u95((slide.duration, slide.duration_u95), 1.0, 2),
        "distance [m]": bounded_number(slide.distance, 1, bound),
        "max slip [%]": text_tables.slip_text(slide.max_slip, bound, slide.max_slip_u95),
        "energy [kJ]": bounded_number(slide.energy and slide.energy / 1e3, 1, bound),
    }
