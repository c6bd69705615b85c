"""Which channels of a log the records are made of, or why there are none."""

from collections.abc import Collection, Iterable, Mapping, Sequence
from functools import partial
from typing import NamedTuple

from ..core import toml
from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Channel, Log, Meaning, Vehicle
from .faults import View

Key = tuple[Meaning, int | None]  # what a channel means, and of which axle; None: of the train
Channels = dict[Key, Channel]
BRAKES: tuple[Meaning, ...] = ("pressure", "clamping_force")
SHORTEST = 3  # samples: fewer give no derivative with an error
_LEAVE_OUT = (
    "axle-incomplete speed-outlier speed-stuck speed-unusable pressure-negative pressure-outlier "
    "pressure-stuck pressure-unusable"
).split()
# What a reader leaves out, which may be the channel that is missing.
_NOT_READ = (
    "channel-not-read csv-no-numbers dbc-not-used group-not-read mcap-encoding mcap-not-offered "
    "mcap-text-change mcap-topic-unreadable nested-columns"
).split()


class AxleChoice(NamedTuple):
    """The channels of one axle, and its vehicle."""

    axle: int
    speed: Key
    brake: Key  # pressure, or K
    vehicle: Vehicle  # with the values of this axle for all axles


class Choice(NamedTuple):
    """The channels of a log that have a meaning, and which axles are made of them."""

    channels: Channels
    axles: tuple[AxleChoice, ...]
    requested: tuple[int, ...]  # are analysed; the others help to judge their sensors
    acceleration: Channel | None  # of the train
    findings: list[Finding]

    @property
    def titles(self) -> set[str]:
        """Names of the channels that the asked axles need."""
        of_axles = {k for a in self.axles if a.axle in self.requested for k in (a.speed, a.brake)}
        return {c.title for k, c in self.channels.items() if k in of_axles or k[0] == "train_speed"}


def choose(log: Log, axles: Sequence[int], vehicle: Vehicle) -> Choice:
    """The channels that are used, for the axles that are asked for; for all if none is.

    Raises:
        UserError: where a needed channel is missing, an axle asked for is not there, or the
            vehicle does not have one of the log.
    """
    channels: Channels = {}
    rates = [c for c in log.channels if c.meaning and c.is_rate and len(c.data.t)]
    for c in log.channels:
        if c.meaning and len(c.data.t) and not c.is_rate:
            channels.setdefault((c.meaning, c.axle), c)
    try:
        titles = [c.title for c in log.channels]
        numbers = axle_numbers(log.path, channels, axles, titles, log.proposals)
    except UserError as error:
        causes = [f for f in log.findings if f.code in _NOT_READ]
        if causes:
            name = f"{causes[0].channel!r}: " if causes[0].channel else ""
            error.text += f". {name}{causes[0].message.removesuffix('.')}"
            error.hint = causes[0].hint or error.hint
        raise
    requested, choices, findings = tuple(axles or numbers), [], []
    for axle in numbers:
        speed = find(channels, "wheel_speed", axle)
        brake = brake_of(channels, axle)
        if speed and brake:
            choices.append(AxleChoice(axle, speed, brake, vehicle.of_axle(axle)))
        elif axle in requested and (key := speed or brake):
            brakes = [c for (meaning, _), c in channels.items() if meaning in BRAKES]
            speed_keys = [k for k in channels if k[0] == "wheel_speed" and k[1]]
            speeds = [channels[k] for k in speed_keys if not brake_of(channels, k[1] or 1)]
            spares = sorted(brakes if speed else speeds, key=partial(_distance, axle))
            findings.append(incomplete(axle, channels[key].title, speed is not None, spares))
    return Choice(channels, tuple(choices), requested, rates[0] if rates else None, findings)


