"""A log file as channels with meaning, in SI, on clean time axes."""

import re
import unicodedata
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from math import log10
from pathlib import Path

from ..core import model, time_axis, toml, units
from ..core.errors import UserError
from ..core.finding import Finding, Severity, catalogue
from ..core.model import INPUTS, MOTOR_FORCES, Channel, Column, Log, Meaning, Vehicle
from ..core.text import listed
from ..formats.source import TAKEN_AS_UTC, Source
from .meaning import Mapping, Meant, channel_fields, entry_of, understood
from .places import UNCLEAR, bogie_axles
from .pressures import judge
from .rules import ED_WITHOUT_UNIT, NO_NAME, UNCLEAR_VALVE
from .to_si import as_levels, channel, words_key

# What an analysis needs, by the meanings that give it, and what it does not need.
_NEEDED: dict[Meaning | None, str] = {"wheel_speed": "speed"}
_NEEDED |= dict.fromkeys(("pressure", "clamping_force"), "brake")
# Units that a hint shows as examples.
_USUAL: dict[Meaning | None, str] = {"wheel_speed": "km/h", "pressure": "bar", "true_slip": "-"}
_USUAL |= dict.fromkeys(("clamping_force", "truth", *MOTOR_FORCES), "kN")
# A unit with a factor behind it, as "bar x 100".
_FACTOR_BEHIND = re.compile(r"(.*?[^\W\d_].*?)\s*([x×*·/])\s*(10\^?-\d|0[.,]0*1|10*)")
_SHARE = re.compile(r"(?i)[%‰]|[mkµ]?[VA]\b|digits?\b")  # of a sensor's range
_PREFIXES = {"da": 10.0, "m": 1e-3, "c": 1e-2, "d": 0.1, "h": 100.0, "k": 1e3}
_USUAL_STEP = {"pressure": 1e3, "speed": 1e-2, "angular speed": 1e-2, "force": 10.0}  # SI
_PROPOSED_KEYS: dict[str, Meaning] = {"speed": "wheel_speed", "pressure": "pressure"}  # by key
_OPTIONAL: tuple[Meaning, ...] = ("train_speed", "truth", "true_slip")


def read(
    source: Source,
    mappings: Sequence[Mapping],
    vehicle: Vehicle,
    max_gap_ns: int = 0,
    further: Collection[Meaning] = (),
) -> Log:
    """The channels of an opened log that mean something, in SI, on clean time axes.

    `mappings` is what the user stated, `vehicle` has the wheel radius. Intervals longer than
    `max_gap_ns` are gaps; 0 decides per channel. Channels of `further` meanings are read as well,
    where their unit is known.

    Raises:
        UserError: where the log cannot be read, a unit that is needed cannot be known, a channel
            has no usable sample, or the only pressure is that of a brake pipe.
    """
    chosen, findings = needed(source, mappings, further)
    log = _log(source, chosen, findings, lambda m, c, e: channel(m, c, vehicle, e, max_gap_ns))
    log = _judged(log, chosen, vehicle)
    proposals = {}
    if not {"speed", "brake"} <= {_NEEDED.get(c.meaning) for c in log.channels}:
        proposals = _proposals(_understood(source, mappings)[0])
    _refuse_pipe_alone(log, chosen, proposals.get("pressure"))
    wanted = {*INPUTS, *further}
    channels = tuple(c for c in log.channels if c.meaning in wanted)
    return without_empty(replace(log, channels=channels, proposals=proposals))


def _proposals(meant: Sequence[Meant]) -> dict[str, str]:
    """By key in [channels] an option that gives it the likeliest channel without a meaning."""
    unused = [m for m in meant if m.meaning is None and not m.field.words]
    unused = [m for m in unused if m.unit or m.reason == NO_NAME]
    proposals = {}
    for key, meaning in _PROPOSED_KEYS.items():
        fitting = [m for m in unused if units.unit_for(m.unit, meaning)]
        if m := next(iter(fitting or (m for m in unused if not m.unit)), None):
            entry = toml.table(entry_of(m.field, unit=m.unit or _USUAL[meaning]))
            place = '."axle 1"' if key == "speed" else ""
            proposals[key] = toml.option(f"channels.{key}{place} = {entry}")
    return proposals


