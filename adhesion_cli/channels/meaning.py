"""What a log's fields mean: brake-cylinder pressure, wheel speed, ED brake, distance; and why.

A mapping from the user decides, else the names. Every guess has its reason, which `inspect` shows.
"""

import re
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from itertools import product

from ..core import model, toml, units
from ..core.errors import UserError, unknown
from ..core.finding import Finding, Severity
from ..core.model import INPUTS, MOTOR_FORCES, OTHER_BRAKES, STATES, Meaning, Parameter
from ..core.text import enumerated
from ..formats.source import Field
from .places import UNCLEAR, served
from .rules import (
    GENERIC,
    Place,
    abbreviations_of,
    guess,
    name_words,
    place_of,
    says_state,
    spelled_out,
    word_of_kind,
)


@dataclass(frozen=True, slots=True)
class Mapping:
    """One line of `[channels]`, for one axle: this channel means that.

    Without a channel it states unit, zero and delay of the channel whose name has this meaning;
    without an axle, of every such channel.
    """

    meaning: Meaning
    axle: int | None
    channel: str
    field: str = ""
    unit: str = ""
    group: str = ""
    teeth: int = 0  # pulses per turn of a pulse counter or pulse rate
    wrap: float = 0.0  # where a cumulative counter starts anew; 0: 2¹⁶ or 2³², by its values
    zero: Parameter | None = None  # what the sensor measures of nothing, in its unit
    delay: Parameter | None = None  # of a train speed [s]
    # of an ED or traction force:
    place: str = ""  # "vehicle", "bogie 1": whose it is; it is spread over its axles
    axles: tuple[int, ...] = ()  # over these; all of the vehicle, or the two of a bogie
    arm: float = 0.0  # lever of a torque [m]; 0: the wheel radius
    full_force: float = 0.0  # the force of 100 % [N]
    tolerance: float = model.MOTOR_TOLERANCE  # 1 sigma, as a share


Mappings = dict[Field, list[Mapping]]  # what the user states of each field


@dataclass(frozen=True, slots=True)
class Meant:
    """A field with its meaning, or with the reason why it has none."""

    field: Field
    meaning: Meaning | None
    axle: int | None
    unit: str
    reason: str
    teeth: int = 0
    wrap: float = 0.0
    zero: Parameter | None = None  # taken off, in its unit; None where nobody states it
    unit_too: str = ""  # another unit that its name states, where nobody says which one holds
    share: float = 1.0  # of a force, which is this axle's
    mapping: Mapping | None = None  # what the user states of it
    delay: Parameter | None = None  # of a train speed [s]; None where nobody states it

    def without(self, reason: str) -> "Meant":
        """The field without a meaning, for this reason."""
        return replace(self, meaning=None, reason=reason)

    @property
    def title(self) -> str:
        """The field's name for people."""
        return title(self.field)

    @property
    def describe(self) -> str:
        """What it means, for people."""
        return (self.meaning or "").replace("_", " ").replace("ed f", "ED f")


_WORDED_MEANINGS: tuple[Meaning | None, ...] = (*STATES, *OTHER_BRAKES)  # which words may state
_SENSOR = re.compile(r"(?i)(?:sensor|channel|encoder|geber|kanal)[ _]?([12])(?!\d)")
_MOST_NAMED = 20  # channels that one finding names


