"""Runs a format's library in a process of its own.

Libraries for binary logs trust the file. A damaged one can crash them, keep them busy without end
or make them take all memory. In a process of its own that is one clear error. The process serves
all logs of one format, so that the library is loaded once.
"""

import contextlib
import gc
import importlib
import importlib.util
import os
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

from ..core.children import Child, ChildDiedError
from ..core.errors import UserError, installed_by
from .source import ReadOptions, damaged
from .tables import Reader, TableSource

_MEMORY = 3 << 30, 24  # bytes that reading a log may take, and for each byte of the file
_SECONDS = 120, 2e-6  # for one answer, and for each byte of the file


@dataclass(frozen=True, slots=True)
class Library:
    """What a format needs: the modules, who installs them, and a word for messages."""

    kind: str  # of the log; the module of the format in this package, too
    description: str  # the format, for people
    modules: tuple[str, ...]
    extra: str  # of this package, which installs them

    def open(self, path: Path, options: ReadOptions) -> TableSource:
        """Opens a log of this format.

        Raises:
            UserError: where the library is missing or cannot read the file.
        """
        if missing := [m for m in self.modules if importlib.util.find_spec(m) is None]:
            text = f"{path}: {self.description} needs {' and '.join(missing)}, not installed"
            raise UserError(text, installed_by(self.extra))
        dbc = tuple(str(Path(name).absolute()) for name in options.dbc)
        ask = partial(self.call, path, _read, self.kind, replace(options, dbc=dbc))
        return TableSource(path, self.kind, options, ask)

    def call(self, path: Path, function: Callable[..., Any], *arguments: Any) -> Any:
        """What a function makes of a log in the other process; it takes the path first.

        Raises:
            UserError: where the file cannot be read.
        """
        absolute = path.absolute()
        seconds = _SECONDS[0] + _SECONDS[1] * path.stat().st_size
        try:
            with _starting:
                child = _children.get(self.kind)
                if child is None or not child.is_usable:
                    child = _children[self.kind] = Child()
            return child.call(_call, self, absolute, function, arguments, seconds=seconds)
        except ChildDiedError as error:
            fates = "crashes or needs too much memory", "does not come to an end"
            raise damaged(path, self.description, f"its reader {fates[error.was_late]}") from None
        except UserError as error:
            error.text = error.text.replace(str(absolute), str(path))
            raise


_children: dict[str, Child] = {}
_starting = threading.Lock()

# ---------------------------------------------------------------------------- the other process

_opened: dict[Any, Reader] = {}  # the log that was read last, by what it was opened with


def _call(library: Library, path: Path, function: Callable[..., Any], arguments: Any) -> Any:
    """What the function makes of the file; runs in the other process."""
    try:
        _limit(path)
        return function(path, *arguments)
    except Exception as error:
        _opened.clear()
        cause: BaseException | None = error
        while cause:  # its frames hold the file
            traceback.clear_frames(cause.__traceback__)
            cause = cause.__context__
        if isinstance(error, UserError):
            raise
        if isinstance(error, MemoryError):
            size = _allowed(path.stat().st_size) / 2**30
            text = f"{path}: reading it takes more than {size:.0f} GiB of memory"
            hint = "split the log, or export the channels that are needed"
            raise UserError(text, hint) from error
        reason = " ".join(str(error).split())[:120]
        if type(error) is not ValueError:
            reason = f"its structure is wrong ({type(error).__name__}: {reason})"
        raise damaged(path, library.description, reason) from error
    finally:
        gc.collect()  # closes the file: on Windows, nobody can replace one that is open


def _read(path: Path, kind: str, options: ReadOptions, wanted: list[int] | None) -> Any:
    """What the log holds, or columns of it; runs in the other process."""
    files = [str(path), *filter(os.path.isfile, options.dbc)]
    key = path, options, *(os.stat(file).st_mtime_ns for file in files)
    if key not in _opened:
        _opened.clear()  # lets the file before go
        _opened[key] = importlib.import_module(f".{kind}", __package__).Reader(path, options)
    return _opened[key].contents if wanted is None else _opened.pop(key).read(wanted)


def _allowed(size: int) -> int:
    return _MEMORY[0] + _MEMORY[1] * size


def _limit(path: Path) -> None:
    """Limits the memory that reading a log of this size may take; Windows has no such limit."""
    if sys.platform == "win32":
        return
    import resource

    limit, hard = _allowed(path.stat().st_size), resource.getrlimit(resource.RLIMIT_DATA)[1]
    soft_limit = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
    with contextlib.suppress(ValueError, OSError):
        resource.setrlimit(resource.RLIMIT_DATA, (soft_limit, hard))
