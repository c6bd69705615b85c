"""Where the logs of a fleet are: files, folders, globs, and URLs that fsspec knows."""

import glob
import os
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from ..core.errors import UserError, installed_by
from ..core.text import printable
from ..formats.open import FORMATS
from .dataset import TABLES

_TEXT = (".csv", ".tsv", ".txt", ".asc", ".log", ".lvm")
_COMPRESSED = (".gz", ".xz", ".bz2")
_PLAIN = (*_TEXT, *(x for log_format in FORMATS for x in log_format.suffixes))
SUFFIXES = (*_PLAIN, *(x + z for x in _TEXT for z in _COMPRESSED))
_RESULTS = (".adhesion.mcap", ".compare.mcap", ".slip.mcap")
EXTRA = installed_by("fleet")


class LogLocation(NamedTuple):
    """A log: as the user names it, and where a process with another folder finds it."""

    name: str
    place: str
    sha256: str = ""  # of its content, where that is known


def find(named: Sequence[str]) -> list[LogLocation]:
    """The logs that the names stand for, each once, in their order; a UserError for one without.

    Of a folder these are all files with a suffix of a log, those of its folders too. Results of
    this program, hidden files and the folders of a fleet's results are left out. A file that is
    named itself is taken, whatever its suffix.
    """
    locations: dict[str, LogLocation] = {}
    for name in named:
        paths = [] if _is_url(name) else _files(name)
        files = [LogLocation(str(path), os.path.abspath(path)) for path in paths]
        matches = _of_url(name) if _is_url(name) else files
        if not matches:
            hint = f"logs end with {', '.join(_PLAIN)}; text also with {', '.join(_COMPRESSED)}"
            raise UserError(f"{printable(name)}: no logs there", hint)
        for location in matches:
            locations.setdefault(location.place, location)
    return list(locations.values())


@contextmanager
def local(place: str) -> Iterator[Path]:
    """The file of a log, or a passing copy of a URL; a UserError without its library."""
    if not _is_url(place):
        yield Path(place)
        return
    system, path = _open_url(place)
    with tempfile.TemporaryDirectory(prefix="adhesion-") as folder:
        copy = Path(folder) / Path(path).name
        system.get_file(path, str(copy))
        yield copy


def _is_url(name: str) -> bool:
    return "://" in name


def _files(name: str) -> list[Path]:
    path = Path(name)
    if path.is_dir():
        return list(_walk_folder(path))
    if path.exists():
        return [path]
    if not glob.has_magic(name):
        raise UserError(f"{printable(name)}: no such file or folder", "check the path")
    matched = [Path(match) for match in sorted(glob.glob(name, recursive=True))]
    contained = [file for match in matched if match.is_dir() for file in _walk_folder(match)]
    return contained + [m for m in matched if m.is_file() and not _is_result(m.name)]


def _walk_folder(folder: Path) -> Iterator[Path]:
    for directory, folders, files in os.walk(folder):
        if {*folders} >= {*TABLES}:  # a fleet's results
            folders[:] = [x for x in folders if x not in TABLES]
        folders[:] = sorted(x for x in folders if not x.startswith("."))
        yield from (Path(directory, file) for file in sorted(files) if _is_log(file))


def _is_log(file: str) -> bool:
    return file.lower().endswith(SUFFIXES) and not file.startswith(".") and not _is_result(file)


def _is_result(file: str) -> bool:
    return file.endswith(_RESULTS)


def _of_url(url: str) -> list[LogLocation]:
    system, path = _open_url(url)
    try:
        if glob.has_magic(path):
            paths: Iterable[str] = (x for x in system.glob(path) if not _is_result(x))
        elif system.isdir(path):
            paths = (x for x in system.find(path) if _is_log(x.rpartition("/")[2]))
        else:
            paths = [path] if system.exists(path) else []
        urls = sorted(system.unstrip_protocol(x) for x in paths)
    except Exception as error:  # every kind of URL has its own errors
        text = f"{printable(url)}: cannot be listed ({printable(str(error))})"
        raise UserError(text, "check the address and your access rights") from error
    return [LogLocation(x, x) for x in urls]


def _open_url(url: str) -> tuple[Any, str]:
    """The file system of a URL, and the path in it."""
    kind = url.partition("://")[0]
    try:
        from fsspec.core import url_to_fs

        system, path = url_to_fs(url)
    except ImportError as error:
        text = f"{printable(url)}: a library for {printable(kind)}:// is not installed"
        raise UserError(text, f"{EXTRA}; of other kinds of URL {error}") from error
    except ValueError as error:
        text = f"{printable(url)}: {printable(str(error))}"
        raise UserError(text, "use a path, or a URL such as s3://bucket/folder", code=2) from error
    return system, path