def understood(
    fields: Sequence[Field], mappings: Sequence[Mapping]
) -> tuple[list[Meant], list[Finding]]:
    """Gives each field its meaning, once per axle that it serves.

    The order is that of the fields; further axles by a name stand behind all of them.

    Raises:
        UserError: for a mapping to a channel or field the log does not have.
    """
    fields = _each_once(fields)
    by_hand: Mappings = {}
    for mapping in mappings:
        for field, m in _find(fields, mapping) if mapping.channel else []:
            by_hand.setdefault(field, []).append(m)
    channels, abbreviations = {f.channel for f in fields}, abbreviations_of(fields)
    meant: list[Meant] = []
    guesses: list[int] = []
    for field in fields:
        own_mappings = by_hand.get(field, [])
        if field.words and not (own_mappings or _is_state(field)):
            continue
        ungrouped = replace(field, group="") if field.encoding else field  # see Field.group
        meaning, axle, unit, reason = guess(spelled_out(ungrouped, abbreviations))
        base = re.fullmatch(r"(.*?)(?: \(\d+\)|\.\d+)", field.channel)
        if base and base[1] in channels:  # the reader added "(2)", or pandas ".1"
            axle = place_of(replace(ungrouped, channel=base[1])).axle
        if field.path.count("[") > 1:
            meaning, reason = None, "a list in a list: state its axle in [channels]"
        if meaning and all(m.meaning == meaning for m in own_mappings):  # it counts with the others
            guesses.append(len(meant))
        unit_conflict = _unit_too(field, meaning, unit) if meaning and meaning in INPUTS else ""
        meant.append(Meant(field, meaning, axle, unit, reason, unit_too=unit_conflict))
    _own_stamps(meant, guesses)
    _prefer_the_measured(meant, guesses)
    _drop_other_numbers(meant, guesses)
    _take_spare_numbers(meant, guesses)
    _prefer_the_qualified(meant, guesses)
    _speed_itself(meant, guesses)
    findings = _count_from_one(meant, guesses, by_hand)
    _drop_sums(meant, guesses)
    findings += _assign_axles(meant, guesses, by_hand)
    meant, guesses = _apply_mappings(meant, guesses, by_hand)
    findings += _spread_forces(meant, guesses)
    findings += _refuse_repeated(meant, guesses)
    _apply_statements(meant, set(guesses), mappings)
    return meant, findings


def _apply_mappings(
    meant: Sequence[Meant], guesses: Collection[int], by_hand: Mappings
) -> tuple[list[Meant], list[int]]:
    """The fields with what the user states of them, and which of them are still guesses.

    A channel that is stated for one axle leaves the other axles theirs. One that is stated for no
    axle is the only one of its meaning, and so is each force of motors: they are added.
    """
    mapped_axles = _mapped_axles(by_hand)
    meanings = {meaning for meaning, _ in mapped_axles}
    rows: list[Meant] = []
    guess_rows: list[int] = []
    written_fields: set[Field] = set()
    for i, m in enumerate(meant):
        if m.field in by_hand:
            if m.field not in written_fields:
                rows += [_as_stated(m.field, x) for x in by_hand[m.field]]
                written_fields.add(m.field)
            continue
        is_only_channel = (
            m.axle is None or (m.meaning, None) in mapped_axles or m.meaning in MOTOR_FORCES
        )
        if (m.meaning, m.axle) in mapped_axles or (m.meaning in meanings and is_only_channel):
            m = m.without(f"[channels] names another {m.meaning}")
        elif i in guesses:
            guess_rows.append(len(rows))
        rows.append(m)
    return rows, guess_rows


def _mapped_axles(by_hand: Mappings) -> set[tuple[Meaning, int | None]]:
    """The meanings and axles for which the user states a channel."""
    return {(m.meaning, m.axle) for mappings in by_hand.values() for m in mappings}


def _each_once(fields: Sequence[Field]) -> Sequence[Field]:
    """The fields; of numbers that have words the words where they are a state, else the numbers."""
    worded_field = {replace(f, words=()): f for f in fields if f.words}
    repeated_fields = worded_field.keys() & set(fields)

    def is_read(field: Field) -> bool:
        number = replace(field, words=()) if field.words else field
        return number not in repeated_fields or bool(field.words) == _is_state(worded_field[number])

    return list(filter(is_read, fields))


def _is_state(field: Field) -> bool:
    return guess(field).meaning in _WORDED_MEANINGS and says_state(field.words)


