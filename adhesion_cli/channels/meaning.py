"""What a log's fields mean: brake-cylinder pressure, wheel speed, train speed, K, truth; and why.

A mapping from the user decides; else the names do, and every such guess is told.
"""

import re
import unicodedata
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

from ..core import units
from ..core.errors import UserError, unknown
from ..core.finding import Finding
from ..core.model import Meaning
from ..formats.source import Field


@dataclass(frozen=True, slots=True)
class Mapping:
    """One line of `[channels]`: this channel means that."""

    meaning: Meaning
    axle: int | None
    channel: str
    field: str = ""
    unit: str = ""
    group: str = ""
    teeth: int = 0  # pulses per turn of a pulse counter or pulse rate
    wrap: float = 0.0  # where a cumulative counter starts anew; 0: 2¹⁶ or 2³², by its values


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
    unit_too: str = ""  # another unit that its name states, where nobody says which one holds


# Words in lower case; Latin ones must be whole words of the name, stems may sit in a compound,
# Chinese ones may stand anywhere.
_STEMS = ("pressure", "druck", "zylinder", "cylinder", "speed", "velocity", "geschw", "drehzahl",
          "adhesion", "kraftschluss", "clamp", "klemmkraft", "leitung", "behälter", "vorsteuer",
          "luftfeder", "speicher", "druk", "cilinder", "leiding", "snelheid", "toerental", "wiel",
          "trein")  # fmt: skip
_VOCABULARY = {
    "pressure": """
        pressure press pres druck p pression pressione presión presion druk 压力 缸压 压强""",
    "cylinder": """
        bc bcp bcps pbc pc cylinder cyl zylinder bz bzd caliper cylindre cf cilindro cilinder
        制动缸 闸缸""",
    "other pressure": """
        pipe bp hl hll hbl reservoir main mr mrp pilot spring supply load ambient parking command
        cmd target setpoint demand demanded commanded required nominal soll sollwert request
        requested atmospheric hauptluftleitung hauptbehälter vorsteuer luftfeder federspeicher
        leitung behälter speicher
        conduite cg réservoir reservoir suspension commande consigne condotta serbatoio sospensione
        comando leiding veer tubería tuberia depósito deposito
        列车管 总风 空簧 预控 停放 目标 指令 制动管 主风""",
    "speed": """
        speed velocity vel geschw drehzahl omega ω rpm spd v w n vitesse velocità velocita velocidad
        snelheid toerental 速度 转速 轮速 轴速 车速""",
    "wheel": """
        wheel wheels axle axles wheelset achse achs rad radsatz ws ax joint encoder
        essieu essieux roue roues asse assi ruota ruote sala wiel eje ejes rueda ruedas 轮 轴""",
    "train": """
        train vehicle gps gnss radar doppler ground zug fahrzeug body carbody car loco reference ref
        odometry odom twist fahr treno trein tren véhicule vehicule veicolo voertuig
        列车 车速 车辆 地面 参考 机车""",
    "other speed": """
        limit target setpoint soll wind fan cmd command commanded demand demanded required motor
        engine gyro yaw pitch roll heading error deviation difference diff differenz limite
        consigne moteur motore 目标 限速 电机""",
    "bound": "set max maximum",
    "clamping": "clamp clamping klemmkraft zuspannkraft k 夹紧力 夹紧",
    "force": "force kraft f 力",
    "other force": """
        brake braking brems bremskraft frein freinage freno frenatura friction reib traction
        tractive drawbar coupler buffer spring normal vertical lateral load wheelload zug radlast
        制动 闸 牵引 垂向 横向""",
    "adhesion": "adhesion adhesive kraftschluss bw adh 黏着 粘着",
    "absolute": "abs absolute absolut 绝对 绝压",
    "bogie": "bogie bogies truck drehgestell dg 转向架",
    "true": "true truth wahr 真",
    "slip": "slip schlupf 滑移率",
    "actual": "actual real 实际",
    "estimated": """
        estimate estimated est hat reference lower upper sigma error coefficient coeff mu max peak
        available limit utilisation utilization slip slope 估 系数 误差""",
    "never": """
        variance covariance stamp sec nsec nanosec seq index status quality temperature lat lon
        latitude longitude altitude valid flag""",
    "acceleration": """
        acceleration accel acc ax deceleration decel beschleunigung längsbeschleunigung verzögerung
        accélération décélération accelerazione decelerazione aceleración versnelling vertraging
        加速度 减速度""",
    "other acceleration": """
        y z lateral vertical quer vertikal seiten angular rotational gyro bogie truck drehgestell
        wheel axle axlebox bearing achse achslager radsatz motor latérale transversale 横向 垂向
        轴箱 构架 转向架""",
}
# In order: which of several words is told must not change from run to run.
_WORDS = {kind: dict.fromkeys(words.split()) for kind, words in _VOCABULARY.items()}
_GENERIC = set(
    "value data val raw scalar float float64 double signal reading measurement x".split()
)

