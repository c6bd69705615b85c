"""What one field means by its own name and unit: a table of rules, tried from the top.

The words that the rules ask for are in `vocabulary.toml`.
"""

import re
import tomllib
import unicodedata
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache, lru_cache
from pathlib import Path
from typing import NamedTuple

from ..core import units
from ..core.model import Meaning
from ..formats.source import Field


class Guess(NamedTuple):
    """What a field means, None where it means nothing to an analysis, and why."""

    meaning: Meaning | None
    axle: int | None
    unit: str
    reason: str


class Rule(NamedTuple):
    """One row: a field of this quantity, whose name has these words, has this meaning.

    Attributes:
        quantity: by its unit, or by a word where it states no unit; see `_Name.quantities`. A
            state has no unit, a switch none or "-", and no word for a quantity. "|" as below.
        pattern: kinds of words of the vocabulary; all conditions must hold. "own" asks only the
            words of the field itself, not of its topic. "|" separates alternatives. "!" asks that
            there are no such words. "?" finds words for the reason, and asks nothing.
        meaning: None for a field that is not an input of an analysis.
        reason: why there is no meaning, with the words that were found. Or what to add to the
            reason of a meaning.
    """

    quantity: str
    pattern: str
    meaning: Meaning | None
    reason: str = ""


_NAMED = "an analysis does not use it"
_FOR_STOPS = "stops use it"
_PLACED = "stops and slides have their place by it"
_ABOVE_ZERO = "above zero it acts"
ED_WITHOUT_UNIT = "an ED brake, but no unit of a force, a torque or a share (%) is stated"
NO_NAME = "no name we know"
UNCLEAR_VALVE = "a valve, but the name does not say whether it vents or holds"

RULES = (
    Rule("any", "own never", None, "not a quantity we use"),
    Rule("ratio", "own slip, true, !estimated", "true_slip"),
    Rule("any", "own slip, true, !estimated", None, "a true slip, but no unit stated: - or %"),
    Rule(
        "any",
        "own ED brake, own demand|own estimated",
        None,
        "an ED brake, but {1!r} says that it is not the force that acts",
    ),
    Rule("torque", "motor", None, "a torque, but {0!r} says that it is not the wheelset's"),
    Rule("force|torque", "ED brake, ?own force, ?own torque, !own true", "ed_force"),
    Rule("ratio", "own ED brake, !own slip", "ed_force"),
    Rule("any", "own ED brake, own force|own torque|own effort, !own true", "ed_force"),
    Rule("force|torque", "own traction, !own demand, !own estimated, !own true", "traction_force"),
    Rule(
        "force|torque",
        "traction, own braking, !own demand, !own estimated, !own true",
        "traction_force",
        "below zero it brakes",
    ),
    Rule("ratio", "own traction, own force|own effort, !own demand", "traction_force"),
    Rule("force|torque", "own ED effort, !own demand, !own estimated, !own true", "ed_force"),
    Rule("force", "own clamping, ?own force", "clamping_force"),
    Rule("force", "own K, ?own force, !adhesion force, !true force", "clamping_force"),
    Rule("force", "true, ?adhesion force, !estimated, !slip, !own other force", "truth"),
    Rule("force", "adhesion force, !estimated, !slip, !own other force", "truth"),
    Rule(
        "acceleration",
        "acceleration|a along x, other acceleration|other speed|estimated|slip",
        None,
        "an acceleration, but {1!r} is not the train's along it",
    ),
    Rule(
        "acceleration", "acceleration|a along x", "train_speed", "an acceleration, to be integrated"
    ),
    Rule("any", "acceleration", None, "{0!r} in the name, but no unit of it is stated"),
    Rule("pressure", "other pressure", None, "a pressure, but {0!r} is not the brake cylinder"),
    Rule("pressure", "reservoir", "reservoir_pressure", _FOR_STOPS),
    Rule("pressure", "brake pipe, !cylinder", "brake_pipe", _FOR_STOPS),
    Rule("pressure", "suspension", "load_pressure", _NAMED),
    Rule("absolute pressure", "?own pressure, ?cylinder, absolute", "pressure"),
    Rule("pressure", "?own pressure, ?cylinder", "pressure"),
    Rule("turns|state", "own latitude", "latitude", _PLACED),
    Rule("turns|state", "own longitude", "longitude", _PLACED),
    Rule("speed", "own latitude|own longitude|own temperature", None, "not a quantity we use"),
    Rule("speed without unit", "own electrical", None, "no speed: {0!r} says a voltage"),
    Rule("speed", "other speed", None, "a speed, but {0!r} is not measured on wheel or train"),
    Rule("speed", "bound, !wheel", None, "a speed, but {0!r} is not measured on wheel or train"),
    Rule("turns", "!wheel, !own speed", None, "nothing in the name says wheel or axle"),
    Rule("speed", "true|actual, ?own speed, !wheel", "train_speed"),
    Rule("speed along the track", "train, ?own speed, !wheel", "train_speed"),
    Rule("speed", "?wheel, ?own speed", "wheel_speed"),
    Rule("any", "own retarder", "retarder", _ABOVE_ZERO),
    Rule("state", "own ED brake, !state", None, ED_WITHOUT_UNIT),
    Rule("switch", "own vent valve", "vent_valve", _FOR_STOPS),
    Rule("switch", "own hold valve", "hold_valve", _FOR_STOPS),
    Rule("any", "own magnetic braking", "magnetic_brake", _ABOVE_ZERO),
    Rule("switch", "track brake, !own no switch", "magnetic_brake", _ABOVE_ZERO),
    Rule("switch", "own sand", "sanding", _FOR_STOPS),
    Rule("switch", "own emergency", "emergency", _FOR_STOPS),
    Rule("switch", "own WSP", "wsp_active", _FOR_STOPS),
    Rule("state|ratio", "own braking demand", "brake_command", _FOR_STOPS),
    Rule("length", "own position", "position", _PLACED),
    Rule("length|state", "own kilometre", "position", _PLACED),
    Rule("length|state", "own distance", "distance", _PLACED),
    Rule("ratio|state", "own gradient", "gradient", _NAMED),
    Rule("temperature", "?own temperature", "temperature", _NAMED),
    Rule("state", "own temperature", "temperature", _NAMED),
    Rule("any", "own temperature", None, "not a quantity we use"),
    Rule("state", "own valve", None, UNCLEAR_VALVE),
)