def survey(source: Source, mappings: Sequence[Mapping], vehicle: Vehicle) -> Log:
    """Every numeric channel of an opened log on its clean time axis; SI where the unit is known."""
    meant, findings = _understood(source, mappings)
    log = _log(source, meant, findings, lambda m, c, ends: channel(m, c, vehicle, ends))
    return replace(_judged(log, meant, vehicle), proposals=_proposals(meant))


def _judged(log: Log, meant: Sequence[Meant], vehicle: Vehicle) -> Log:
    """The log with what its pressures are by what they do."""
    channels, findings = judge(log.channels, meant, vehicle)
    return replace(log, channels=tuple(channels), findings=(*log.findings, *findings))


def _refuse_pipe_alone(log: Log, chosen: Sequence[Meant], proposal: str | None) -> None:
    """Refuses a log whose only pressure acts as that of a brake pipe, and is not named so."""
    named = {m.field.name for m in chosen if m.meaning == "brake_pipe"}
    pipes = (c for c in log.channels if c.meaning == "brake_pipe" and c.name not in named)
    needed_inputs = {_NEEDED.get(c.meaning) for c in log.channels}
    if (pipe := next(pipes, None)) and "brake" not in needed_inputs:
        hint = "log the pressure of a brake cylinder, too"
        if proposal:
            hint = f"if the log has the brake cylinder's, state it, as {proposal}"
        text = f"{log.path}: no channel is a brake-cylinder pressure; {pipe.title!r} is a brake "
        raise UserError(f"{text}pipe's: it {pipe.reason}", hint)


def unchanged(source: Source, mappings: Sequence[Mapping]) -> Log:
    """Every numeric channel of an opened log as it is, in its own unit: for `convert`.

    A copy does not depend on what its channels mean. So it reports no meanings, and copies a
    channel once where it serves two axles. It leaves channels without a number out.

    Raises:
        UserError: where no channel holds a number, or the unit of one that means something is
            stated in two ways.
    """
    meant = {m.field: m for m in _understood(source, mappings)[0]}.values()
    _refuse_two_units(meant, source.path)  # the copy would state one of them

    def as_logged(m: Meant, column: Column, ends: tuple[int, int]) -> tuple[Channel, list[Finding]]:
        # No meaning: what has one is SI.
        place = (m.field.name, m.field.path, None, m.axle, m.unit, m.reason)
        return Channel(*place, column, len(column.t), label=m.field.label), []

    log = _log(source, list(meant), [], as_logged)
    with_samples = tuple(c for c in log.channels if c.data.valid.any())
    if not with_samples:
        hint = f"see the findings of `adhesion inspect {log.path}`"
        raise UserError(f"{log.path}: no channel holds a number", hint)
    without_samples = (c for c in log.channels if not c.data.valid.any())
    notes = [Finding("empty-channel", "info", c.title) for c in without_samples]
    for c in (c for c in with_samples if c.levels):
        names = {"words": _describe_levels(c.levels)}
        notes.append(Finding("words-as-numbers", "info", c.title, names=names))
    findings = (*log.findings, *notes, *_not_copied(source, with_samples))
    return replace(log, channels=with_samples, findings=findings)


def _not_copied(source: Source, channels: Sequence[Channel]) -> Iterator[Finding]:
    """What a copy of a log with these channels does not hold, or holds only as a guess."""
    copied = {c.name for c in channels}
    texts = str(source.reasons.get("not numeric", "")).split(", ")
    texts += [f.name for f in source.texts]
    if columns := [x for x in dict.fromkeys(texts) if x and x not in copied]:
        names = {"columns": listed(columns)}
        yield Finding("texts-not-copied", "info", "", len(columns), names=names)
    if source.absolute and TAKEN_AS_UTC in source.time_reason:
        yield Finding("zone-not-stated", "info")
    if lines := source.reasons.get("preamble"):
        yield Finding("preamble-not-copied", "info", names={"lines": str(lines)})