# Units that a message type fixes by its definition, not by its name.
_CONVENTIONS: tuple[tuple[str, str, str], ...] = (
    (r"sensor_msgs(/msg)?/JointState|sensor_msgs\.JointState", r"^velocity", "rad/s"),
    (r"sensor_msgs(/msg)?/FluidPressure", r"^fluid_pressure$", "Pa"),  # says absolute, see checks
    (r"sensor_msgs(/msg)?/Imu|sensor_msgs\.Imu", r"^linear_acceleration", "m/s2"),
    (r"(geometry|nav)_msgs(/msg)?/(Twist|Odometry)", r"linear\.", "m/s"),
    (r"(geometry|nav)_msgs(/msg)?/(Twist|Odometry)", r"angular\.", "rad/s"),
)
# What results of ours hold, by message type and field: their topics begin with a log's name, which
# may say anything.
_OURS: dict[tuple[str, str], tuple[Meaning, str]] = {
    ("adhesion.AxleInput", "brake_cylinder_pressure"): ("pressure", "Pa"),
    ("adhesion.AxleInput", "clamping_force"): ("clamping_force", "N"),
    ("adhesion.AxleInput", "wheel_speed"): ("wheel_speed", "rad/s"),
    ("adhesion.AxleInput", "train_speed"): ("train_speed", "m/s"),
    ("adhesion.Truth", "force"): ("truth", "N"),
    ("adhesion.Truth", "slip"): ("true_slip", "-"),
}

_MOST_TOLD = 20  # channels of one meaning and axle that are told one by one

_CHINESE_NUMBERS = {c: i for i, c in enumerate("一二三四五六七八", start=1)}


def _words(text: str) -> list[str]:
    """Lower-case words of a name: camelCase, digits and punctuation part them."""
    return list(_parted(text))


@lru_cache(1 << 10)  # of one field many ask
def _parted(text: str) -> tuple[str, ...]:
    text = unicodedata.normalize("NFKC", text)
    text = re.sub(r"(?i)\b(rad|achs|zug|fahrzeug|fahr)(?=geschw|drehz)", r"\1 ", text)
    text = re.sub(
        r"(?<=[a-z])(?=[A-Z])|(?<=[A-Z])(?=[A-Z][a-z])|(?<=\D)(?=\d)|(?<=\d)(?=\D)", " ", text
    )
    return tuple(re.findall(r"[^\W_]+", text.lower()))


def _has(kind: str, words: Sequence[str]) -> str:
    """The first of these words that speaks of this kind of thing, "" for none."""
    for word in words:
        if found := _speaks(word).get(kind):
            return found
    return ""


@lru_cache(1 << 14)  # logs have many names of few words
def _speaks(word: str) -> dict[str, str]:
    """What kinds of things a word speaks of, and by what in it; of none, if it is a number."""
    if word.isdigit():
        return {}
    return {kind: found for kind in _WORDS if (found := _speaks_of(kind, word))}