_ALIKE = "force pressure acceleration ratio torque length temperature power"
_QUANTITY: dict[str, tuple[str, ...]] = {  # dimension of a stated unit: what it may be
    **{name: (name,) for name in _ALIKE.split()},
    **dict.fromkeys(("pulse rate", "count", "angle"), ("speed", "turns")),
    "speed": ("speed", "speed along the track"),
    "angular speed": ("speed",),
}

_PRESSURES = {"pressure", "reservoir", "brake pipe", "suspension"}  # kinds that say a pressure

# What results of this program hold, by message type and field. Their topics begin with the name of
# a log, which may say anything.
_OWN_MESSAGES: dict[tuple[str, str], tuple[Meaning, str]] = {
    ("adhesion.AxleInput", "brake_cylinder_pressure"): ("pressure", "Pa"),
    ("adhesion.AxleInput", "clamping_force"): ("clamping_force", "N"),
    ("adhesion.AxleInput", "wheel_speed"): ("wheel_speed", "rad/s"),
    ("adhesion.AxleInput", "train_speed"): ("train_speed", "m/s"),
    ("adhesion.Truth", "force"): ("truth", "N"),
    ("adhesion.Truth", "slip"): ("true_slip", "-"),
}

_CHINESE_NUMBERS = {c: i for i, c in enumerate("一二三四五六七八", start=1)} | {"前": 1, "后": 2}
_CHINESE_PLACES = "[一二三四五六七八](?=[轴轮位架车]|转向架)|(?<=[轴轮架])[一二三四五六七八]"
_CHINESE_PLACES += "|[前后](?=[轴架]|转向架)"
_LETTERS = {c: i for i, c in enumerate("abcdefgh", start=1)}
_COUNTS = _LETTERS | {"i": 1, "ii": 2, "iii": 3, "iv": 4}  # as in "axle A", "bogie II"
_DEVICE = re.compile(  # and its number: MX840B_1, CX23-R_3
    r"(?<![^\W_])[A-Za-z]{2,3}(?:\d{3,4}[A-Z]?|\d{2}-[A-Z])(?:_\d+)+"
)
_AT_DEVICE = re.compile(r"\\[^\\:]*:\d+$|\{\s*\}$|^\{\[\w+\]|(?<=\w)\}$")
# Numbers that count nothing: of a module and channel in front, of a device, a date, a range, a
# resolution, a filter, a sensor, a version.
_NO_COUNT = re.compile(
    r"(?i)^\[\d+[:.]\d+\]|[(\[](?:(?:id|s/?n|ser)\b[^)\]]*|v\d+\.\d+)[)\]]|\b0x[0-9a-f]+\b"
    r"|[(\[](?-i:[A-Z]{2,}\s[A-Z]\d+[A-Z]+\d*)[)\]]"
    r"|\b\d{4}[-./]\d\d[-./]\d\d\b|\b\d{1,2}:\d\d\b"
    r"|[~≈]\s*\d+(?:[.,]\d+)?|(?<!\w)(?:0[.,]\d+|0\s*-\s*\d+|\d+\s*-\s*\d+\s?m?[AV]\b)"
    r"|(?<![\w.,])(?:\d[\d.,]*?\s*(?:\.{2,}|…)\s*[\d.,]+"
    r"|(?:\d[\d.,]*|\d+[.,]\d+ )(?:k?Hz|ms|s|[mk]?bar|[kM]?Pa)\b"
    r"|\d+\s*(?:teeth|zähne)\b|\d\d+(?:\s(?:k?Hz|ms)|(?-i:V))\b|\d+\s?(?:°|degC)|\d\d+\s?%)"
)
_LABELS = re.compile(r"""(\w+)=("+|')([^"']*)\2,?\s*""")  # of a series: instance="10.0.0.1:9100"
_NAMING = {"name", "signal", "__name__", "channel", "tag", "topic"}  # keys of labels
# A number of two digits at most: of an input, of a sensor's label, or behind a module's.
_SPARE = re.compile(
    r"""(?i)(?<![^\W\d_])(?:in|input|eingang|ch|channel|kanal)[\s_]*(\d\d?)(?!\d)"""
    r"""|=["']+(\d\d?)["']|^\[\d+[:.](\d\d?)\]"""
)
_AXLES = re.compile(r"([^\W\d_]+)\.?[\s_]*(\d)\s*([-–+&/])\s*(\d)(?!\d)")  # as in "axles 1-4"
_PLACE_CODE = re.compile(r"(?<![^\W_])(?:C(\d)_?)?B(\d)_?A(\d)(?![^\W_])")  # as in "B2A1"
_MEASURED = {"speed", "pressure"}
_PLACES = {"wheel", "bogie", "car"}
_TRACK_BRAKE = re.compile(r"\btrack ?brake\b(?! test\b)")
_VALVES = {"valve", "vent valve", "hold valve"}
_OF_AXLE = {"wheel"} | _VALVES
_NUMBERED = {"wheel", "cylinder"} | _VALVES  # kinds of words before an axle's number

