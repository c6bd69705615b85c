"""What a log format must offer: named scalar fields first, columns of the wanted ones after."""

import hashlib
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import Column, Floats

YEAR_1990 = 631_152_000 * 10**9  # earlier times count from another start, or had no clock [ns]
TAKEN_AS_UTC = "taken as UTC"  # in the reason for a clock of unknown zone
MOST_WORDS = 16  # of a column: one with more is no state
_LONGEST_WORD = 100  # characters
TimeSource = Literal["log", "publish", "header"]  # the clocks of an MCAP message


@dataclass(frozen=True, slots=True)
class Field:
    """One scalar series a log can give, before anyone has said what it means."""

    channel: str  # topic (MCAP) or column header (CSV), as in the log
    path: str = ""  # place inside the message, "" in a CSV: "value", "pose.x", "position[1]"
    label: str = ""  # a name the log itself gives the element, as JointState's `name` does
    # long layouts: the device or axle this series was split off by, in the log's words; MCAP: the
    # reader's own name for one of several channels on one topic
    group: str = ""
    unit: str = ""  # as the log states it in a units row, a `unit` field or metadata; "" if silent
    unit_from: str = ""  # where that stood
    message_type: str = ""  # MCAP schema name, "" in a CSV
    encoding: str = ""  # MCAP message encoding, "" in a CSV
    signal: str = ""  # long layouts: what a row's only number is
    # MF4, TDMS, CAN: the group or message with one time axis that holds it. `group` is then its
    # name for people, where several of them have a channel of this name.
    folder: str = ""
    words: tuple[str, ...] = ()  # of a column of words: those in the head of the log
    column: int = 0  # its number in a table, from 1

    @property
    def name(self) -> str:
        """The topic or column header, and the device in a long layout."""
        return f"{self.channel} ({self.group})" if self.group else self.channel


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """What the user stated about a log.

    They come from the TOML's `[channels]`, `[csv]`, `[xlsx]` and `[can]`, and from flags.
    """

    time_channel: str | None = None  # CSV column that holds the time, by name or "column 3"
    # a key of `formats.csv.clock.COUNTS`, or of dates "iso", "ymd"; None: decided, in a finding
    time_unit: str | None = None
    time_source: TimeSource | None = None  # MCAP; None: decided, in a finding
    group_channel: str | None = None  # CSV column that separates devices or axles
    group_equals: str | None = None  # keep only these rows of it
    header: bool | None = None  # CSV: whether there is a header row; None: decided
    delimiter: str | None = None
    decimal: str | None = None
    encoding: str | None = None
    sheet: str | None = None  # of a workbook; None: decided
    # whether a column of this name is one of a brake: of several sheets, one that has it is read
    names_brake: Callable[[str], bool] | None = field(default=None, compare=False)
    names_place: Callable[[str], bool] | None = field(default=None, compare=False)  # of a sheet
    # whether a log that has none of the channels in [channels] is read by its names
    several_loggers: bool = False
    named_channels: tuple[str, ...] = ()  # in [channels]; the sheet with most of them is read
    dbc: tuple[str, ...] = ()  # CAN: files that say which signals its frames hold
    strict: bool = False  # damage is an error, not a finding


def damaged(path: Path, description: str, reason: str) -> UserError:
    """The refusal of a file of this format that cannot be read."""
    hint = "copy the log again from its source, or export it as CSV with its own tool"
    return UserError(f"{path}: damaged {description} file: {reason}", hint)


def without_numbers(path: Path, causes: Iterable[Finding]) -> UserError:
    """The refusal of a log without numbers, for the first of these causes."""
    text, hint = "the log holds no numbers over time", "check that the logger recorded anything"
    if cause := next(iter(causes), None):
        name = f"{cause.channel!r}: " if cause.channel else ""
        text, hint = f"{text}; {name}{cause.message}".removesuffix("."), cause.hint or hint
    return UserError(f"{path}: {text}", hint)


def distinct_words(texts: Iterable[str]) -> tuple[str, ...]:
    """The words among the first texts of a column; none where they are too many for a state."""
    words = tuple(dict.fromkeys(text.strip() for text in texts))
    is_short = all(len(word) <= _LONGEST_WORD for word in words)
    return words if is_short and len(words) <= MOST_WORDS else ()


def number_words(words: list[str], met: Iterable[str]) -> dict[str, float]:
    """The number of each word of a column; new ones are appended, up to `MOST_WORDS` in all."""
    new_words = [word for word in dict.fromkeys(met) if word not in words]
    words += new_words[: MOST_WORDS - len(words)]
    return {word: float(k) for k, word in enumerate(words)}


def numbered(texts: Any, words: list[str]) -> Floats:
    """The number of each text in a list of words, shape (n,), by `number_words`; NaN for nulls."""
    import pyarrow as pa  # slow to import
    import pyarrow.compute as pc

    encoded = pc.utf8_trim_whitespace(pa.array(texts, pa.string())).dictionary_encode()
    met = encoded.dictionary.to_pylist()
    number_of = number_words(words, met)
    numbers: Floats = np.array([*(number_of.get(word, np.nan) for word in met), np.nan])
    indices: NDArray[np.int64] = np.asarray(pc.fill_null(encoded.indices, len(met)))
    return numbers[indices]


class Source:
    """An opened log. Opening reads the head (CSV) or walks the records (MCAP), not the values."""

    format: str  # "csv", "mcap", "parquet", "xlsx", "mf4", "tdms", "can"
    absolute: bool  # whether time stamps count from 1970
    rows: int  # or messages in the log; final after `columns`
    time_reason: str  # which clock was taken, and why
    fields: Sequence[Field]  # every scalar series that it can give
    texts: Sequence[Field] = ()  # series of words, which may be states
    remedy = "read without --strict to leave these samples out"  # of a refusal with --strict

    def __init__(self, path: Path, options: ReadOptions) -> None:
        self.path, self.options = path, options
        self.findings: list[Finding] = []  # they grow while reading
        self.metadata: dict[str, dict[str, str]] = {}  # MCAP metadata records, by name
        self.account = ""  # what an MCAP has lost, which what is made of it must say as well
        self.reasons: dict[str, object] = {}  # decisions and why, for `inspect`

    def columns(self, wanted: Sequence[Field]) -> list[Column]:
        """The wanted fields, in that order, samples in the log's own order, time untouched.

        A cell that holds no number is NaN with `valid` False. Fields of one row or message share
        one time array object.

        Raises:
            UserError: where the log cannot be read, with file, place and remedy.
        """
        raise NotImplementedError

    def digest(self) -> str:
        """SHA-256 of the file."""
        with self.path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()

    def is_loss(self, finding: Finding) -> bool:
        """Whether it ends the reading with `ReadOptions.strict`."""
        return finding.severity == "error"

    def report(self, *findings: Finding) -> None:
        """Adds findings, each once.

        Raises:
            UserError: a loss, with `ReadOptions.strict`.
        """
        for finding in findings:
            if self.options.strict and self.is_loss(finding):
                place = f" {finding.channel}:" if finding.channel else ""
                raise UserError(f"{self.path}:{place} {finding.message}", self.remedy)
        self.findings = list(dict.fromkeys([*self.findings, *findings]))
