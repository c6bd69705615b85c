"""Units as logs write them."""

import math
import re
import tomllib
import unicodedata
from collections.abc import Callable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal, NamedTuple

from ..errors import UserError
from ..model import Channel, Meaning, Vehicle

Dimension = Literal[
    "pressure",
    "speed",
    "angular speed",
    "pulse rate",
    "count",
    "angle",
    "force",
    "time",
    "ratio",
    "acceleration",
    "torque",
    "length",
    "temperature",
]


class Unit(NamedTuple):
    """A unit: what it measures, and SI = factor · value + offset."""

    name: str
    dimension: Dimension
    factor: float
    offset: float = 0.0


ATMOSPHERE = 101325.0  # standard [Pa]


_ENTRIES = tomllib.loads(Path(__file__).with_name("units.toml").read_text("utf-8"))


def _units_by_spelling(rows_by_dimension: Mapping[str, Any]) -> dict[str, Unit]:
    return {
        spelling: Unit(spellings.split()[0], dimension, factor, *offset)  # type: ignore[arg-type]
        for dimension, rows in rows_by_dimension.items()
        for factor, spellings, *offset in rows
        for spelling in spellings.split()
    }


def _spellings() -> tuple[dict[str, Unit], set[str]]:
    """The unit of each spelling, and the spellings that a name may hold without brackets."""
    units = {x.lower(): unit for x, unit in _units_by_spelling(_ENTRIES["units"]).items()}
    long_spellings = {spelling for spelling in units if len(spelling) > 2 and spelling.isascii()}
    unmistakable = long_spellings - set(_ENTRIES["not_in_names"].split()) | set(
        _ENTRIES["in_names"].split()
    )
    return units, unmistakable


UNITS, IN_NAMES = _spellings()

# Separate: a name that ends on "-", "[%]", "g" or "m" states no unit of a pressure or speed.
_RARE_UNITS = _units_by_spelling(_ENTRIES["rare"])

EXPECTED: dict[Meaning, tuple[Dimension, ...]] = {
    "time": ("time",),
    "pressure": ("pressure",),
    "wheel_speed": ("speed", "angular speed", "pulse rate", "count", "angle"),
    "train_speed": ("speed", "acceleration"),  # or what integrates to one
    "clamping_force": ("force",),
    "truth": ("force",),
    "true_slip": ("ratio",),
    "ed_force": ("force", "torque", "ratio"),
    "traction_force": ("force", "torque", "ratio"),
    "brake_pipe": ("pressure",),
    "load_pressure": ("pressure",),
    "reservoir_pressure": ("pressure",),
    "distance": ("length",),
    "position": ("length",),
    "gradient": ("ratio",),
    "temperature": ("temperature",),
}  # states of 0 and 1, and what else has no unit, are not in it

_USUAL: dict[Meaning, tuple[str, ...]] = {
    "pressure": ("Pa", "kPa", "bar", "MPa", "psi"),
    "wheel_speed": ("rad/s", "rpm", "rps", "m/s", "km/h", "mph"),
    "train_speed": ("m/s", "km/h", "mph"),
    "clamping_force": ("N", "kN"),
}

NUMBER = r"(?:\d+\.\d+|\d+,\d{1,2}|\d+)(?:[eE][-+]?\d+)?"
TIMES = "[x×*·]"
# A number before a unit, as in "0.01 bar", "x10 kPa", "1/128 bar/bit"; not that of "1/min"
_FACTOR = re.compile(
    rf"(?:in\s+)?(?:/|{TIMES})?\s*(?:10\^?(?P<power>-\d)|(?P<over>1\s*/\s*)?(?P<number>{NUMBER}))"
    rf"[\s_]*{TIMES}?\s*(?P<unit>[^\W\d_].*?|[%°‰].*?)"
    r"(?:\s*(?:/|per)\s*(?:bit|lsb|count|digit|inc))?"
)
# The coarsest step of a logged value in SI: a larger number before a unit is a sensor's range.
_COARSEST: dict[Dimension, float] = {"pressure": 1e5, "speed": 3.0, "angular speed": 11.0}


