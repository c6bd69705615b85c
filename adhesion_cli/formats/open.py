"""Opens a log by what its first bytes are, else by its suffix."""

import mmap
import re
from codecs import BOM_UTF16_BE, BOM_UTF16_LE
from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.text import as_url, printable, shell_word
from .can_text import BEGINS as CAN_TEXT
from .isolated import Library
from .memory import Signals
from .source import ReadOptions, Source

_WORKBOOK = rb"PK\x03\x04|\xd0\xcf\x11\xe0"  # or an archive, or another old document
_HEAD = 512  # bytes that are looked at


@dataclass(frozen=True, slots=True)
class Format:
    """A format of logs."""

    kind: str  # its name, as results state it
    begins: bytes  # a pattern of what its files begin with
    suffixes: tuple[str, ...]  # they count where the first bytes are of no other format
    open: Callable[[Path, ReadOptions], Source]


def _opener(module: str, function: str) -> Callable[[Path, ReadOptions], Source]:
    """A function of a format's module, which is loaded when the first log is opened."""

    def open_log(path: Path, options: ReadOptions) -> Source:
        source: Source = getattr(import_module(f".{module}", __package__), function)(path, options)
        return source

    return open_log


_csv = _opener("csv.reader", "open_csv")


def _xlsx(path: Path, options: ReadOptions) -> Source:
    """Text may have the suffix .xls: some instruments export it so."""
    is_workbook = re.match(_WORKBOOK, _first_bytes(path))
    open_log = _opener("xlsx", "open_workbook") if is_workbook else _csv
    return open_log(path, options)


# What the remedy gives is read: its types are those of ROS 2.
_TO_MCAP = "make it an MCAP: `pip install rosbags`, then "
_TO_MCAP += "`rosbags-convert --src {} --dst FOLDER --dst-storage mcap`"
_FROM_FOLDER = _TO_MCAP.format("FOLDER_OF_THE_BAG")
_LINE_PROTOCOL = rb"[^\s,=]+(,[^\s,=]+=[^\s,=]+)* [^\s,=]+=[^\n]* \d{16,19}\n"
_AS_PIVOT = "export it as CSV with a column for each field, as pivot() gives it"
_MF4 = Library("mf4", "MDF", ("asammdf",), "mf4")
_CAN = Library("can", "CAN", ("can", "cantools"), "can")


def _mdf(path: Path, options: ReadOptions) -> Source:
    """With a DBC, a log of a bus is a CAN log."""
    if options.dbc:
        with path.open("rb") as file, mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ) as data:
            if data.find(b"CAN_DataFrame") >= 0:
                return _CAN.open(path, options)
    return _MF4.open(path, options)


def _unread(kind: str, begins: bytes, description: str, hint: str, *suffixes: str) -> Format:
    """A format that is known and not read: its name for people, and what to do."""

    def refuse(path: Path, _: ReadOptions) -> Source:
        raise UserError(f"{path}: {description}, which cannot be read", hint)

    return Format(kind, begins, suffixes, refuse)


FORMATS = (
    Format("mcap", rb"\x89MCAP0\r\n", (".mcap",), _opener("mcap.reader", "open_mcap")),
    Format("parquet", rb"PAR1", (".parquet", ".pq"), _opener("parquet", "open_parquet")),
    Format("xlsx", _WORKBOOK, (".xlsx", ".xlsm", ".xlsb", ".xls", ".ods"), _xlsx),
    Format("mf4", rb"(MDF|UnFinMF) ", (".mf4", ".mdf"), _mdf),
    Format("tdms", rb"TDSm", (".tdms",), Library("tdms", "TDMS", ("nptdms",), "tdms").open),
    Format("can", rb"LOGG|" + CAN_TEXT, (".blf", ".trc"), _CAN.open),
    Format("mat", rb"MATLAB \d", (".mat",), _opener("mat", "open_mat")),
    # Its library gives wrong values for sound files, and no error; see docs/howto/my-log.md.
    _unread("famos", rb"\|CF,", "an imc FAMOS log", "export it from FAMOS as CSV, MDF 4 or TDMS"),
    _unread(
        "tdm", rb"(?s)\s*(<\?xml.{,300}?)?<usi:tdm", "a DIAdem TDM log", "save it as TDMS", ".tdx"
    ),
    _unread("rosbag", rb"#ROSBAG", "a ROS 1 bag", _TO_MCAP.format("BAG")),
    _unread("rosbag2", rb"SQLite format 3", "an SQLite file, as a ROS 2 bag is", _FROM_FOLDER),
    _unread("zstd", rb"\x28\xb5\x2f\xfd", "compressed by zstd", "unpack it with `unzstd`"),
    _unread("lfs", rb"version https://git-lfs", "a pointer of Git LFS", "run `git lfs pull`"),
    _unread("hdf5", rb"\x89HDF", "an HDF5 file", "export the channels as CSV, Parquet or MDF 4"),
    _unread("influx", _LINE_PROTOCOL, "a line protocol of InfluxDB", _AS_PIVOT),
)