VOCABULARY = tomllib.loads(Path(__file__).with_name("vocabulary.toml").read_text("utf-8"))
_STEMS: list[str] = VOCABULARY["stems"].split()
GENERIC: list[str] = VOCABULARY["generic"].split()
_CONVENTIONS: list[tuple[str, str, str]] = VOCABULARY["conventions"]
_PAIRS: dict[str, list[list[str]]] = VOCABULARY["pairs"]
_WORDS_BY_KIND: dict[str, list[str]] = {  # of each kind, in the order of the file
    kind: " ".join(of_language.values()).split()
    for kind, of_language in VOCABULARY["kinds"].items()
}
_ABBREVIATIONS: dict[str, dict[str, str]] = VOCABULARY["abbreviations"]  # by language
_WORDS_BY_LANGUAGE = {
    language: {x for words in VOCABULARY["kinds"].values() for x in words.get(language, "").split()}
    for language in _ABBREVIATIONS
}
_SHORTEST_PLAIN = 4  # letters of a word that may also stand without its marks


def _without_marks(word: str) -> str:
    """A Latin word as people write it without its marks: "wozek" for "wózek"."""
    letters = unicodedata.normalize("NFKD", word).translate({ord("ł"): "l", ord("ı"): "i"})
    return "".join(c for c in letters if not unicodedata.combining(c))


_VOCABULARY_WORDS = {word for words in _WORDS_BY_KIND.values() for word in words}
for _kind_words in _WORDS_BY_KIND.values():
    _unmarked_words = (_without_marks(x) for x in _kind_words if len(x) >= _SHORTEST_PLAIN)
    _kind_words += [x for x in _unmarked_words if x.isascii() and x not in _VOCABULARY_WORDS]

OFF_STATES, ON_STATES, CLOSED_STATES, OPEN_STATES = (
    frozenset(" ".join(VOCABULARY["states"][kind].values()).split())
    for kind in ("off", "on", "closed", "open")
)


def abbreviations_of(fields: Sequence[Field]) -> dict[str, str]:
    """The abbreviations, in words, of the languages in which the names of a log have words."""
    names = {word for field in fields for word in name_words(field.channel)}
    words_of = _WORDS_BY_LANGUAGE.items()
    languages = [x for x, words in words_of if names & (words | {*map(_without_marks, words)})]
    return {short: text for x in languages for short, text in _ABBREVIATIONS[x].items()}