def axle_numbers(
    path: str,
    keys: Collection[Key],
    axles: Sequence[int],
    titles: Sequence[str],
    proposals: Mapping[str, str] | None = None,
) -> list[int]:
    """Numbers of the axles of which a log has anything; a log without numbers is of axle 1.

    `axles` are those that are asked for, all if empty, `titles` the names of its channels,
    `proposals` options for what is missing, see `Log`.

    Raises:
        UserError: where a needed channel is missing, or an axle asked for is not there.
    """
    meanings = {meaning for meaning, _ in keys}
    error = None
    if "wheel_speed" not in meanings:
        error = _missing(path, titles, "wheel speed", (proposals or {}).get("speed"))
    elif meanings.isdisjoint(BRAKES):
        error = _missing(path, titles, "brake-cylinder pressure", (proposals or {}).get("pressure"))
    if error:
        if meanings & {"wheel_speed", "train_speed"}:
            stops_hint = "`adhesion stops` gives distance and deceleration without it."
            error.hint = f"{stops_hint} {error.hint}"
        raise error
    of_axles: tuple[Meaning, ...] = ("wheel_speed", *BRAKES)
    numbers = sorted({a for meaning, a in keys if a and meaning in of_axles}) or [1]
    if unknown := set(axles) - set(numbers):
        available = f"the log has axles {', '.join(map(str, numbers))}"
        raise UserError(f"{path}: no axle {min(unknown)}", available, code=2)
    return numbers


def incomplete(axle: int, title: str, has_speed: bool, spares: Sequence[Channel] = ()) -> Finding:
    """An axle with a wheel speed and no brake, or the other way round.

    `title` is of the channel that it has. The first of `spares` may be the missing one: a pressure
    then stays that of its own axle as well.
    """
    lacking = "pressure or clamping force" if has_speed else "wheel speed"
    entry, axles = {"channel": "NAME"}, [axle]
    if spares:
        spare = spares[0]
        entry = {"channel": spare.name, "field": spare.field}
        axles = [spare.axle, axle] if has_speed and spare.axle else [axle]
    key = f"channels.{'pressure' if has_speed else 'speed'}"
    lines = (f'{key}."axle {number}" = {toml.table(entry)}' for number in axles)
    names = {"lacking": lacking, "option": toml.option(*lines)}
    return Finding("axle-incomplete", "warning", channel=title, values={"axle": axle}, names=names)


def _distance(axle: int, channel: Channel) -> tuple[bool, int]:
    """How far a channel's axle is from this one; the other axle of a bogie is the nearest."""
    other_axle = channel.axle or axle
    return (other_axle + 1) // 2 != (axle + 1) // 2, abs(other_axle - axle)


def brake_of(keys: Collection[Key], axle: int) -> Key | None:
    """The key of an axle's pressure, else of its clamping force."""
    return find(keys, "pressure", axle) or find(keys, "clamping_force", axle)


def find(keys: Collection[Key], meaning: Meaning, axle: int | None) -> Key | None:
    """The key of an axle's own channel, else of the one that belongs to no axle."""
    candidates: tuple[Key, Key] = ((meaning, axle), (meaning, None))
    return next((k for k in candidates if k in keys), None)


def _missing(path: str, titles: Sequence[str], quantity: str, proposal: str | None) -> UserError:
    names = ", ".join(map(repr, titles[:8])) or "none"
    remedy = f"if it is another one, state it, as {proposal}" if proposal else "log it, too"
    text = f"{path}: no channel is a {quantity} (recognised: {names})"
    return UserError(text, f"`adhesion inspect` lists the channels; {remedy}")


def no_records_error(
    log: Log, choice: Choice, view: View, findings: Iterable[Finding]
) -> UserError:
    """Why there is no record at all."""
    if reasons := [f for f in findings if f.code in _LEAVE_OUT]:
        text = " ".join(f"{f.channel}: {f.message}" for f in reasons)
        return UserError(f"{log.path}: nothing to analyse: {text}", reasons[0].hint or "")
    if view.window != (None, None):
        text = f"{log.path}: no sample between --from and --to"
        return UserError(text, "seconds after the log's start", code=2)

    def describe(*meanings: Meaning) -> str:
        chosen = [c.data.t for (meaning, _), c in choice.channels.items() if meaning in meanings]
        start_ns, stop_ns = min(int(t.min()) for t in chosen), max(int(t.max()) for t in chosen)
        span = f"{start_ns / 1e9:.3f} to {stop_ns / 1e9:.3f} s"
        return f"{max(map(len, chosen))} usable samples, {span}"

    speed, brake = describe("wheel_speed"), describe("pressure", "clamping_force")
    return UserError(
        f"{log.path}: wheel speed ({speed}) and pressure ({brake}) share no time, "
        f"or fewer than {SHORTEST} samples",
        "state the clock, as --set channels.time.source=log, or convert one of them",
    )
