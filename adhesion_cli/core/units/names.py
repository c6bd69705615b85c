"""The unit in the name of a channel."""

import re
from collections.abc import Sequence
from functools import lru_cache

from ..model import Meaning
from .spelling import IN_NAMES, NUMBER, TIMES, unit, unit_for

_BRACKETS = re.compile(r"[\[(（【{<]\s*([^\[\](){}（）【】<>]*(?:\((?:[ag]|rel)\))?)\s*[\])）】}>]")

# Units of what is not asked for, with the letters of names: volts are no v, kelvins no K.
_OTHER_QUANTITIES = re.compile(
    r"[\[(（]\s*(?:[mkµμ]?[VAW]|V(?:AC|DC)|K)\s*[\])）]"
    r"|(?<=[^\W_])_[mk]?V$|(?<![^\W_])(?:5|\d{2,}|\d[.,]\d)V(?![^\W_])"
)


# The same at the end of a name, where a sign or a decimal says that the number is no axle's;
# and a number that may be a range, as in "sensor 10bar".
_FACTOR_AT_END = re.compile(
    rf"(?i)(?:\sin\s+|\s*[/,]\s*|[\s_](?={TIMES}|\d+[.,]\d|1\s*/\s*\d))"
    rf"(?P<text>{TIMES}?\s*(?:1\s*/\s*)?{NUMBER}[\s_]*[^\W\d_]\S*)$"
)
_RANGE_AT_END = re.compile(
    r"(?i)(?<!axle)(?<!achse)(?<!wheel)[\s_](?P<text>(?:\d{2,}|10+\s+)[^\W\d_]\S*)$"
)
_FACTOR_BEFORE_BRACKET = re.compile(rf"[\s_](?P<factor>{TIMES}\s*{NUMBER})$")


def _has_factor_unread(text: str) -> bool:
    """Whether a text is a unit with a number of which it is not known what it does: "bar x10"."""
    pieces = re.split(rf"[-\d.,\s/…]+|{TIMES}", text)
    return any(c.isdigit() for c in text) and any(map(unit, pieces))


# Of "[bar] x10" it is not known whether the values are to be multiplied, or are already.
_FACTOR_BEHIND_BRACKET = re.compile(rf"\s*(?:{TIMES}|/)\s*{NUMBER}\s*$")


def unknown_in(name: str) -> str:
    """What a name has in its last brackets, if it is no known unit and no index, "" for nothing."""
    suffix = re.split(r"[\])）】}>]", name)[-1]
    if suffix and suffix != name and _FACTOR_BEHIND_BRACKET.match(suffix):
        return f"{_BRACKETS.findall(name)[-1]}{suffix}"
    match = _RANGE_AT_END.search(name.strip())
    if match and _has_factor_unread(match["text"]):
        return match["text"]
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
            if factor and unit(scaled_text := f"{factor['factor']} {match[1].strip()}"):
                return base[: factor.start()].strip(" _-,/"), scaled_text
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
        r"(?<=[a-z])(?<![^a-z][kKhmM])(Kmh|Mps|Rpm|[kKhM][Pp]a|Bar|[mM][bB]ar|RadS|Pa|k?Hz)(?=\d*$)",
        name,
    )
    if camel and (tail_found := unit(camel[1].replace("RadS", "rad_s"))):
        return name[: camel.start()] + name[camel.end() :], tail_found.name
    return name, ""


def contradicting(text: str, names: Sequence[str], meaning: Meaning) -> str:
    """A unit of this meaning that one of the names states instead of that of `text`, "" for none.

    Only `text` need say that a pressure counts from vacuum.
    """
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