def spelled_out(field: Field, abbreviations: Mapping[str, str]) -> Field:
    """The field with these abbreviations in its name as words."""
    channel = field.channel
    for short, text in abbreviations.items():
        channel = re.sub(rf"(?<![^\W\d_]){short}(?![^\W\d_])", text, channel)
    return replace(field, channel=channel)


@lru_cache(1 << 10)  # many rules ask for the same field
def name_words(text: str) -> tuple[str, ...]:
    """Lower-case words of a name: camelCase, digits, punctuation and the script separate them."""
    text = unicodedata.normalize("NFKC", text)
    text = re.sub(r"(?i)\b(rad|achs|zug|fahrzeug|fahr)(?=geschw|drehz)", r"\1 ", text)
    text = re.sub(r"\b([^\W\d_]+_?)\d\s*[-−–]\s*\1\d(?!\w)", " difference ", text)
    text = re.sub(r"(?i)\bzug(?=-?\s*/\s*brems)", "zugkraft", text)
    text = re.sub(r"(?i)\bmotor[\s_](?=bogie|truck|car|coach|drehgestell|wagen)", " ", text)
    # C is the cylinder's pressure, as L the pipe's
    text = re.sub(r"(?i)(?<![^\W_])(?:p_?c(?![^\W\d_])|c(?=[-_. ]?dr))", "bc ", text)
    text = re.sub(
        r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=\D)(?=\d)|(?<=\d)(?=\D)"
        r"|(?<=[a-zA-Z])(?=[一-鿿])|(?<=[一-鿿])(?=[a-zA-Z])",
        " ",
        text,
    )
    return tuple(re.findall(r"[^\W_]+", text.lower()))


def word_of_kind(kind: str, name_parts: Sequence[str]) -> str:
    """The first of these words that is of this kind, "" for none."""
    return next((match for word in name_parts if (match := _kinds(word).get(kind))), "")


def _kinds_of(name_parts: Sequence[str]) -> dict[str, str]:
    """The kinds of these words, each with the first word of it."""
    kinds: dict[str, str] = {}
    for word in reversed(name_parts):
        kinds |= _kinds(word)
    return kinds


@lru_cache(1 << 14)  # logs have many names of few words
def _kinds(word: str) -> dict[str, str]:
    """The kinds of a word, each with the part of it that says so; none for a number."""
    if word.isdecimal():
        return {}
    kinds = ((kind, _part_of_kind(entries, word)) for kind, entries in _WORDS_BY_KIND.items())
    return {kind: match for kind, match in kinds if match}


def _part_of_kind(entries: Sequence[str], word: str) -> str:
    """The part of a word that is one of these, short ones of letters only at its beginning."""
    if word in entries or any(stem in entries and stem in word for stem in _STEMS):
        return word
    # "оси" is no part of "относительная"
    inner_words = (x for x in entries if not x.isascii() and x in word)
    return next((x for x in inner_words if len(x) > 3 or x >= "ぁ" or word.startswith(x)), "")


