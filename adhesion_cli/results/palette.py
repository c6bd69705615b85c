"""The colours of figures, reports and recordings, which one man in twelve can tell apart, too.

Source: Okabe, Ito: Color Universal Design, 2008. For deuteranopes and protanopes its colours are at
least 14 apart in CAM02-UCS. A grey and a light grey, for a white and a black ground, are added.
"""

from zlib import crc32

BLACK, ORANGE, SKY, GREEN = "#000000", "#e69f00", "#56b4e9", "#009e73"
YELLOW, BLUE, VERMILLION, PURPLE = "#f0e442", "#0072b2", "#d55e00", "#cc79a7"
GREY = "#666666"  # on white
LIGHT, WHITE, OFF = "#c8c8c8", "#ffffff", "#4a4e54"  # on black; OFF: where nothing is the matter

_METHODS = {
    "gradient": ORANGE,
    "imm": PURPLE,
    "kalman": BLUE,
    "leso": VERMILLION,
    "neso": SKY,
    "td": GREEN,
    "none": VERMILLION,
    "patent": BLUE,
    "rule": ORANGE,
}
_FURTHER_COLOURS = (YELLOW, GREY)


def of_method(name: str) -> str:
    """The colour of an estimator or a controller, "#rrggbb"; by its name where it has none here."""
    return _METHODS.get(name) or _FURTHER_COLOURS[crc32(name.encode()) % len(_FURTHER_COLOURS)]


def rgba(colour: str) -> int:
    """A colour "#rrggbb" as Rerun has it."""
    return int(f"{colour[1:]}ff", 16)


_IN_ORDER = (BLUE, ORANGE, GREEN, VERMILLION, SKY, PURPLE, YELLOW, GREY)


def nth(place: int) -> str:
    """The colour of the axle or the run at this place, counted from 0, "#rrggbb"."""
    return _IN_ORDER[place % len(_IN_ORDER)]