def _apply_statements(
    meant: list[Meant], guesses: Collection[int], mappings: Sequence[Mapping]
) -> None:
    """Gives channels the zero, delay and, if guessed, unit that lines without a channel state."""
    for m in sorted((m for m in mappings if not m.channel), key=lambda m: m.axle or 0):
        named = [i for i, channel in enumerate(meant) if channel.meaning == m.meaning]
        matching = [i for i in named if m.axle in (None, meant[i].axle)]
        if named and not matching:
            key = f"channels.{_key(m.meaning, m.axle)}"
            line = f"{key}.channel = {toml.quoted(meant[named[-1]].field.channel)}"
            hint = f"name it, as {toml.option(line)}"
            raise UserError(f"{key} names no channel, and no name says this axle", hint, code=2)
        for i in matching:
            target, is_guess = meant[i], i in guesses
            zero = (m.zero or target.zero) if m.axle else (target.zero or m.zero)
            mapping = m if is_guess else target.mapping
            target = replace(target, zero=zero, delay=target.delay or m.delay, mapping=mapping)
            if is_guess and m.unit:
                reason = target.reason.removesuffix("; no unit stated")
                reason += f"; unit {m.unit}: in [channels]"
                target = replace(target, unit=m.unit, unit_too="", reason=reason)
                target = replace(target, teeth=m.teeth, wrap=m.wrap)
            meant[i] = target


def _as_stated(field: Field, m: Mapping) -> Meant:
    unit = m.unit or field.unit
    reason = "stated in [channels]" if m.unit else f"[channels]; unit {field.unit_from}"
    if not unit:
        unit, reason = guess(field).unit, "stated in [channels]; unit in the name"
    unit_conflict = "" if m.unit else _unit_too(field, m.meaning, unit)
    meant = Meant(field, m.meaning, m.axle, unit, reason, m.teeth, m.wrap, m.zero, unit_conflict)
    return replace(meant, delay=m.delay, mapping=m)


def _unit_too(field: Field, meaning: Meaning, unit: str) -> str:
    """Another unit that the names of a field state, "" for none."""
    if field.message_type.startswith("adhesion."):
        return ""  # its name is that of a log that had other units
    return units.contradicting(unit, (field.path, field.label, field.channel), meaning)


def _own_stamps(meant: list[Meant], guesses: list[int]) -> None:
    """In a result, pressure and train speed as logged are preferred to those at wheel stamps."""
    scalars = (meant[i] for i in guesses if meant[i].field.message_type == "adhesion.Scalar")
    stamped = {(m.meaning, m.axle) for m in scalars}
    for i in guesses:
        m = meant[i]
        matching = stamped & {(m.meaning, m.axle), (m.meaning, None)}
        if m.field.message_type == "adhesion.AxleInput" and matching:
            meant[i] = m.without("its own stamps are in the file as well")


def _prefer_the_measured(meant: list[Meant], guesses: list[int]) -> None:
    """'BCP 1 max', 'BCP 1 model' and 'mean BCP' give way to channels that say no such thing."""
    meanings = ("pressure", "wheel_speed", "train_speed")
    for meaning, kind in product(meanings, ("extreme", "derived")):
        fields = {i: meant[i].field for i in guesses if meant[i].meaning == meaning}
        names = {i: (units.in_name(x)[0] for x in (f.channel, f.path)) for i, f in fields.items()}
        field_words = {i: name_words(" ".join(x)) for i, x in names.items()}
        derived = {i: x for i, w in field_words.items() if (x := word_of_kind(kind, w))}
        for i, word in derived.items() if 3 * len(derived) <= 2 * len(field_words) else ():
            meant[i] = meant[i].without(f"{word!r} in the name, and others are measured")