class _Name:
    """The words of a field and of what is around it, and the unit that they state."""

    def __init__(self, field: Field) -> None:
        base, unit = units.in_name(field.channel if field.path else field.label or field.channel)
        path, path_unit = units.in_name(re.sub(r"\[\d+\]", "", field.path))
        label, label_unit = units.in_name(field.label)
        unitless = base if unit else units.without_other_units(base)
        rare_unit = units.rare_unit(field.unit or units.unknown_in(field.label or field.channel))
        is_rare = rare_unit is not None and rare_unit.dimension in ("length", "power")
        own_unit = units.without_other_units(f"[{field.unit}]").strip()
        has_other_unit = unitless != base or not own_unit
        base = unitless
        label = label if label_unit else units.without_other_units(label)
        self.unit, self.unit_from = field.unit, field.unit_from
        if not self.unit:
            counted = units.unit(field.path)
            count = field.path if counted and counted.dimension == "count" else ""
            self.unit = path_unit or label_unit or unit or count
            self.unit_from = "in the name"
        for message_type, place, by_definition in _CONVENTIONS if not self.unit else ():
            if re.search(message_type, field.message_type) and re.search(place, field.path):
                self.unit, self.unit_from = by_definition, f"by definition of {field.message_type}"
                break
        if not path and (last_part := re.search(r"(?:/|\.(?! ))([^/.]{3,})$", base)):
            path = last_part[1]  # a topic and field written as one column header
        own_words = [w for w in name_words(path) if not w.isdecimal() and w not in GENERIC]
        around = [*name_words(base), *name_words(label), *name_words(field.group)]
        self.own = own_words or around
        if is_rare or has_other_unit:  # a V in volts is no speed by its letter
            letters = _MEASURED if is_rare else {"speed"}
            self.own = [w for w in self.own if len(w) > 1 or not letters & _kinds(w).keys()]
        self.kinds = _kinds_of(own_words + around)
        self.own_kinds = _kinds_of(self.own)
        if self.unit == "kn" and "speed" in self.own_kinds:  # as the unit of a force it is kN
            self.unit = "knots"
        percent = next((w for w in self.own if w in ("pct", "percent")), "")  # "brake_effort_pct"
        self.rare_unit = self.unit or units.unknown_in(field.label or field.channel) or percent

    def quantities(self) -> dict[str, str]:
        """What this may be, each with its unit.

        The unit decides; without a unit, the words. A unit that only a ratio or an acceleration
        has counts for these alone.
        """
        measured = units.unit(self.unit)
        may_be: tuple[str, ...] = ()
        if measured:
            may_be = _QUANTITY.get(measured.dimension, ())
        elif rare := units.rare_unit(self.rare_unit):
            may_be = _QUANTITY[rare.dimension]
        unit_of = {"any": self.unit} | dict.fromkeys(may_be, self.rare_unit)
        if not measured and not may_be:
            unit_of["state"] = self.unit
        if ("state" in unit_of or self.rare_unit == "-") and "no switch" not in self.own_kinds:
            unit_of["switch"] = self.unit
        if not measured and "temperature" not in may_be:
            if "force" in self.own_kinds:
                unit_of["force"] = self.unit
            if {"pressure", "cylinder"} & self.own_kinds.keys():
                unit_of["pressure"] = self.unit
            if "speed" in self.own_kinds:
                unit_of |= dict.fromkeys(_QUANTITY["speed"], self.unit)
                unit_of["speed without unit"] = self.unit
        elif measured and "pressure" in unit_of:
            names = {w for w in self.own if not (w.isdecimal() or _PLACES & _kinds(w).keys())}
            is_brake = bool(names) and all("braking" in _kinds(w) for w in names)  # "Brake 1 [bar]"
            says_cylinder = "cylinder" in self.kinds or names == {"c"} or is_brake
            if not (self.own_kinds.keys() & _PRESSURES or says_cylinder):
                del unit_of["pressure"]
            elif units.unit(f"{self.unit} abs"):
                unit_of["absolute pressure"] = f"{self.unit} abs"
        return unit_of

    def find(self, kind: str) -> str:
        """The word of this kind, "" for none; "own" asks only the words of the field itself."""
        if special := _SPECIAL.get(kind):
            return special(self)
        kinds = self.own_kinds if kind.startswith("own ") else self.kinds
        kind = kind.removeprefix("own ")
        hits = (kinds[x[0]] for x in _PAIRS.get(kind, [[kind]]) if all(k in kinds for k in x))
        return next(hits, "")

    def matches(self, pattern: str) -> list[str] | None:
        """The words that fulfil a row's conditions, None where one of them is not fulfilled."""
        matched = []
        for sign, kinds in _conditions(pattern):
            match = next((word for kind in kinds if (word := self.find(kind))), "")
            if (sign == "!") == bool(match) and sign != "?":
                return None
            matched += [match] if match else []
        return matched


@cache
def _conditions(pattern: str) -> list[tuple[str, list[str]]]:
    """A row's words as pairs: "!", "?" or neither, and the alternative kinds."""
    conditions = [condition.strip() for condition in pattern.split(",")]
    return [(phrase[:1], phrase.lstrip("!?").split("|")) for phrase in conditions]


def _wheel(name: _Name) -> str:
    """The word for wheel or axle; that of the topic only where the field does not say train."""
    around = "" if "train" in name.own_kinds else name.kinds.get("wheel", "")
    return name.own_kinds.get("wheel", around)


def _adhesion_force(name: _Name) -> str:
    """The word that calls this an adhesion force, "" where none does.

    It is next to the word for a force, or the only word but for an axle. A force for an adhesion
    test is no adhesion force.
    """
    terms = [w for w in name.own if not (w.isdecimal() or {"true", "actual"} & _kinds(w).keys())]
    for i, word in enumerate(terms):
        neighbours = terms[max(0, i - 1) : i + 2]
        if word_of_kind("adhesion", [word]) and word_of_kind("force", neighbours):
            return word
    unexplained = [w for w in terms if not {"wheel", "bogie"} & _kinds(w).keys()]
    return word_of_kind("adhesion", unexplained) if len(unexplained) == 1 else ""