def open_source(path: Path | Signals, options: ReadOptions) -> Source:
    """Opens a log: signals in memory or a file; what is of no other format is a text log.

    Raises:
        UserError: where the file is missing, no log, damaged from the start, or needs a library
            that is not installed.
    """
    if isinstance(path, Signals):
        return path.source
    log_format = _format(path)
    try:
        source = log_format.open(path, options) if log_format else _csv(path, options)
    except UserError as error:
        if log_format or not options.dbc:
            raise
        text = f"{path}: no CAN log that is known, so that --dbc is not used; as a table: "
        hint = "convert it to BLF, ASC, MF4 or the log of candump; or leave --dbc out"
        raise UserError(text + error.text.removeprefix(f"{path}: "), hint) from error
    if options.dbc and source.format != "can":
        if any(f.channel.casefold() == "dlc" for f in source.fields):
            text = f"{path}: a table of CAN frames without their identifiers, which cannot be read"
            raise UserError(text, "export the frames as BLF, ASC, TRC or the log of candump")
        files = {"dbc": ", ".join(Path(name).name for name in options.dbc)}
        source.findings.append(Finding("dbc-not-used", "info", names=files))
    return source


def kind(path: Path) -> str | None:
    """The format of a file, None where it is a text log or cannot be read."""
    try:
        log_format = _format(path)
    except UserError:
        return None
    return log_format.kind if log_format else None


def check_kind(path: Path) -> None:
    """Refuses a folder; and a pipe or a device: reading it may wait for ever, or never end.

    Raises:
        UserError: as said.
    """
    if path.is_dir():
        hint = f"name the log files in it, or use `adhesion fleet {shell_word(str(path))} -o DIR`"
        raise UserError(f"{path}: a folder, not a log", hint)
    if path.exists() and not path.is_file():
        hint = "write it to a file, and name that"
        raise UserError(f"{path}: a pipe or a device, not a file", hint)


def _format(path: Path) -> Format | None:
    head, suffix = _first_bytes(path), path.suffix.lower()
    if head.startswith((BOM_UTF16_LE, BOM_UTF16_BE)):  # a text
        head = head.decode("utf-16", "ignore").encode()
    by_head = (candidate for candidate in FORMATS if re.match(candidate.begins, head))
    by_suffix = (candidate for candidate in FORMATS if suffix in candidate.suffixes)
    return next(by_head, None) or next(by_suffix, None)


def _first_bytes(path: Path) -> bytes:
    """The first bytes of a file that can be read more than once."""
    try:
        check_kind(path)
        with path.open("rb") as file:
            head = file.read(_HEAD)
    except FileNotFoundError:
        if url := as_url(path):
            hint = "copy the log here; only `adhesion fleet` reads URLs"
            raise UserError(f"{printable(url)}: a URL, not a file", hint) from None
        hint = "a log is a file, write one first" if path.name == "-" else "check the path"
        raise UserError(f"{path}: no such file", hint) from None
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}", "check the file's permissions") from None
    if not head:
        raise UserError(f"{path}: the file is empty", "check that the logger closed it")
    return head
