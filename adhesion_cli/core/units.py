"""Units as logs write them, and the unit in the name of a channel."""

import math
import re
import tomllib
from collections.abc import Callable, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Literal, NamedTuple

from .errors import UserError
from .model import Channel, Meaning, Vehicle
from .physics import G

Dimension = Literal[
    "pressure", "speed", "angular speed", "pulse rate", "count", "angle", "force", "time", "ratio",
    "acceleration",
]  # fmt: skip


class Unit(NamedTuple):
    """A unit: what it measures, and SI = factor · value + offset."""

    name: str
    dimension: Dimension
    factor: float
    offset: float = 0.0


ATMOSPHERE = 101325.0  # standard [Pa]


def _spellings() -> tuple[dict[str, Unit], set[str]]:
    """The unit of each spelling, and the spellings that a name may hold without brackets."""
    text = Path(__file__).with_name("units.toml").read_text("utf-8")
    entries = tomllib.loads(text)
    found = {
        spelling.lower(): Unit(words.split()[0], dimension, factor, *offset)
        for dimension, rows in entries["units"].items()
        for factor, words, *offset in rows
        for spelling in words.split()
    }
    long = {spelling for spelling in found if len(spelling) > 2 and spelling.isascii()}
    unmistakable = long - set(entries["not_in_names"].split()) | set(entries["in_names"].split())
    return found, unmistakable


UNITS, _IN_NAMES = _spellings()

# Separate, because a name that ends on "-", "[%]" or "g" states no unit of a pressure or speed.
_APART = {
    "-": Unit("-", "ratio", 1.0),
    "%": Unit("%", "ratio", 0.01),
    "g": Unit("g", "acceleration", G),
    "mg": Unit("mg", "acceleration", 1e-3 * G),
}

EXPECTED: dict[Meaning, tuple[Dimension, ...]] = {
    "time": ("time",),
    "pressure": ("pressure",),
    "wheel_speed": ("speed", "angular speed", "pulse rate", "count", "angle"),
    "train_speed": ("speed", "acceleration"),  # or what integrates to one
    "clamping_force": ("force",),
    "truth": ("force",),
    "true_slip": ("ratio",),
}

_USUAL: dict[Meaning, tuple[str, ...]] = {
    "pressure": ("Pa", "kPa", "bar", "MPa", "psi"),
    "wheel_speed": ("rad/s", "rpm", "rps", "m/s", "km/h", "mph"),
    "train_speed": ("m/s", "km/h", "mph"),
    "clamping_force": ("N", "kN"),
}

_BRACKETS = re.compile(r"[\[(（【{<]\s*([^\[\](){}（）【】<>]*(?:\([ag]\))?)\s*[\])）】}>]")

# Units of what is not asked for, with the letters of names: volts are no v, kelvins no K.
_OTHERS = re.compile(
    r"[\[(（]\s*(?:[mkµμ]?[VAW]|V(?:AC|DC)|K)\s*[\])）]"
    r"|(?<=[^\W_])_[mk]?V$|(?<![^\W_])(?:5|\d{2,}|\d[.,]\d)V(?![^\W_])"
)


@lru_cache(1 << 10)
def unit(text: str) -> Unit | None:
    """The unit a text spells, None where it spells none; "kPa abs", "kPa(a)" count from vacuum."""
    key = re.sub(r"[\s\^·*]", "", text).lower()
    if text.strip() == "mPa":  # no brake pressure is in thousandths of a pascal
        return None
    if found := UNITS.get(key.strip("[](){}（）【】")) or UNITS.get(text.strip().lower()):
        return found
    absolute = re.fullmatch(r"(.*?)(?:\(a\)|\(abs\.?\)|_?abs\.?|_a)", key)
    gauge = UNITS.get(absolute[1]) if absolute else None
    if gauge is None or gauge.dimension != "pressure":
        return None
    return gauge._replace(name=f"{gauge.name} abs", offset=-ATMOSPHERE)


def of(text: str, meaning: Meaning) -> Unit | None:
    """The unit a text spells for a channel of this meaning, None where it cannot measure that."""
    found = unit(text) or _APART.get(text.strip("[](){} "))
    return found if found and found.dimension in EXPECTED[meaning] else None


def is_acceleration(text: str) -> bool:
    """Whether a text is the unit of an acceleration, which integrates to a train speed."""
    found = of(text, "train_speed")
    return found is not None and found.dimension == "acceleration"