# Kinds that no single word decides.
_SPECIAL: Mapping[str, Callable[[_Name], str]] = {
    "wheel": _wheel,
    "adhesion force": _adhesion_force,
    "true force": lambda name: name.own_kinds.get("force", "") if "true" in name.kinds else "",
    "track brake": lambda name: "".join(_TRACK_BRAKE.findall(" ".join(name.own))[:1]),
}


@lru_cache(1 << 15)  # `inspect` asks twice
def guess(field: Field) -> Guess:
    """What a field means, by its name; by its type in a result of this program."""
    if field.message_type.startswith("adhesion.") and field.message_type != "adhesion.Scalar":
        return _own_message(field)  # a Scalar is any channel of a converted or simulated log
    field = _without_device(field)
    name, place = _Name(field), place_of(field)
    axle = place.axle
    if axle is not None:
        name.kinds.pop("actual", None)  # "vR_1_ist" is a wheel's
    if place.part and axle is not None and "car" in _kinds(name.kinds.get("train", "")):
        name.kinds.pop("train")  # "Car 1 v2" is a wheel of that car
        name.own_kinds.pop("train", None)
    quantities = name.quantities()
    for rule in RULES:
        unit = next((quantities[x] for x in rule.quantity.split("|") if x in quantities), None)
        matched = name.matches(rule.pattern) if unit is not None else None
        if unit is None or matched is None:
            continue
        if not rule.meaning:
            return Guess(None, axle, unit, rule.reason.format(*matched))
        # A number next to the train numbers channels, unless the name says axle.
        numbered = field.group or "wheel" in name.kinds
        if rule.quantity == "acceleration" or (rule.meaning == "train_speed" and not numbered):
            axle = None
        if rule.reason in (_NAMED, _FOR_STOPS, _ABOVE_ZERO) and not _OF_AXLE & name.kinds.keys():
            axle = None
        names = " and ".join(repr(word) for word in dict.fromkeys(matched))
        source = f"unit {unit}: {name.unit_from or 'in the name'}" if unit else "no unit stated"
        reasons = f"name has {names}" if names else "", source, rule.reason
        return Guess(rule.meaning, axle, unit, "; ".join(filter(None, reasons)))
    return Guess(None, axle, name.unit, NO_NAME)


def says_state(cells: tuple[str, ...]) -> bool:
    """Whether one of these words of a column is known as that of a state."""
    states = OFF_STATES | ON_STATES | CLOSED_STATES | OPEN_STATES
    return any(word.casefold() in states for word in cells)


def names_brake(column: str) -> bool:
    """Whether a column of this name is a speed, a brake pressure or a clamping force.

    >>> names_brake("BC pressure"), names_brake("Temperatur"), names_brake("3.5")
    (True, False, False)
    """
    meanings = ("wheel_speed", "train_speed", "pressure", "clamping_force")
    return guess(Field(column)).meaning in meanings


def names_place(name: str) -> bool:
    """Whether a name is one of an axle, a bogie or a car, by a word and its number.

    >>> names_place("Axle 2"), names_place("DG 1"), names_place("Run 2"), names_place("50 Hz")
    (True, True, False, False)
    """
    place = place_of(Field(name))
    return bool(place.part or place.bogie or (place.axle is not None and not place.is_loose))


def _own_message(field: Field) -> Guess:
    """What a field of a result of this program means."""
    place = re.search(r"/axle/(\d+)/", field.channel)
    axle, kind = int(place[1]) if place else None, field.message_type
    meaning, unit = _OWN_MESSAGES.get((kind, field.path), (None, field.unit))
    reason = f"by definition of {kind}" if meaning else f"{kind}: no input of an analysis"
    return Guess(meaning, axle, unit, reason)


class Place(NamedTuple):
    """Where on the train a channel is measured, by the numbers in its names."""

    axle: int | None
    bogie: int | None
    part: str  # the car, or the control unit: "car 2"; "" for none
    is_loose: bool = False  # no word says that the axle's number is one
    is_number_apart: bool = False  # nor is it behind the quantity
    spare: int | None = None  # a number that may be the axle's, if other channels say so