def needed(
    source: Source, mappings: Sequence[Mapping], further: Collection[Meaning] = ()
) -> tuple[list[Meant], list[Finding]]:
    """What an analysis takes of a log, each with its unit known, and what was found on the way.

    Arguments as of `read`.

    Raises:
        UserError: where a unit that is needed cannot be known, or not which axles a pressure
            serves.
    """
    meant, findings = _understood(source, mappings)
    if any(m.reason == UNCLEAR for m in meant):
        raise _unclear(meant, source.path)
    chosen = [m for m in meant if m.meaning in INPUTS]
    _refuse_two_units(chosen, source.path)
    braked = {m.axle for m in chosen if m.meaning == "pressure"}
    for m in list(chosen):
        spare = m.meaning == "clamping_force" and m.axle in braked  # it follows from the pressure
        if not m.unit and (spare or m.meaning in _OPTIONAL):
            chosen.remove(m)
            names = {"meaning": m.describe, "reason": _lacks(m), "key": str(m.meaning)}
            names["unit"] = _USUAL.get(m.meaning, "m/s")
            findings.append(Finding("unit-unknown", "warning", channel=m.title, names=names))
        else:
            _check_unit(m, chosen, source.path)
    for m in meant:
        if m.reason == ED_WITHOUT_UNIT:
            entry = {"channel": m.field.channel, "field": m.field.path, "unit": "kN"}
            names = {"setting": toml.option(f"channels.ed_force = {toml.table(entry)}")}
            findings.append(Finding("ed-force-unit", "warning", channel=m.title, names=names))
        elif m.reason == UNCLEAR_VALVE:
            valve = toml.table(entry_of(m.field))
            line = f'channels.vent_valve."axle {m.axle or "N"}" = {valve}'
            names = {"setting": toml.option(line)}
            findings.append(Finding("valve-unclear", "info", channel=m.title, names=names))
    without_unit = ("latitude", "longitude", *model.STATES)
    short_units = ("mm", "cm")  # places of a piston or a valve, not of a train
    extras = [m for m in meant if m.meaning in further and (m.unit or m.meaning in without_unit)]
    chosen += [m for m in extras if m.meaning not in model.PLACES or m.unit not in short_units]
    return chosen, findings


def without_empty(log: Log) -> Log:
    """The log, of channels with a meaning, without those that hold no number; they are reported.

    Raises:
        UserError: where nothing is left of something that is needed.
    """
    with_samples = [c for c in log.channels if len(c.data.t)]
    meanings = {_NEEDED.get(c.meaning) for c in with_samples}
    findings = []
    for c in log.channels:
        if len(c.data.t) or c.meaning == "true_slip":  # a known force may come without it
            continue
        kind = _NEEDED.get(c.meaning)
        if kind and kind not in meanings:
            text = f"{log.path}: channel {c.title!r} has no usable sample ({c.rows} in the log)"
            hint = f"see the findings of `adhesion inspect {log.path}`"
            causes = (f for f in log.findings if f.channel == c.title)
            if cause := next((f for f in causes if f.code == "csv-no-numbers"), None):
                text, hint = f"{text}: {cause.message}".removesuffix("."), cause.hint or hint
            raise UserError(text, hint)
        axles_of_kind = (f.axle for f in with_samples if _NEEDED.get(f.meaning) == kind)
        severity: Severity = "info" if kind is None or c.axle in axles_of_kind else "warning"
        findings.append(Finding("empty-channel", severity, channel=c.title))
    return replace(log, channels=tuple(with_samples), findings=(*log.findings, *findings))