def _prefer_the_qualified(meant: list[Meant], guesses: list[int]) -> None:
    """'pressure' gives way to 'BC pressure'; 'speed' is the train's where a wheel's is named.

    Where no name has such a word, those with numbers of axles are the qualified.
    """

    def split(meaning: Meaning, *kinds: str) -> tuple[list[int], list[int]]:
        """The guesses of this meaning whose names have the first kind of word, and the others."""
        fields = {i: meant[i].field for i in guesses if meant[i].meaning == meaning}
        texts = {i: f"{f.channel} {f.path} {f.label} {f.group}" for i, f in fields.items()}
        field_words = {i: name_words(text) for i, text in texts.items()}
        of_kinds = ([i for i in fields if word_of_kind(k, field_words[i])] for k in kinds)
        named = next(filter(None, of_kinds), [])
        numbered = [i for i in fields if meant[i].axle is not None]
        if not named and len(numbered) > 1:
            named = [i for i in fields if i in numbered or any(place_of(fields[i])[1:3])]
        return named, [i for i in fields if i not in set(named)]

    named, unqualified = split("pressure", "cylinder", "braking")
    for i in unqualified if named else []:
        meant[i] = meant[i].without("a pressure, and others are the brake cylinders'")
    named, unqualified = split("wheel_speed", "wheel")
    for i in unqualified if named else []:
        unit = units.unit(meant[i].unit)
        if unit is None or unit.dimension == "speed":
            has_train = any(m.meaning == "train_speed" for m in meant) or meant[i].axle
            reason = "a speed, and others are the wheels'"
            meaning: Meaning | None = None if has_train else "train_speed"
            meant[i] = replace(meant[i], meaning=meaning, axle=None, reason=reason)


def _speed_itself(meant: list[Meant], guesses: list[int]) -> None:
    """A lone speed beside satellites is the train's; an acceleration only if no speed is logged."""
    speeds = [i for i in guesses if meant[i].meaning in ("wheel_speed", "train_speed")]
    by_satellite = any(word_of_kind("satellites", name_words(m.title)) for m in meant)
    lone_speed = meant[speeds[0]] if len(speeds) == 1 and by_satellite else None
    if lone_speed and lone_speed.axle is None and not _is_of_each(lone_speed):
        unit = units.unit(lone_speed.unit)
        if unit is None or unit.dimension == "speed":
            reason = f"{lone_speed.reason}; its log counts satellites"
            meant[speeds[0]] = replace(lone_speed, meaning="train_speed", reason=reason)
    trains = [i for i, m in enumerate(meant) if m.meaning == "train_speed"]
    rates = [i for i in trains if units.is_acceleration(meant[i].unit)]
    for i in rates if len(rates) < len(trains) else []:
        if i in guesses:
            reason = "an acceleration, not needed: the log has the train's speed itself"
            meant[i] = meant[i].without(reason)


def _drop_other_numbers(meant: list[Meant], guesses: list[int]) -> None:
    """Drops numbers that need not be an axle's: they stand apart from axle and quantity.

    They are those of axles where they tell the channels of a meaning apart, or are the axle of a
    channel of another meaning. Else they may be those of a sensor, as in "pressure (S-20)".
    """
    places = {i: place_of(meant[i].field) for i in guesses if meant[i].axle is not None}
    axles: dict[Meaning | None, list[Place]] = {}
    for i, place in places.items():
        own_place = place._replace(axle=meant[i].axle, is_loose=False, is_number_apart=False)
        axles.setdefault(meant[i].meaning, []).append(own_place)
    for i in (i for i, place in places.items() if place.is_number_apart):
        m = meant[i]
        own_places = axles[m.meaning]
        is_single = len(set(own_places)) == len(own_places)
        other_places = (x for meaning, x in axles.items() if meaning != m.meaning)
        is_shared = any(m.axle == place.axle for x in other_places for place in x)
        if not is_single or not (is_shared or len(own_places) > 1):
            meant[i] = replace(m, axle=None)


def _take_spare_numbers(meant: list[Meant], guesses: list[int]) -> None:
    """Takes numbers of inputs and labels as axles where nothing else tells channels apart.

    The numbers of pressures must be those of the speeds' axles. "BCP 1/2" is that of axle 1 where
    another channel is that of axle 2.
    """
    speed_axles: set[int | None] = set()
    for meaning in ("wheel_speed", "pressure"):
        places = {i: place_of(meant[i].field) for i in guesses if meant[i].meaning == meaning}
        axles = {meant[i].axle for i in places}
        unnamed = [i for i, p in places.items() if meant[i].axle is None and not p.bogie]
        numbers = {p.spare for p in places.values()}
        has_cars = any(p.part for p in places.values())
        is_likely = numbers == speed_axles or not (meaning == "pressure" or has_cars)
        has_own_numbers = len(unnamed) == len(places) == len(numbers) > 1 and None not in numbers
        for i, p in places.items():
            is_one_of_two = p.bogie and meant[i].axle is None and 2 * p.bogie in axles
            if p.spare is not None and ((has_own_numbers and is_likely) or is_one_of_two):
                meant[i] = replace(meant[i], axle=p.spare)
        speed_axles = {meant[i].axle for i in places}