@lru_cache(1 << 15)
def place_of(field: Field) -> Place:
    """Where on the train the names say that a channel is measured."""
    spare_numbers = [int(next(filter(None, m))) for m in _SPARE.findall(field.channel)]
    field = _without_device(field)
    group, word_kinds = field.group, {"wheel", "cylinder", "bogie", "car"}
    # A folder "CAN 1" is no axle; "axle 1" is one.
    if field.folder and not word_kinds & _kinds_of(name_words(group)).keys():
        group = ""
    texts = (group, field.label, field.path, field.channel)
    places = [_place_in(text, text == field.path) for text in texts if text]
    numbered = next((p for p in places if p.axle is not None), Place(None, None, ""))
    bogie = next((p.bogie for p in places if p.bogie is not None), None)
    owner = next((p.part for p in places if p.part), "")
    spare = next(reversed([*spare_numbers, *(p.spare for p in places if p.spare)]), None)
    return numbered._replace(bogie=bogie, part=owner, spare=spare)


def _place_in(text: str, is_path: bool) -> Place:
    name = re.sub(_CHINESE_PLACES, lambda m: str(_CHINESE_NUMBERS[m[0]]), units.in_name(text)[0])
    name = _PLACE_CODE.sub(lambda m: f" car {m[1] or ''} bogie {m[2]} axle {m[3]} ", name)
    name, pair = _without_axles(_NO_COUNT.sub(" ", _DEVICE.sub(" ", name)))
    name_parts = _numbered(name_words(name))
    while _take_number(name_parts, "run")[1]:
        pass  # a second run has the same axles
    bogie = _take_number(name_parts, "bogie")[1] or pair
    owners = [_take_number(name_parts, "car")]
    while (unit := _take_number(name_parts, "control unit"))[1]:  # "cDAQ1Mod3/ai2" has several
        owners.append(unit)
    owner = " ".join(f"{word} {number}" for word, number in owners if number)
    word, number = [*name_parts[:2], "", ""][:2]
    axle, is_loose, is_number_apart = _axle_in(["", "", *name_parts[2:]], text, is_path)
    is_loose &= f" a {axle} " not in f" {' '.join(name_parts)} "  # as in "M1 BCP A1"
    has_place = bogie or (axle is not None and not is_loose)
    is_two_digits = number.isdecimal() and len(number) < 3  # PT101 is a sensor
    if has_place and not owner and is_two_digits and _is_code(word):  # as in "CW1", "DM1"
        owner = f"{word} {number}"
    else:
        axle, is_loose, is_number_apart = _axle_in(name_parts, text, is_path)
    bogie = str(_COUNTS.get(bogie, bogie))
    spare = 2 * int(pair) - 1 if pair else _letter(name_parts)  # "1/2" may be the first of two
    bogie_number = int(bogie) if 0 < len(bogie) < 3 else None
    return Place(axle, bogie_number, owner, is_loose, is_number_apart, spare)


def _numbered(name_parts: Sequence[str]) -> list[str]:
    """The words, with "front bogie" and "axle rear" as "bogie 1" and "axle 2"."""
    numbered_words = list(name_parts)
    for i, word in enumerate(name_parts):
        number = "1" * ("front" in _kinds(word)) or "2" * ("rear" in _kinds(word))
        for k in (i + 1, max(i - 1, 0)) if number else ():
            is_counted = "".join(name_parts[k + 1 : k + 2]).isdecimal()  # as in "front axle 3"
            if not is_counted and {"wheel", "bogie"} & _kinds("".join(name_parts[k:][:1])).keys():
                numbered_words[min(i, k) : max(i, k) + 1] = name_parts[k], number
                break
    return numbered_words


def _letter(name_parts: Sequence[str]) -> int | None:
    """What a letter counts behind a wheel or cylinder, or behind a quantity at the end."""
    tokens = [*filter(None, name_parts), ""]
    for previous_word, word, next_word in zip(tokens, tokens[1:], tokens[2:], strict=False):
        kinds = _NUMBERED if next_word else _NUMBERED | _MEASURED
        if word in _COUNTS and kinds & _kinds(previous_word).keys():
            return _COUNTS[word]
    return None


