"""One colour per method, in every figure and in the viewer; legible on white and on black."""

from zlib import crc32

BLUE, ORANGE, RED, GREEN = "#2f6fd0", "#e08a2a", "#d9484a", "#238a80"
BLACK, GREY = "#222222", "#999999"

_METHODS = {
    "gradient": ORANGE,
    "imm": "#d0419b",
    "kalman": BLUE,
    "leso": RED,
    "neso": "#9a63d0",
    "td": "#2a9d90",
    "none": RED,
    "patent": BLUE,
    "rule": ORANGE,
}
_FURTHER_COLOURS = ("#a08a00", "#c75b86", "#8a6a4a", "#5f8f2f", "#4aa3d8", "#7c7cf0")


def of_method(name: str) -> str:
    """The colour of an estimator or a controller, "#rrggbb".

    Other methods never change it. One that is not in the table has a colour by its name.
    """
    return _METHODS.get(name) or _FURTHER_COLOURS[crc32(name.encode()) % len(_FURTHER_COLOURS)]


def rgba(colour: str) -> int:
    """A colour "#rrggbb" as Rerun has it."""
    return int(f"{colour[1:]}ff", 16)


_IN_ORDER = (BLUE, ORANGE, GREEN, "#9a63d0", *_FURTHER_COLOURS)


def nth(place: int) -> str:
    """The colour of the axle or the run at this place, counted from 0, "#rrggbb"."""
    return _IN_ORDER[place % len(_IN_ORDER)]