def known_units(meaning: Meaning) -> list[str]:
    """First spelling of each unit a channel of this meaning may have."""
    known = (*UNITS.values(), *_APART.values())
    return list(dict.fromkeys(u.name for u in known if u.dimension in EXPECTED[meaning]))


def stated(text: str, meaning: Meaning, channel: str) -> Unit:
    """The unit a user or a log states for a channel of a known meaning.

    Raises:
        UserError: for an unknown unit, or one that cannot measure this.
    """
    found = of(text, meaning)
    if found is None:
        wrong = "unknown unit" if unit(text) is None else f"a {meaning} cannot be in"
        raise UserError(
            f"channel {channel!r}: {wrong} {text!r}",
            f"units of a {meaning.replace('_', ' ')}: {', '.join(known_units(meaning))}",
            code=2,
        )
    return found


def unknown_in(name: str) -> str:
    """What a name has in its last brackets, if it is no known unit and no index, "" for nothing."""
    inside = [text.strip() for text in _BRACKETS.findall(name)]
    return inside[-1] if inside and not (unit(inside[-1]) or inside[-1].isdecimal()) else ""


def without_others(name: str) -> str:
    """The name without the unit of another quantity, as in `Battery [V]`."""
    return _OTHERS.sub(" ", name)


# between a name and its unit; the last one is only space
_SEPARATORS = [
    re.compile(f"(?i){separator}(?=[^\\s]+$)")
    for separator in (r"\s+/\s*", r"\s*,\s*", r"\s+in\s+", r"\s+")
]
_TAILS = [
    re.compile(rf"[_.\-/:]({word})(_?(?:axle|ax|wheel|w)?_?\d{{1,2}})?$")
    for word in (r"[a-zA-Z]+_[a-zA-Z]", r"[a-zA-Z]+/[a-zA-Z]+", r"[a-zA-Z]+")
]


@lru_cache(1 << 10)  # many rules ask for the same name
def in_name(name: str) -> tuple[str, str]:
    """Splits a channel name into its base and the unit written in it, "" for no unit.

    Takes ``BC pressure [kPa]``, ``制动缸压力(kPa)``, ``v_kmh``, ``Druck / bar``, ``speed, km/h``.
    """
    for match in reversed(list(_BRACKETS.finditer(name))):
        if unit(match[1]):
            return (name[: match.start()] + name[match.end() :]).strip(" _-,/"), match[1].strip()
    for separator in _SEPARATORS:
        head, *tail = separator.split(name.strip())
        if head and tail and (found := unit(tail[-1])) and not (
            separator is _SEPARATORS[-1] and found.name == "N" and tail[-1] != "N"
        ):  # fmt: skip
            return head.strip(), tail[-1].strip()
    # after an underscore, perhaps with the axle's number: v_kmh, speed_km_h, wheel_speed_rpm1
    for tail_unit in _TAILS:
        end = tail_unit.search(name)
        if end and end[1].lower() in _IN_NAMES:
            return name[: end.start()] + (end[2] or ""), end[1]
    camel = re.search(r"(?<=[a-z])(Kmh|Mps|Rpm|KPa|MPa|Bar|Mbar|RadS|Kpa|Mpa|Pa|Hz)(?=\d*$)", name)
    if camel and (found := unit(camel[1].replace("RadS", "rad_s"))):
        return name[: camel.start()] + name[camel.end() :], found.name
    return name, ""


def contradicting(text: str, names: Sequence[str], meaning: Meaning) -> str:
    """A unit of this meaning that one of the names states instead of that of `text`, "" for none.

    Only `text` need say that a pressure counts from vacuum.
    """
    taken = of(text, meaning)
    for name in names:
        said: str
        for said in (in_name(name)[1], *_BRACKETS.findall(name)):
            found = of(said, meaning)
            if taken and found and (
                found[1:3] != taken[1:3] or (found.offset and not taken.offset)
            ):  # fmt: skip
                return said
    return ""


def others(channel: Channel, vehicle: Vehicle, fits: Callable[[float], bool]) -> list[str]:
    """Usual units a channel may be in instead, given by how much larger its values may be."""
    taken = UNITS.get(channel.unit.strip().lower())
    if taken is None or channel.meaning is None:
        return []
    R = vehicle.radius(channel.axle or 1).value
    found = []
    for name in _USUAL[channel.meaning]:
        unit = UNITS[name.lower()]
        along = {"speed": 1.0, "angular speed": R}
        times = unit.factor * along.get(unit.dimension, 1.0)
        times /= taken.factor * along.get(taken.dimension, 1.0)
        if abs(math.log(times)) > 0.1 and fits(times):
            found.append(name)
    return found