def _without_axles(name: str) -> tuple[str, str]:
    """The name without several axles, as in "axles 1-4"; and their bogie, if they are its two."""
    for m in _AXLES.finditer(name):
        first_axle, last_axle, is_slash = int(m[2]), int(m[4]), m[3] == "/"
        # "axle 1/4" may be one of four
        kinds = {"cylinder", "pressure"} | ({"wheel"} if not is_slash else set())
        if last_axle <= first_axle or not kinds & _kinds(m[1].lower()).keys():
            continue
        if first_axle % 2 and last_axle == first_axle + 1:
            return name[: m.start(2)] + name[m.end() :], str(last_axle // 2)
        if not is_slash:
            return name[: m.start(2)] + name[m.end() :], ""
    return name, ""


def _take_number(name_parts: list[str], kind: str) -> tuple[str, str]:
    """The first word of this kind and the number next to it; the list has "" in their places.

    Chinese names have the number in front: "2架". Other names have it there only of a bogie, and
    where it is not an axle's.
    """
    for i, word in enumerate(name_parts):
        owner = _owner(kind, name_parts[i : i + 3])
        if not owner:
            continue
        index_before = [i - 1] if i and name_parts[i - 1].isdecimal() else []
        after, number = [*name_parts[i + 1 : i + 3], "", ""][:2]
        has_code = kind == "car" and _is_code(after) and number.isdecimal()  # as in "Car DM1"
        if has_code:
            name_parts[i + 1 : i + 3] = [after + number]
        letters = {"car": _LETTERS, "bogie": _COUNTS}.get(kind, {})
        has_letter = after in letters  # as in "Car B"
        index_after = [i + 1] if after.isdecimal() or has_letter or has_code else []
        if word >= "一":
            numbers = index_before + index_after
        else:
            of_axle = i > 1 and _NUMBERED & _kinds(name_parts[i - 2]).keys()
            is_letter = kind == "car" and i > 0 and name_parts[i - 1] in _LETTERS  # as in "A-car"
            takes_number_before = kind == "bogie" and not of_axle
            numbers = index_after + (index_before if takes_number_before else [i - 1] * is_letter)
        if numbers or kind == "bogie":
            number = name_parts[numbers[0]] if numbers else ""
            for j in (i, *numbers[:1]):
                name_parts[j] = ""
            return owner, number
    return "", ""


def _is_code(word: str) -> bool:
    """Whether a word may be a short code of a car or a device."""
    return word.isalpha() and len(word) < 4 and not _kinds(word)


def _owner(kind: str, name_parts: Sequence[str]) -> str:
    """The first of these words, if a number next to it counts things of this kind; else ""."""
    word, *following = name_parts
    if kind == "car" and word in ("m", "t", "r"):  # "M1/2", "R2 axle 1", but not "pressure m 2"
        number, behind = [*following, "", ""][:2]
        is_car = (behind.isdecimal() and word != "r") or {"wheel", "bogie"} & _kinds(behind).keys()
        return word if number.isdecimal() and is_car else ""
    if kind == "car" and re.match("号[車车]|[節节]?[車车](?![速轮輪轴軸辆輌])", word):
        return "车"
    return word_of_kind(kind, [word])


def _axle_in(name_parts: Sequence[str], text: str, is_path: bool) -> tuple[int | None, bool, bool]:
    """The number next to a word for wheel or cylinder; else behind a quantity, or the last one.

    Then whether no word says that it is an axle's, and whether it is behind no quantity either.
    """
    after_quantity: list[int] = []
    for i, word in enumerate(name_parts):
        next_word = "".join(name_parts[i + 1 : i + 2])
        if next_word.isdecimal() and _NUMBERED & _kinds(word).keys():
            return int(next_word), False, False
        if any(c in word for c in "轴軸轮輪位") and i and name_parts[i - 1].isdecimal():
            return int(name_parts[i - 1]), False, False
        is_single = next_word.isdecimal() and not "".join(name_parts[i + 2 : i + 3]).isdecimal()
        if is_single and len(next_word) < 3 and _MEASURED & _kinds(word).keys():
            after_quantity.append(int(next_word))
    if after_quantity:
        return after_quantity[0], True, False
    digits = [w for w in name_parts if w.isdecimal() and len(w) < 3]
    if digits and not (is_path and text.endswith("]")):
        return int(digits[-1]), True, True
    match = re.search(r"\[(\d+)\](\.\w+)?$", text)
    return (int(match[1]) + 1 if match else None), False, False  # a list counts from 0


def _without_device(field: Field) -> Field:
    r"""The field without a device at its names, as in "WheelSpeed2\CAN-Monitoring:1", "{[PLC]v}".

    Of the labels of a series, in braces, those of an axle, bogie or car and the names stay.
    """
    names = (_LABELS.sub(_own_label, x) for x in (field.channel, field.label))
    channel, label = (_AT_DEVICE.sub("", x) for x in names)
    return replace(field, channel=channel, label=label)


def _own_label(match: re.Match[str]) -> str:
    """A label of a series, "" where it says nothing of a place and is no name."""
    key, value = match[1], _kinds_of(name_words(match[3])).keys()
    of_place = _kinds_of(name_words(key)).keys() & _PLACES
    is_name = value & {"wheel", "bogie", "cylinder"} or (value and key.lower() in _NAMING)
    return match[0] if of_place or is_name else ""
