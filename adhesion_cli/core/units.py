"""Units as logs write them, and the unit in the name of a channel."""

import math
import re
from collections.abc import Callable, Sequence
from functools import lru_cache
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
_RPM = 2.0 * math.pi / 60.0
_DEGREE = math.pi / 180.0

# Spellings in lower case without blanks, carets and middle dots; the first one names the unit.
_SPELLINGS: dict[tuple[Dimension, float, float], str] = {
    ("pressure", 1.0, 0.0): "Pa pascal pascals 帕",
    ("pressure", 1e2, 0.0): "mbar millibar millibars hpa 毫巴",
    ("pressure", 1e3, 0.0): "kPa kilopascal kilopascals 千帕",
    ("pressure", 1e5, 0.0): "bar bars barg bar(g) bar_g 巴",
    ("pressure", 1e5, -ATMOSPHERE): "bara",
    ("pressure", 1e6, 0.0): "MPa megapascal megapascals n/mm2 n/mm² 兆帕",
    ("pressure", 6894.757293168361, 0.0): "psi psig lbf/in2 lb/in2",
    ("pressure", 98066.5, 0.0): "kgf/cm2 kg/cm2 kgf/cm² kg/cm² at",
    ("speed", 1.0, 0.0): "m/s mps ms-1 m/sec m_s m_per_s meter_per_second meters_per_second 米/秒",
    (
        "speed",
        1.0 / 3.6,
        0.0,
    ): "km/h kmh kmph kph km/hr km_h km_per_h kmh-1 km/std km/u 公里/小时 千米/小时",
    ("speed", 0.44704, 0.0): "mph mi/h mile/h miles/h",
    ("speed", 0.3048, 0.0): "ft/s fps",
    ("angular speed", 1.0, 0.0): "rad/s rads rads-1 rad/sec rad_s rad_per_s radps 弧度/秒",
    (
        "angular speed",
        _RPM,
        0.0,
    ): "rpm r/min rev/min 1/min u/min tr/min tours/min giri/min omw/min min-1 min^-1 rev_min "
    "转/分 转/分钟",
    ("angular speed", 2.0 * math.pi, 0.0): "rps rev/s r/s u/s 转/秒",
    ("angular speed", _DEGREE, 0.0): "deg/s °/s deg_s degps degrees/s",
    ("pulse rate", 1.0, 0.0): "Hz hertz 1/s s-1 pulses/s imp/s pulse/s 赫兹",
    ("pulse rate", 1e3, 0.0): "kHz",
    ("count", 1.0, 0.0): "count counts pulses pulse imp impulse impulses ticks tick 脉冲",
    ("angle", 1.0, 0.0): "rad radian radians 弧度",
    ("angle", _DEGREE, 0.0): "deg ° degree degrees grad 度",
    ("angle", 2.0 * math.pi, 0.0): "rev revs revolution revolutions turns",
    ("force", 1.0, 0.0): "N newton newtons 牛 牛顿",
    ("force", 10.0, 0.0): "daN",
    ("force", 1e3, 0.0): "kN kilonewton kilonewtons 千牛",
    ("force", 4.4482216152605, 0.0): "lbf",
    ("force", 9.80665, 0.0): "kgf kp",
    ("acceleration", 1.0, 0.0): "m/s2 m/s² m/s/s mps2 ms-2 m/sec2 m/sec² m_s2 m_per_s2 "
    "meter_per_second_squared meters_per_second_squared 米/秒² 米/秒2",
    ("acceleration", 1e-2, 0.0): "cm/s2 cm/s²",
    ("time", 1.0, 0.0): "s sec secs second seconds sek sekunden 秒",
    ("time", 1e-3, 0.0): "ms msec millisecond milliseconds millis 毫秒",
    ("time", 1e-6, 0.0): "us µs μs usec microsecond microseconds micros 微秒",
    ("time", 1e-9, 0.0): "ns nsec nanosecond nanoseconds nanos 纳秒",
    ("time", 60.0, 0.0): "min minute minutes 分钟",
    ("time", 3600.0, 0.0): "h hour hours std stunden 小时",
}

UNITS: dict[str, Unit] = {
    spelling.lower(): Unit(words.split()[0], dimension, factor, offset)
    for (dimension, factor, offset), words in _SPELLINGS.items()
    for spelling in words.split()
}

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

# Units that names hold without brackets: words that mean nothing else.
_IN_NAMES = {
    s for s, u in UNITS.items()
    if len(s) > 2 and s.isascii() and s not in {"bars", "count", "counts", "pulse", "pulses",
       "impulse", "impulses", "tick", "ticks", "rad", "rev", "revs", "second", "minute",
       "min", "sec", "secs", "hour", "hours", "std", "turns", "millis", "deg", "grad", "degree"}
} | {"pa", "n", "kn", "hz", "mps", "deg_s", "rad_s", "m_s", "km_h"}  # fmt: skip

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
    """What a name has in its last brackets, if it is not a known unit, "" for nothing."""
    inside = [text.strip() for text in _BRACKETS.findall(name)]
    return inside[-1] if inside and not unit(inside[-1]) else ""


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


def listed(units: list[str]) -> str:
    """The same as a question behind a text, "" for none."""
    return f" ({' or '.join(units)}?)" if units else ""