def _count_from_one(meant: list[Meant], guesses: list[int], by_hand: Mappings) -> list[Finding]:
    """Channels that number axles from 0 move up by one; that is reported of those not stated.

    Channels of another meaning move with them if their numbers do not reach further. With speeds 0
    and 1 and pressures 1 and 2, the pressures count from 1. Indices in brackets and numbers in
    names are judged separately.
    """
    shifted: list[int] = []
    for indexed in (False, True):
        by_meaning: dict[Meaning | None, list[int]] = {}
        for i in guesses:
            m = meant[i]
            if m.meaning in INPUTS and m.axle is not None and _is_indexed(m.field) is indexed:
                by_meaning.setdefault(m.meaning, []).append(i)
        numbers = {x: [meant[i].axle or 0 for i in indices] for x, indices in by_meaning.items()}
        highest = max((max(n) for n in numbers.values() if 0 in n), default=-1)
        for meaning, indices in by_meaning.items():
            shifted += indices if max(numbers[meaning]) <= highest else []
    for i in shifted:
        meant[i] = replace(meant[i], axle=(meant[i].axle or 0) + 1)
    shifted = [i for i in shifted if meant[i].field not in by_hand]
    if not shifted:
        return []
    names = [meant[i].title for i in sorted(shifted)]
    suffix = f" and {len(names) - 3} more" if len(names) > 3 else ""
    values = {"channels": ", ".join(names[:3]) + suffix, "option": _as_option(meant[shifted[0]])}
    return [Finding("axles-from-zero", "info", count=len(shifted), names=values)]


def _is_indexed(field: Field) -> bool:
    """Whether a field's axle is its index in a list, as `speed[1]`, not a number in its name."""
    by_label = any(c.isdigit() for c in field.label)
    named = field.label if by_label else field.path or units.in_name(field.channel)[0]
    return re.search(r"\[\d+\](\.\w+)?$", named) is not None


def _assign_axles(meant: list[Meant], guesses: list[int], by_hand: Mappings) -> list[Finding]:
    """Gives each channel the axles that it serves by its name and by those of the others.

    It does not serve those for which the user states another one. What is found of channels that
    the user states is not reported.
    """
    findings, counted_on = [], []
    mapped_axles = _mapped_axles(by_hand)
    channels = {
        i: (m.meaning, place_of(m.field)._replace(axle=m.axle))
        for i, m in ((i, meant[i]) for i in guesses)
        if m.meaning and (m.field.message_type or "Scalar").endswith("Scalar")
    }
    for i, (axles, is_counted_on) in served(channels).items():
        m = meant[i]
        if axles is None:
            meant[i] = m.without(UNCLEAR)
            continue
        has_mapping = m.field in by_hand
        axles = (
            tuple(a for a in axles if has_mapping or (m.meaning, a) not in mapped_axles) or axles
        )
        if is_counted_on and not has_mapping:
            counted_on.append((replace(m, axle=axles[0]), axles))
        if m.meaning in MOTOR_FORCES and axles and not _is_of_each(m):
            m = replace(m, share=1.0 / len(axles))
        for axle in axles[1:]:
            guesses.append(len(meant))
            meant.append(replace(m, axle=axle))
        if axles:
            meant[i] = replace(m, axle=axles[0])
        if m.meaning in MOTOR_FORCES and len(axles) > 1 and not has_mapping:
            findings.append(_spread_finding(m, axles, axles))
        elif len(axles) > 1 and not has_mapping:
            key = f"channels.{m.meaning}.bogie{(axles[0] + 1) // 2}"
            lines = f"{key} = {toml.table(entry_of(m.field))}", f"{key}.axles = {[*axles]}"
            names = {"axles": enumerated(axles), "option": toml.option(*lines)}
            findings.append(Finding("bogie-pressure", "info", channel=m.title, names=names))
    if counted_on:
        shared_channel, axles = counted_on[0]
        names = {"example": f"{shared_channel.title}: {', '.join(map(str, axles))}"}
        names["option"] = _as_option(shared_channel)
        findings.append(Finding("axles-counted-on", "info", count=len(counted_on), names=names))
    return findings