def _speaks_of(kind: str, word: str) -> str:
    known = _WORDS[kind]
    if word in known or any(stem in known and stem in word for stem in _STEMS):
        return word
    of_word = (e for e in known if not e.isascii() and len(e) <= len(word) and e in word)
    return next(of_word, "")


@lru_cache(1 << 15)  # `inspect` asks twice
def _guess(field: Field) -> tuple[Meaning | None, int | None, str, str]:  # noqa: C901, PLR0912, PLR0915
    """Meaning, axle, unit and reason: a message of ours says by its type, others by their names."""
    if ours := _of_ours(field):
        return ours
    base, unit = units.in_name(field.label or field.channel if not field.path else field.channel)
    path, path_unit = units.in_name(re.sub(r"\[\d+\]", "", field.path))
    label, label_unit = units.in_name(field.label)
    if not unit:
        base = units.without_others(base)
    if not label_unit:
        label = units.without_others(label)
    text, reason = field.unit, field.unit_from
    if not text:
        counted = units.unit(field.path)
        is_count = counted is not None and counted.dimension == "count"
        text = path_unit or label_unit or unit or (field.path if is_count else "")
        reason = "in the name" if text else ""
    if not text:
        for message_type, place, by_definition in _CONVENTIONS:
            if re.search(message_type, field.message_type) and re.search(place, field.path):
                text, reason = by_definition, f"by definition of {field.message_type}"
    measured = units.unit(text)
    dimension = measured.dimension if measured else ""
    if not path and (last := re.search(r"[/.]([^/.]{3,})$", base)):
        path = last[1]  # a topic and field written as one column header
    own = [w for w in _words(path) if not w.isdigit() and w not in _GENERIC]
    around = _words(base) + _words(label) + _words(field.group)
    words = (own or []) + around
    primary = own or around
    why = f"unit {text}: {reason}" if text else "no unit stated"
    axle = _axle(field)

    def meant(meaning: Meaning, *seen: str) -> tuple[Meaning | None, int | None, str, str]:
        names = " and ".join(repr(s) for s in dict.fromkeys(seen) if s)
        # a number beside the train is a channel's, unless an axle is named
        numbered = meaning != "train_speed" or field.group or _has("wheel", words)
        of = axle if numbered else None
        return meaning, of, text, f"name has {names}; {why}" if names else why

    if _has("never", primary):
        return None, axle, text, "not a quantity we use"
    is_force = dimension == "force" or (not dimension and bool(_has("force", primary)))
    true = _has("true", words)
    slip = _has("slip", primary)
    if slip and true and not _has("estimated", [w for w in words if w != slip]):
        text = field.unit or units.unknown_in(field.channel)  # a name states no ratio otherwise
        if units.of(text, "true_slip"):
            why = f"unit {text}: {reason or 'in the name'}"
            return meant("true_slip", slip, true)
        return None, axle, text, "a true slip, but no unit stated: - or %"
    adhesion = _adhesion_force(primary)
    clamping = _has("clamping", primary)
    if clamping == "k" and (adhesion or (true and _has("force", primary))):
        clamping = ""  # an index
    if clamping and dimension in ("force", "") and (is_force or "夹" in clamping):
        return meant("clamping_force", clamping, _has("force", primary))
    if (
        is_force
        and (true or adhesion)
        and not _has("estimated", words)
        and not _has("other force", primary)
    ):
        return meant("truth", true, adhesion)
    if accelerates := _has("acceleration", words):
        text = text or units.unknown_in(field.label or field.channel)  # g is a unit of nothing else
        if not units.is_acceleration(text):
            return None, axle, text, f"{accelerates!r} in the name, but no unit of it is stated"
        kinds = ("other acceleration", "other speed", "estimated")
        if other := next((found for kind in kinds if (found := _has(kind, words))), ""):
            return None, axle, text, f"an acceleration, but {other!r} is not the train's along it"
        why = f"unit {text}: {reason or 'in the name'}; an acceleration, to be integrated"
        return "train_speed", None, text, f"name has {accelerates!r}; {why}"
    pressure, cylinder = _has("pressure", primary), _has("cylinder", words)
    if dimension in ("pressure", "") and (
        pressure or _has("cylinder", primary) or (dimension and cylinder)
    ):
        if other := _has("other pressure", words):
            return None, axle, text, f"a pressure, but {other!r} is not the brake cylinder"
        if text and _has("absolute", words) and units.unit(f"{text} abs"):
            text, why = f"{text} abs", f"unit {text}: {reason}, and the name says absolute"
        return meant("pressure", pressure, cylinder)
    speed = _has("speed", primary)
    speedy = dimension in ("speed", "angular speed", "pulse rate", "count", "angle")
    if speedy or (not dimension and speed):
        train = _has("train", primary) or _has("train", words)
        wheel = _has("wheel", primary) or ("" if _has("train", primary) else _has("wheel", words))
        if other := _has("other speed", words) or ("" if wheel else _has("bound", words)):
            return None, axle, text, f"a speed, but {other!r} is not measured on wheel or train"
        if dimension in ("pulse rate", "count", "angle") and not (wheel or speed):
            return None, axle, text, "nothing in the name says wheel or axle"
        if (true := true or _has("actual", words)) and not wheel:
            return meant("train_speed", true, speed)
        if train and not wheel and dimension in ("speed", ""):
            return meant("train_speed", train, speed)
        return meant("wheel_speed", wheel, speed)
    return None, axle, text, "no name we know"


