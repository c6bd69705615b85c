"""Units as logs write them, and the unit in the name of a channel."""

import math
import re
import tomllib
import unicodedata
from collections.abc import Callable, Mapping, Sequence
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
    "power",
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
# A number before a unit, as in "0.01 bar", "x10 kPa", "1/128 bar/bit"; not that of "1/min".
# "-1 bar" and "-0.01 bar" are pressures that release the brake.
_FACTOR = re.compile(
    rf"(?:in\s+)?(?:/|{TIMES})?\s*(?:10\^?(?P<power>-\d)|(?P<over>1\s*/\s*)?(?P<number>-?{NUMBER}))"
    rf"[\s_]*{TIMES}?\s*(?P<unit>[^\W\d_].*?|[%°‰].*?)"
    r"(?i:\s*(?:/|per)\s*(?:bit|lsb|count|digit|inc))?"
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
    if not 0.0 < abs(scaled_factor) <= _COARSEST.get(base.dimension, math.inf):
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
    relative = re.fullmatch(
        r"(.*?)(?:\((?:g|ü|rel\.?)\)|_?rel\.?|[-_.]?g|ü(?:berdruck)?|gauge)", key
    )
    if relative and (of_gauge := UNITS.get(relative[1])) and of_gauge.dimension == "pressure":
        return of_gauge
    absolute = re.fullmatch(r"(.*?)(?:\(a\)|\(abs\.?\)|_?abs(?:\.|olute)?|_a)", key)
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
    """The unit a user or a log states for a channel of a known meaning; a UserError for others."""
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


# ---- the unit in the name of a channel


_BRACKETS = re.compile(
    r"(?i)[\[(（【{<]\s*([^\[\](){}（）【】<>]*(?:\((?:[agü]|rel)\))?)\s*[\])）】}>]"
)

# Units of what is not asked for, with the letters of names: volts are no v, kelvins no K.
_OTHER_QUANTITIES = re.compile(
    r"[\[(（]\s*(?:[mkµμ]?[VAW]|V(?:AC|DC)|K)\s*[\])）]"
    r"|(?<=[^\W_])_[mk]?V$|(?<![^\W_])(?:5|\d{2,}|\d[.,]\d)V(?![^\W_])"
)


# The same at the end of a name, where a sign or a decimal says that the number is no axle's;
# and a number that may be a range, as in "sensor 10bar".
_FACTOR_AT_END = re.compile(
    rf"(?i)(?:\sin\s+|\s*[/,]\s*|[\s_](?={TIMES}|\d+[.,]\d|1\s*/\s*\d))"
    rf"(?P<text>{TIMES}?\s*(?:1\s*/\s*)?{NUMBER}[\s_]*[^\W\d_]\S*(?:\sper\s\S+)?)$"
)
_RANGE_AT_END = re.compile(
    r"(?i)(?<!axle)(?<!achse)(?<!wheel)[\s_](?P<text>(?:\d{2,}|10+\s+)[^\W\d_][^\s\])]*)$"
)
_FACTOR_BEFORE_BRACKET = re.compile(rf"[\s_](?P<factor>{TIMES}\s*{NUMBER})$")


def _has_factor_unread(text: str) -> bool:
    """Whether a text is a unit with a number of which it is not known what it does: "bar x10"."""
    pieces = re.split(rf"[-+\d.,\s/…]+|{TIMES}", text)
    return any(c.isdigit() for c in text) and any(map(unit, pieces))


# Of "[bar] x10" it is not known whether the values are to be multiplied, or are already.
_FACTOR_BEHIND_BRACKET = re.compile(rf"\s*[\[(]?\s*(?:{TIMES}|/)\s*{NUMBER}\s*[\])]?\s*$")


def unknown_in(name: str) -> str:
    """What a name has in its last brackets, if it is no known unit and no index, "" for nothing."""
    for match in _BRACKETS.finditer(name):
        if _FACTOR_BEHIND_BRACKET.match(suffix := name[match.end() :]):
            return f"{match[1]} {suffix.strip(' []()')}"
        factor = _FACTOR_BEFORE_BRACKET.search(name[: match.start()].rstrip())
        if factor and unit(match[1]) and not unit(f"{factor['factor']} {match[1]}"):
            return f"{match[1]} {factor['factor']}"
    at_end = _RANGE_AT_END.search(name.strip())
    if at_end and _has_factor_unread(at_end["text"]):
        return at_end["text"]
    inside = [text.strip() for text in _BRACKETS.findall(name)]
    return inside[-1] if inside and not (unit(inside[-1]) or inside[-1].isdecimal()) else ""


def without_other_units(name: str) -> str:
    """The name without the unit of another quantity, as in `Battery [V]`."""
    return _OTHER_QUANTITIES.sub(" ", name)


# between a name and its unit; the last one is only space
_SEPARATORS = [
    re.compile(f"(?i){separator}(?=[^\\s]+$)")
    for separator in (r"\s+/\s*", r"\s*,\s*", r"\s+in\s+", r"\s+")
]
_TAILS = [
    re.compile(rf"[_.\-/:]({word})(_?(?:axle|ax|wheel|w)?_?\d{{1,2}})?$")
    for word in (r"[a-zA-Z]+_[a-zA-Z]", r"[a-zA-Z]+/[a-zA-Z]+", r"[a-zA-Z]+")
]


def _in_brackets(name: str) -> tuple[str, str] | None:
    """The base of a name and the unit in its brackets; None where they hold no unit."""
    brackets = [m for m in reversed(list(_BRACKETS.finditer(name))) if not m[1].isdecimal()]
    for match in sorted(brackets, key=lambda m: any(c.isdigit() for c in m[1])):
        if unit(match[1]):
            base = (name[: match.start()] + name[match.end() :]).strip(" _-,/")
            if _FACTOR_BEHIND_BRACKET.match(name[match.end() :]):
                return name[: match.start()].strip(" _-,/"), ""
            factor = _FACTOR_BEFORE_BRACKET.search(name[: match.start()].rstrip())
            if factor:
                scaled_text = f"{factor['factor']} {match[1].strip()}"
                is_known = unit(scaled_text) is not None
                return base[: factor.start()].strip(" _-,/"), scaled_text if is_known else ""
            return base, match[1].strip()
    for match in brackets:
        if _has_factor_unread(match[1]):  # its digits are no axle
            return (name[: match.start()] + name[match.end() :]).strip(" _-,/"), ""
    return None


def _with_number(name: str) -> tuple[str, str] | None:
    """The base of a name and the unit with a number at its end, "" where that may be a range."""
    if (match := _FACTOR_AT_END.search(name)) and unit(match["text"]):
        return name[: match.start()].strip(" _-,/"), match["text"].strip()
    if (match := _RANGE_AT_END.search(name)) and _has_factor_unread(match["text"]):
        return name[: match.start()].strip(" _-,/"), ""
    return None


@lru_cache(1 << 10)  # many rules ask for the same name
def in_name(name: str) -> tuple[str, str]:
    """Splits a channel name into its base and the unit written in it, "" for no unit.

    Takes ``BC pressure [kPa]``, ``制动缸压力(kPa)``, ``v_kmh``, ``Druck / bar``, ``speed, km/h``.
    """
    name = name.strip()
    if split := _in_brackets(name) or _with_number(name):
        return split
    for separator in _SEPARATORS:
        head, *tail = separator.split(name)
        if (
            head
            and tail
            and (tail_found := unit(tail[-1]))
            and not (separator is _SEPARATORS[-1] and tail_found.name == "N" and tail[-1] != "N")
            and not (separator is _SEPARATORS[-1] and tail[-1] == "Rad")  # a wheel, in German
        ):
            return head.strip(), tail[-1].strip()
    # after an underscore, perhaps with the axle's number: v_kmh, speed_km_h, wheel_speed_rpm1
    for tail_unit in _TAILS:
        tail_match = tail_unit.search(name)
        if tail_match and tail_match[1].lower() in IN_NAMES:
            return name[: tail_match.start()] + (tail_match[2] or ""), tail_match[1]
    camel = re.search(
        r"(?<=[a-z\d])(?<![^a-z][kKhmM])(Kmh|Mps|Rpm|[kKhM][Pp]a|Bar|[mM][bB]ar|RadS|Pa|k?Hz)(?=\d*$)",
        name,
    )
    if camel and (tail_found := unit(camel[1].replace("RadS", "rad_s"))):
        return name[: camel.start()] + name[camel.end() :], tail_found.name
    return name, ""


def contradicting(text: str, names: Sequence[str], meaning: Meaning) -> str:
    """A unit of this meaning that a name states instead of that of `text`, "" for none."""
    stated_unit = unit_for(text, meaning)
    for name in names:
        own_unit, said = in_name(name)[1], ""
        brackets = [text for text in _BRACKETS.findall(name) if not own_unit.endswith(text)]
        for said in (own_unit, *brackets):
            candidate = unit_for(said, meaning)
            if (
                stated_unit
                and candidate
                and (
                    candidate[1:3] != stated_unit[1:3]
                    or (candidate.offset and not stated_unit.offset)
                )
            ):
                return str(said)
    return ""