def _scaled(text: str) -> Unit | None:
    """The unit of a text with a factor before it, None where it has none."""
    match = _FACTOR.fullmatch(text.strip(" []{}【】"))
    base = unit(match["unit"]) or rare_unit(match["unit"]) if match else None
    if not match or not base:
        return None
    number = f"1e{match['power']}" if match["power"] else match["number"].replace(",", ".")
    factor = float(number) or math.nan
    scaled_factor = base.factor * (1.0 / factor if match["over"] else factor)
    if not 0.0 < scaled_factor <= _COARSEST.get(base.dimension, math.inf):
        return None
    return base._replace(name=text.strip(), factor=scaled_factor)


@lru_cache(1 << 10)
def unit(text: str) -> Unit | None:
    """The unit a text spells, None where it spells none.

    "kPa abs" and "kPa(a)" count from vacuum; "0.01 bar" is a unit with a factor.

    >>> unit("0.01 bar").factor, unit("x10 kPa").factor, unit("bar x10")
    (1000.0, 10000.0, None)
    """
    text = unicodedata.normalize("NFKC", text).replace("−", "-")  # superscripts, as in "min⁻¹"
    key = re.sub(r"[\s\^·*]", "", text).lower()
    if "mPa" in text:  # no brake pressure is in thousandths of a pascal
        return None
    if plain_unit := UNITS.get(key.strip("[](){}（）【】")) or UNITS.get(text.strip().lower()):
        return plain_unit
    relative = re.fullmatch(r"(.*?)(?:\(g\)|\(rel\.?\)|_?rel\.?|_g)", key)
    if relative and (of_gauge := UNITS.get(relative[1])) and of_gauge.dimension == "pressure":
        return of_gauge
    absolute = re.fullmatch(r"(.*?)(?:\(a\)|\(abs\.?\)|_?abs\.?|_a)", key)
    gauge = UNITS.get(absolute[1]) if absolute else None
    if gauge is None or gauge.dimension != "pressure":
        return _scaled(text)
    return gauge._replace(name=f"{gauge.name} abs", offset=-ATMOSPHERE)


def unit_for(text: str, meaning: Meaning) -> Unit | None:
    """The unit a text spells for a channel of this meaning, None where it cannot measure that."""
    candidate = unit(text) or rare_unit(text)
    return candidate if candidate and candidate.dimension in EXPECTED.get(meaning, ()) else None


def rare_unit(text: str) -> Unit | None:
    """The unit of a ratio, a torque and other quantities that few channels have."""
    return _RARE_UNITS.get(text.strip("[](){} "))


def is_acceleration(text: str) -> bool:
    """Whether a text is the unit of an acceleration, which integrates to a train speed."""
    candidate = unit_for(text, "train_speed")
    return candidate is not None and candidate.dimension == "acceleration"


def known_units(meaning: Meaning) -> list[str]:
    """First spelling of each unit a channel of this meaning may have."""
    all_units = (*UNITS.values(), *_RARE_UNITS.values())
    return list(
        dict.fromkeys(u.name for u in all_units if u.dimension in EXPECTED.get(meaning, ()))
    )


def stated_unit(text: str, meaning: Meaning, channel: str) -> Unit:
    """The unit a user or a log states for a channel of a known meaning.

    Raises:
        UserError: for an unknown unit, or one that cannot measure this.
    """
    candidate = unit_for(text, meaning)
    if candidate is None:
        problem = "unknown unit" if unit(text) is None else f"a {meaning} cannot be in"
        raise UserError(
            f"channel {channel!r}: {problem} {text!r}",
            f"units of a {meaning.replace('_', ' ')}: {', '.join(known_units(meaning))}",
            code=2,
        )
    return candidate


def alternative_units(
    channel: Channel, vehicle: Vehicle, fits: Callable[[float], bool]
) -> list[str]:
    """Usual units a channel may be in instead, given by how much larger its values may be."""
    stated_unit = UNITS.get(channel.unit.strip().lower())
    if stated_unit is None or channel.meaning is None:
        return []
    R = vehicle.radius(channel.axle or 1).value
    names = []
    for name in _USUAL[channel.meaning]:
        unit = UNITS[name.lower()]
        rim_factor = {"speed": 1.0, "angular speed": R}
        ratio = unit.factor * rim_factor.get(unit.dimension, 1.0)
        ratio /= stated_unit.factor * rim_factor.get(stated_unit.dimension, 1.0)
        if abs(math.log(ratio)) > 0.1 and fits(ratio):
            names.append(name)
    return names