def _of_ours(field: Field) -> tuple[Meaning | None, int | None, str, str] | None:
    """As `_guess`, for a message of a result of ours; None for any other."""
    if not field.message_type.startswith("adhesion.") or field.message_type == "adhesion.Scalar":
        return None  # a Scalar is any channel of a log that was converted or simulated
    place = re.search(r"/axle/(\d+)/", field.channel)
    axle = int(place[1]) if place else None
    if known := _OURS.get((field.message_type, field.path)):
        return known[0], axle, known[1], f"by definition of {field.message_type}"
    return None, axle, field.unit, f"{field.message_type}: no input of an analysis"


def _adhesion_force(words: Sequence[str]) -> str:
    """The word that calls this an adhesion force, "" where none does.

    Next to the word for a force; or, where there is none, beside nothing but an axle: a force for
    an adhesion test is no adhesion force.
    """
    aside = [w for w in words if not (w.isdigit() or _has("true", [w]) or _has("actual", [w]))]
    for i, word in enumerate(aside):
        near = aside[max(0, i - 1) : i + 2]
        if _has("adhesion", [word]) and _has("force", near):
            return word
    bare = [w for w in aside if not _has("wheel", [w]) and not _has("bogie", [w])]
    return _has("adhesion", bare) if len(bare) == 1 else ""


def _axle(field: Field) -> int | None:
    """The axle's number as the names give it, None where they give none."""
    for text in (field.group, field.label, field.path, field.channel):
        words = _words(units.in_name(text)[0]) if text else []
        for i, word in enumerate(words):
            number = word in _WORDS["wheel"] or word in _WORDS["cylinder"] or any(
                c in word for c in "轴轮"
            )  # fmt: skip
            if number and i + 1 < len(words) and words[i + 1].isdigit():
                return int(words[i + 1])
            if _has("bogie", [word]):
                words = [*words[:i], *words[i + 2 :]]  # its number counts bogies
                break
            if any(c in word for c in "轴轮位") and i and words[i - 1].isdigit():
                return int(words[i - 1])
        if match := re.search(r"([一二三四五六七八])[轴轮位]|[轴轮]([一二三四五六七八])", text):
            return _CHINESE_NUMBERS[match[1] or match[2]]
        digits = [w for w in words if w.isdigit() and len(w) < 3]
        if digits and not (text == field.path and text.endswith("]")):
            return int(digits[-1])
        if match := re.search(r"\[(\d+)\](\.\w+)?$", text):
            return int(match[1]) + 1  # a list counts from 0, axles from 1
    return None