def _refuse_two_units(chosen: Collection[Meant], path: Path) -> None:
    for m in chosen:
        if m.unit_too:
            text = f"{path}: the unit of channel {m.title!r} is stated twice: {m.unit!r} "
            text += f"({m.field.unit_from or 'in the name'}) and {m.unit_too!r} (in the name)"
            raise UserError(text, f"state the right one, as {toml.option(_line(m, chosen))}")


def _check_unit(m: Meant, chosen: Collection[Meant], path: Path) -> None:
    """Refuses a channel with a meaning whose unit the log does not state, or not completely."""
    assert m.meaning
    if m.meaning in model.OTHER_BRAKES:  # on or off, or any force
        return
    if not m.unit:
        raise _without_unit(m, chosen, path)
    unit = units.stated_unit(m.unit, m.meaning, m.title)
    if unit.dimension in ("pulse rate", "count") and not m.teeth:
        hint = f"state them, as {toml.option(_line(m, chosen, teeth=80))}"
        text = f"{path}: channel {m.title!r} counts pulses ({m.unit}), pulses per turn unknown"
        raise UserError(text, hint)
    full_force_known = bool(m.mapping and m.mapping.full_force)
    if unit.dimension == "ratio" and m.meaning in MOTOR_FORCES and not full_force_known:
        hint = f"state it in N, as {toml.option(f'channels.{m.meaning}.full_force = 60000')}"
        text = f"{path}: channel {m.title!r} is a share ({m.unit}), the force of 100 % is unknown"
        raise UserError(text, hint, code=2)


def _without_unit(m: Meant, chosen: Collection[Meant], path: Path) -> UserError:
    """Asks for the unit of a channel, and for those of the other meanings that lack one."""
    optional = {*model.OTHER_BRAKES, *_OPTIONAL}
    required = (c for c in chosen if not c.unit and c.meaning not in optional)
    asked = {m.meaning: m} | {c.meaning: c for c in reversed([*required]) if c.meaning != m.meaning}
    pairs = ((f"{c.title!r} looks like the {c.describe}", _lacks(c)) for c in asked.values())
    subjects = "; ".join(f"channel {appearance}, but {fault}" for appearance, fault in pairs)
    if len(asked) > 1:
        lines = (_line(c, chosen) for c in asked.values())
        return UserError(f"{path}: {subjects}", f"state them, as {toml.option(*lines)}")
    example, *other_units = _example_units(m)
    alternative = f" (or {', '.join(map(repr, other_units))})" if other_units else ""
    unknown_unit = next(iter(_unknown_units(m)), "")
    number = "" if example[0].isdecimal() else "1 "
    is_single = unknown_unit and not other_units
    condition = f"if 1 {unknown_unit!r} is {number}{example}, " if is_single else ""
    assert m.meaning
    hint = f"{condition}state it, as {toml.option(_line(m, chosen))}{alternative}; units: "
    return UserError(f"{path}: {subjects}", hint + ", ".join(units.known_units(m.meaning)))


def _unclear(meant: Sequence[Meant], path: Path) -> UserError:
    """Asks which axles the pressures serve; the answer is a line with the likely axles."""
    pressures = [m for m in meant if m.reason == UNCLEAR]
    axles = sorted({m.axle for m in meant if m.meaning == "wheel_speed" and m.axle})
    count = len(axles) // len(pressures)  # of each
    entries = {}
    for i, m in enumerate(pressures):
        own_axles = axles[i * count : (i + 1) * count] or list(bogie_axles(i + 1))
        statement = {k: v for k, v in entry_of(m.field, unit=m.unit).items() if v}
        entries[f"bogie {i + 1}"] = {**statement, "axles": own_axles}
    titles = ", ".join(repr(m.title) for m in pressures[:8])
    option = toml.option(f"channels.pressure = {toml.value(entries)}")
    text = f"{path}: which axles these pressures serve is not known: {titles}"
    return UserError(text, f"state the axles of each, as {option}")