def _drop_sums(meant: list[Meant], guesses: list[int]) -> None:
    """Of the forces of motors the most detailed are taken: of axles, bogies or the vehicle."""
    for meaning in MOTOR_FORCES:
        places = {i: place_of(meant[i].field) for i in guesses if meant[i].meaning == meaning}
        forces = ((i, meant[i].axle is not None, x) for i, x in places.items())
        details = {i: 3 if of_axle else 2 if x.bogie else bool(x.part) for i, of_axle, x in forces}
        finest = max(details.values(), default=0)
        for i in (i for i, detail in details.items() if detail < finest):
            meant[i] = meant[i].without("a sum, and the log has its parts as well")


def _spread_forces(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """Spreads the force of a vehicle, or of what the user states, over its axles: a row for each.

    A force whose name has no axle, bogie or car is the whole vehicle's, unless it says "axle".
    """
    all_axles = tuple(sorted({m.axle for m in meant if m.meaning == "wheel_speed" and m.axle}))
    findings = []
    for i, m in enumerate(list(meant)):
        if m.meaning not in MOTOR_FORCES or m.axle is not None:
            continue
        mapping = m.mapping if i not in guesses else None
        axles = (mapping.axles if mapping else ()) or all_axles
        if not mapping.place if mapping else _is_of_each(m) or len(axles) < 2:
            continue
        rows = [replace(m, axle=axle, share=1.0 / len(axles)) for axle in axles]
        meant[i] = rows[0]
        if not mapping:
            guesses += range(len(meant), len(meant) + len(rows) - 1)
            findings.append(_spread_finding(m, axles, [None]))
        meant += rows[1:]
    return findings


def _is_of_each(m: Meant) -> bool:
    """Whether a name says that each axle has this force, as "per axle"."""
    return bool(word_of_kind("wheel", name_words(m.title)))


def _spread_finding(
    m: Meant, axles: Sequence[int], axles_of_options: Sequence[int | None]
) -> Finding:
    option = " ".join(_as_option(replace(m, axle=axle)) for axle in axles_of_options)
    names = {"axles": ", ".join(map(str, axles)), "option": option, "force": m.describe}
    return Finding("force-spread", "info", channel=m.title, names=names)


def _refuse_repeated(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """Of several channels that would be the same thing the first is taken; that is reported."""
    holders: dict[tuple[str, int | None], Meant] = {}
    repeats: dict[tuple[str, int | None], list[Field]] = {}
    in_unit = {i for i in guesses if units.unit_for(meant[i].unit, meant[i].meaning or "time")}
    for i in sorted(guesses, key=lambda i: i not in in_unit):
        m = meant[i]
        if not m.meaning or m.meaning not in INPUTS or m.meaning in OTHER_BRAKES:
            continue
        key = (m.meaning, m.axle)
        if (holder := holders.setdefault(key, m)) is not m:
            meant[i] = m.without(f"{holder.title} is taken as the {m.meaning} already")
            if i in in_unit or not units.unit_for(holder.unit, m.meaning):
                repeats.setdefault(key, []).append(m.field)
    findings = []
    for (meaning, axle), fields in repeats.items():
        holder, titles = holders[meaning, axle], [*map(title, fields)]
        is_usual = meaning == "train_speed" or (axle and _are_sides([holder.title, *titles]))
        option = _as_option(replace(holder, field=fields[0]))
        names = {"first": holder.title, "meaning": holder.describe, "option": option}
        severity: Severity = "info" if is_usual else "warning"
        channel, count = ", ".join(titles[:_MOST_NAMED]), len(fields)
        findings.append(Finding("channel-ambiguous", severity, channel, count, names=names))
    return findings


def _are_sides(names: Sequence[str]) -> bool:
    """Whether channels are sensors of one axle, as "v1 left" and "v1 right"."""
    lettered = (_SENSOR.sub(lambda m: f" {'ab'[int(m[1]) - 1]} ", name) for name in names)
    word_lists = [*map(name_words, lettered)]
    differing = [x for column in zip(*word_lists, strict=False) if len(x := {*column}) > 1]
    has_one_difference = len({*map(len, word_lists)}) == len(differing) == 1
    return has_one_difference and all(word_of_kind("side", [word]) for word in differing[0])


def entry_of(field: Field, **stated: str | int) -> dict[str, str | int]:
    """The entry of [channels] that names a field, with what else is stated of it."""
    return {"channel": field.channel, "field": field.path, "group": field.group, **stated}


def _as_option(m: Meant) -> str:
    """How a user states the meaning and the axle of a channel."""
    return toml.option(f"channels.{_key(str(m.meaning), m.axle)} = {toml.table(entry_of(m.field))}")


def title(field: Field) -> str:
    """A field's name for people: topic and place, or the column header."""
    return f"{field.name} {field.path}".strip()


def channel_fields(fields: Sequence[Field], m: Mapping) -> list[Field]:
    """The fields of the channel that a mapping names, none where the log has no such channel."""
    wanted = m.channel.strip()
    folded = wanted.casefold()
    spellings: tuple[Callable[[Field], bool], ...] = (
        lambda f: f.channel == wanted,
        lambda f: f.channel.strip().casefold() == folded,
        lambda f: units.in_name(f.channel)[0].casefold() == folded,
        lambda f: folded in (f"column {f.column}", str(f.column)) and f.column > 0,
    )
    fields = [f for f in fields if not f.words or m.meaning in _WORDED_MEANINGS]
    matching = ([f for f in fields if spelling(f)] for spelling in spellings)
    return next((fields for fields in matching if fields), [])


def _find(fields: Sequence[Field], m: Mapping) -> list[tuple[Field, Mapping]]:
    """The field that a mapping names; of a list without an index each element, with its axle."""
    matching = channel_fields(fields, m)
    if not matching:
        raise unknown("channel", m.channel, sorted({f.channel for f in fields}))
    in_group = [f for f in matching if not m.group or f.group == m.group]
    elements = [(f, replace(m, axle=int(i) + 1)) for f in in_group if (i := _index(f, m.field))]
    if m.field:
        in_group = [f for f in in_group if m.field in (f.path, f.label)] or [f for f, _ in elements]
    is_per_axle = len({element.axle for _, element in elements}) == len(elements) > 0
    if is_per_axle and m.axle is None and m.meaning != "train_speed":
        return elements
    if not m.field and (generic := [f for f in in_group if f.path in GENERIC]):
        in_group = generic[:1]
    if len(in_group) == 1:
        return [(in_group[0], m)]
    names = [title(f) for f in matching]
    if in_group:
        key = _key(m.meaning, m.axle)
        of_meaning = [f for f in in_group if guess(f).meaning == m.meaning]
        similar = [f for f in of_meaning if m.axle in (None, guess(f).axle)]
        chosen = (similar or in_group)[0]
        path = re.sub(r"\[\d+\]$", "", chosen.path) if m.axle is None else chosen.path
        entry = {"channel": m.channel, "field": path, "group": chosen.group, "unit": m.unit}
        text = f"channel {m.channel!r} has several fields: {', '.join(names[:12])}"
        hint = f"name one, as {toml.option(f'channels.{key} = {toml.table(entry)}')}"
        raise UserError(text, hint, code=2)
    raise unknown(f"field of {m.channel!r}", m.field or m.group, names)


def _key(meaning: str, axle: int | None) -> str:
    return meaning if axle is None else f"{meaning}.axle{axle}"


def _index(field: Field, named: str) -> str:
    """The index of a field in the list of this name; "" where it is none, or has a name."""
    indexed = re.fullmatch(r"([^\[]*)\[(\d+)\]([^\[]*)", "" if field.label else field.path)
    return indexed[2] if indexed and indexed[1] + indexed[3] == named else ""