def understood(
    fields: Sequence[Field], mappings: Sequence[Mapping]
) -> tuple[list[Meant], list[Finding]]:
    """Gives each field its meaning; in the fields' order, a bogie's second axle behind them.

    Raises:
        UserError: for a mapping to a channel or field the log does not have.
    """
    by_hand = {_find(fields, m): m for m in mappings}
    mapped = {m.meaning for m in mappings}
    meant: list[Meant] = []
    channels = {f.channel for f in fields}
    repeated = {f for f in fields if first_name(f.channel) in channels}
    for field in fields:
        if m := by_hand.get(field):
            unit = m.unit or field.unit
            _, _, guessed_unit, _ = _guess(field)
            why = "stated in [channels]" if m.unit else f"[channels]; unit {field.unit_from}"
            if not unit:
                unit, why = guessed_unit, "stated in [channels]; unit in the name"
            too = "" if m.unit else _unit_too(field, m.meaning, unit)
            meant.append(Meant(field, m.meaning, m.axle, unit, why, m.teeth, m.wrap, too))
            continue
        said = replace(field, group="") if field.encoding else field  # see Field.group
        meaning, axle, unit, reason = _guess(said)
        if field in repeated:  # "(2)" is the reader's, for a name the log uses twice
            axle = _axle(replace(said, channel=first_name(field.channel)))
        if meaning in mapped:
            meaning, reason = None, f"[channels] names another {meaning}"
        too = _unit_too(field, meaning, unit) if meaning else ""
        meant.append(Meant(field, meaning, axle, unit, reason, unit_too=too))
    guesses = [i for i, g in enumerate(meant) if g.meaning and g.field not in by_hand]
    _own_stamps(meant, guesses)
    _prefer_the_qualified(meant, guesses)
    findings = _speed_itself(meant, guesses)
    findings += _nested(meant, guesses)
    findings += _count_from_one(meant, guesses)
    findings += _bogies(meant, guesses)
    findings += _one_each(meant, guesses)
    return meant, findings


def _unit_too(field: Field, meaning: Meaning, unit: str) -> str:
    """A unit that a field's names state beside the one taken, "" for none."""
    if field.message_type.startswith("adhesion."):
        return ""  # named as the log was that it was made of, in units of its own
    return units.contradicting(unit, (field.path, field.label, field.channel), meaning)


def _prefer_the_qualified(meant: list[Meant], guesses: list[int]) -> None:
    """'pressure' gives way to 'BC pressure'; 'speed' is the train's where a wheel's is named."""

    def words(i: int) -> list[str]:
        field = meant[i].field
        return _words(f"{field.channel} {field.path} {field.label} {field.group}")

    pressures = [i for i in guesses if meant[i].meaning == "pressure"]
    named = [i for i in pressures if _has("cylinder", words(i))]
    for i in pressures if named else []:
        if i not in named:
            meant[i] = replace(meant[i], meaning=None, reason="another one is the brake cylinder's")
    speeds = [i for i in guesses if meant[i].meaning == "wheel_speed"]
    named = [i for i in speeds if _has("wheel", words(i))]
    for i in speeds:
        unit = units.unit(meant[i].unit)
        if named and i not in named and (unit is None or unit.dimension == "speed"):
            taken = any(m.meaning == "train_speed" for m in meant)
            reason = "a speed, and another one is the wheel's"
            meant[i] = replace(
                meant[i], meaning=None if taken else "train_speed", axle=None, reason=reason
            )