def _unknown_units(m: Meant) -> list[str]:
    texts = (m.field.path, m.field.label, m.field.channel)
    return list(filter(None, map(units.unknown_in, texts)))


def _lacks(m: Meant) -> str:
    """What is wrong with the unit of a channel without one."""
    for unknown_unit in _unknown_units(m):
        return f"its name states an unknown unit {unknown_unit!r}"
    return "its unit is not stated"


def _line(m: Meant, chosen: Collection[Meant], teeth: int = 0) -> str:
    """The line by which a user states the unit of a channel and of the others of its meaning.

    One line does for all of them where nothing is stated yet and they have the same unit.
    """
    same_meaning = [c for c in chosen if c.meaning == m.meaning]
    usual = _example_units(m)[0]
    key = "speed" if m.meaning == "wheel_speed" else m.meaning
    if len({c.unit for c in same_meaning}) == 1 and "[channels]" not in m.reason:
        entry = toml.table({"unit": m.unit or usual, "teeth": teeth})
        return f"channels.{key} = {entry}"
    entries = {}
    for c in same_meaning:
        entries[c.axle] = toml.table(entry_of(c.field, unit=c.unit or usual, teeth=teeth))
    all_entries = ", ".join(f'"axle {axle or 1}" = {entry}' for axle, entry in entries.items())
    return f"channels.{key} = {entries.get(None, f'{{{all_entries}}}')}"


def _example_units(m: Meant) -> list[str]:
    """Units for a hint: the usual one, or those that a factor behind a unit in the name may mean.

    "mbar/10" is a tenth of it, rarely ten. Else the likelier one gives the usual step. Of a unit
    that is known with another prefix, as "mm/s", it is the known one with a factor; so it is of a
    share, a voltage or a current.
    """
    for unknown_unit in _unknown_units(m):
        plain_text = unicodedata.normalize("NFKC", unknown_unit).replace("\u2212", "-")
        match = _FACTOR_BEHIND.fullmatch(plain_text)
        unit = match and units.unit(match[1])
        if match and unit:
            power = re.fullmatch(r"10\^?(-\d)", match[3])
            number = 10.0 ** int(power[1]) if power else float(match[3].replace(",", "."))
            step = _USUAL_STEP.get(unit.dimension, unit.factor)
            factors = sorted((number, 1 / number), key=lambda x: abs(log10(x * unit.factor / step)))
            if match[2] == "/":
                factors = [1.0 / number, number]
            return [f"{factor:g} {match[1]}" for factor in factors]
        for prefix, factor in _PREFIXES.items():
            remark = plain_text.removeprefix(prefix)
            if remark != plain_text and units.unit(remark):
                return [f"{factor:g} {remark}"]
        if _SHARE.match(plain_text):
            return [f"0.1 {_USUAL.get(m.meaning, 'm/s')}"]
    return [_USUAL.get(m.meaning, "m/s")]


def _understood(source: Source, mappings: Sequence[Mapping]) -> tuple[list[Meant], list[Finding]]:
    """`understood`; mappings are for raw logs, a result of this program needs none.

    Raises:
        UserError: names the log, and the line of [channels] that names none of its channels.
    """
    all_fields = (*source.fields, *source.texts)
    fields = [f for f in all_fields if f.message_type != "adhesion.Event"]  # not measured
    train_speed_source = source.metadata.get("adhesion.provenance", {}).get("train_speed")
    if train_speed_source in (model.NOT_MEASURED, model.AS_INPUT):
        trains = [f for f in fields if f.path == "train_speed"]
        # What was made of the axles will be again; an input is in the file of each axle.
        repeated = trains[1:] if train_speed_source == model.AS_INPUT else trains
        fields = [f for f in fields if f not in repeated]
    used_mappings = () if "adhesion.settings" in source.metadata else mappings
    by_channel, notes = [m for m in used_mappings if m.channel], list[Finding]()
    is_several = source.options.several_loggers and bool(by_channel)
    if is_several and not any(channel_fields(fields, m) for m in by_channel):
        used_mappings = [m for m in used_mappings if not m.channel]
        names = {"channels": listed(dict.fromkeys(m.channel for m in by_channel))}
        notes = [Finding("channels-of-another-log", "warning", names=names)]
    try:
        meant, findings = understood(fields, used_mappings)
    except UserError as e:
        remedy = "; or run the logs of each logger by themselves, each with its own -c" * is_several
        raise UserError(f"{source.path}: {e.text}", e.hint + remedy, e.code) from None
    findings = notes + findings
    if train_speed_source == model.AS_INPUT:
        meant = [replace(m, axle=None) if m.meaning == "train_speed" else m for m in meant]
    for i, m in enumerate(meant):
        if m.meaning == "position" and not m.unit:  # positions on a line are in km
            reason = f"{m.reason}; no unit stated, km is the usual one"
            meant[i] = replace(m, unit="km", reason=reason)
    return meant, findings