def _speed_itself(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """An acceleration is integrated only where no speed of the train is logged."""
    trains = [i for i, m in enumerate(meant) if m.meaning == "train_speed"]
    accelerates = [i for i in trains if units.is_acceleration(meant[i].unit)]
    if len(accelerates) == len(trains):
        return []
    findings = []
    for i in accelerates:
        if i in guesses:
            reason = "an acceleration, not needed: the log has the train's speed itself"
            meant[i] = replace(meant[i], meaning=None, reason=reason)
            findings.append(Finding("acceleration-unused", "info", reason, title(meant[i].field)))
    return findings


def _count_from_one(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """Channels that number axles from 0 move up by one, and that is told.

    Those of another meaning move with them where their numbers end with theirs, but not those that
    reach beyond: of speeds 0 and 1 and pressures 1 and 2, the pressures count from 1. An index in
    brackets says nothing of a number in a name, nor the other way round.
    """
    moved = []
    for indexed in (False, True):
        of: dict[Meaning | None, list[int]] = {}
        for i in guesses:
            if meant[i].axle is not None and _is_indexed(meant[i].field) is indexed:
                of.setdefault(meant[i].meaning, []).append(i)
        numbers = {meaning: [meant[i].axle or 0 for i in own] for meaning, own in of.items()}
        last = max((max(n) for n in numbers.values() if 0 in n), default=-1)
        for meaning, own in of.items():
            if 0 in numbers[meaning] or max(numbers[meaning]) <= last:
                moved += own
    for i in moved:
        meant[i] = replace(meant[i], axle=(meant[i].axle or 0) + 1)
    if not moved:
        return []
    names = [title(meant[i].field) for i in sorted(moved)]
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    text = f"{', '.join(names[:3])}{more}: the log numbers axles from 0; here from 1"
    return [Finding("axles-from-zero", "info", text, "", len(moved))]


def _is_indexed(field: Field) -> bool:
    """Whether a field's axle is its index in a list, as `speed[1]`, not a number in its name."""
    by_label = any(c.isdigit() for c in field.label)
    named = field.label if by_label else field.path or units.in_name(field.channel)[0]
    return re.search(r"\[\d+\](\.\w+)?$", named) is not None


def _nested(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """Lists in lists, as bogies[1].wheel_speed[0]: wheels are counted through, in order.

    A pressure that stands once per outer element serves all wheels of that element.
    """
    findings = []
    topics: dict[str, list[int]] = {}
    for i in guesses:
        topics.setdefault(meant[i].field.channel, []).append(i)
    for topic, own in topics.items():
        places = {i: tuple(map(int, re.findall(r"\[(\d+)\]", meant[i].field.path))) for i in own}
        wheels = sorted({places[i] for i in own if meant[i].meaning == "wheel_speed"})
        if not wheels or len(wheels[0]) < 2:
            continue
        for i in own:
            served = [n for n, w in enumerate(wheels, 1) if w[: len(places[i])] == places[i]]
            if not places[i] or not served:
                continue
            meant[i] = replace(meant[i], axle=served[0])
            for axle in served[1:]:
                guesses.append(len(meant))
                meant.append(replace(meant[i], axle=axle))
        text = f"lists in lists: {len(wheels)} wheels counted through as axles 1 to {len(wheels)}"
        findings.append(Finding("axles-nested", "info", text, topic))
    return findings


def _own_stamps(meant: list[Meant], guesses: list[int]) -> None:
    """In a result of ours pressure and train speed as logged beat those at the wheel's stamps."""
    own = {
        (m.meaning, m.axle)
        for m in (meant[i] for i in guesses)
        if m.field.message_type == "adhesion.Scalar"
    }
    for i in guesses:
        m = meant[i]
        same = own & {(m.meaning, m.axle), (m.meaning, None)}
        if m.field.message_type == "adhesion.AxleInput" and same:
            meant[i] = replace(m, meaning=None, reason="its own stamps are in the file as well")


def _bogies(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """A pressure that is a bogie's serves both its axles: bogie 2 has axles 3 and 4."""
    findings = []
    for i in list(guesses):
        m = meant[i]
        name = title(m.field)
        bogie = re.search(
            r"(?i)(?:bogie|truck|drehgestell|dg|转向架)[\s_\-/]*(\d)|(\d)\s*转向架", name
        )
        if m.meaning == "pressure" and m.axle is None and bogie:
            second = 2 * int(bogie[1] or bogie[2])
            meant[i] = replace(m, axle=second - 1)
            guesses.append(len(meant))
            meant.append(replace(m, axle=second))
            message = f"a bogie's pressure, taken for axles {second - 1} and {second}"
            findings.append(Finding("bogie-pressure", "info", message, name))
    return findings


def _one_each(meant: list[Meant], guesses: list[int]) -> list[Finding]:
    """Two channels that would both be the same thing: the train's first is taken, else refused."""
    findings: list[Finding] = []
    seen: dict[tuple[str | None, int | None], int] = {}
    told: Counter[tuple[str | None, int | None]] = Counter()
    for i in guesses:
        m = meant[i]
        key = (m.meaning, m.axle)
        if not m.meaning:
            continue
        if key not in seen:
            seen[key] = i
            continue
        first = title(meant[seen[key]].field)
        reason = f"{first} is taken as the {m.meaning} already"
        meant[i] = replace(meant[i], meaning=None, reason=reason)
        severity = "info" if m.meaning == "train_speed" else "warning"
        message = f"{reason}; state which one in [channels]"
        told[key] += 1
        if told[key] <= _MOST_TOLD:
            findings.append(Finding("channel-ambiguous", severity, message, title(m.field)))  # type: ignore[arg-type]
    for (meaning, axle), count in told.items():
        if count > _MOST_TOLD:
            more = count - _MOST_TOLD
            first = title(meant[seen[meaning, axle]].field)
            text = f"{more} further channels than {first} look like the {meaning} of the same axle"
            severity = "info" if meaning == "train_speed" else "warning"
            findings.append(Finding("channel-ambiguous", severity, text, first, more))  # type: ignore[arg-type]
    return findings


def name(field: Field) -> str:
    """The topic or column header, and the device in a long layout."""
    return f"{field.channel} ({field.group})" if field.group else field.channel


def title(field: Field) -> str:
    """A field's name for people: topic and place, or the column header."""
    return f"{name(field)} {field.path}".strip()


def first_name(channel: str) -> str:
    """The name of which "name (2)" is a repetition; "" where it is none."""
    match = re.fullmatch(r"(.*) \(\d+\)", channel)
    return match[1] if match else ""


def _find(fields: Sequence[Field], m: Mapping) -> Field:
    """The field a mapping speaks of."""
    wanted = m.channel.strip()
    if not any(f.channel == wanted for f in fields):
        folded = {f.channel.strip().casefold(): f.channel for f in fields}
        number = f"column {wanted}" if wanted.isdigit() else wanted
        found = folded.get(wanted.casefold()) or folded.get(number)
        bare = {units.in_name(f.channel)[0].casefold(): f.channel for f in fields}
        found = found or bare.get(wanted.casefold())
        if found is None:
            raise unknown("channel", m.channel, sorted({f.channel for f in fields}))
        wanted = found
    own = [f for f in fields if f.channel == wanted and (not m.group or f.group == m.group)]
    if m.field:
        own = [f for f in own if m.field in (f.path, f.label)] or own[:0]
    if len(own) == 1:
        return own[0]
    if not m.field and (generic := [f for f in own if f.path in _GENERIC]):
        return generic[0]
    names = [title(f) for f in fields if f.channel == wanted]
    if own:
        raise UserError(
            f"channel {m.channel!r} has several fields: {', '.join(names[:12])}",
            'name one: {channel = "…", field = "…"}, or group = "…" for a device', code=2,
        )  # fmt: skip
    raise unknown(f"field of {m.channel!r}", m.field or m.group, names)