def _log(
    source: Source,
    chosen: Sequence[Meant],
    findings: list[Finding],
    convert: Callable[[Meant, Column, tuple[int, int]], tuple[Channel, list[Finding]]],
) -> Log:
    """The log of the chosen channels, each made of its samples and the log's ends [ns]."""
    columns = source.columns([m.field for m in chosen])
    times = {id(c.t): c.t for c in columns if len(c.t)}
    start = min((time_axis.earliest(t) for t in times.values()), default=0)
    end_ns = max((int(t[-1]) for t in times.values()), default=0)
    times.clear()
    channels, provenance = [], source.metadata.get("adhesion.provenance", {})
    clocks = [id(c.t) for c in columns]
    indexed_findings: list[tuple[int, Finding]] = []
    columns.reverse()
    for m, clock in zip(chosen, clocks, strict=True):
        column, levels = as_levels(columns.pop(), m.meaning)  # let go one by one
        channel, its_findings = convert(m, column, (start, end_ns))
        if m.meaning and (level_words := provenance.get(words_key(m.meaning, m.axle))):
            levels = tuple(level_words.split("\n"))
        if levels:
            reason = f"{channel.reason}; {_describe_levels(levels)}"
            channel = replace(channel, levels=levels, reason=reason)
        if m.meaning == "wheel_speed" and (unit := provenance.get(f"wheel_speed_{m.axle}")):
            channel = replace(channel, first_unit=unit)
        if m.meaning in MOTOR_FORCES:
            tolerance = m.mapping.tolerance if m.mapping else model.MOTOR_TOLERANCE
            share = float(provenance.get(f"{m.meaning}_tolerance", tolerance))
            channel = replace(channel, tolerance=share)
        channels.append(channel)
        indexed_findings += ((clock, f) for f in its_findings)
    findings += _joined(indexed_findings)
    return Log(
        path=str(source.path),
        format=source.format,
        sha256=source.digest(),
        absolute=source.absolute,
        rows_read=source.rows,
        channels=tuple(channels),
        findings=(*source.findings, *findings),
        account=source.account,
    )


def _describe_levels(levels: Sequence[str]) -> str:
    """Which number each word of a state is, for people."""
    return ", ".join(f"{word!r} is {k}" for k, word in enumerate(levels) if word)


def _joined(findings: Sequence[tuple[int, Finding]]) -> list[Finding]:
    """The findings; those on time that channels share are one, which names them all.

    Faults are shared by the channels of one clock. Notes with the same numbers are shared by all:
    each message of a bus has stamps of its own, which are rounded alike.
    """
    joined: dict[tuple[int, Finding], tuple[Finding, list[str]]] = {}
    for clock, f in findings:
        key = clock, f
        if catalogue()[f.code].section == "time":
            key = clock, replace(f, channel="")
            if f.severity == "info":
                key = 0, replace(f, channel="", count=0, spans=())
        joined.setdefault(key, (f, []))[1].append(f.channel)
    return [replace(f, channel=", ".join(names)) for f, names in joined.values()]
