"""Opens a log by what its first bytes are, whatever its name says."""

from pathlib import Path

from ..core.errors import UserError
from .source import ReadOptions, Source

MCAP_MAGIC = b"\x89MCAP0\r\n"


def open_source(path: Path, options: ReadOptions) -> Source:
    """Opens a log.

    Raises:
        UserError: where the file is missing, no log, or damaged from the start.
    """
    head = _first_bytes(path)
    if head == MCAP_MAGIC or path.suffix.lower() == ".mcap":
        from .mcap.reader import open_mcap

        return open_mcap(path, options)
    from .csv.reader import open_csv

    return open_csv(path, options)


def is_mcap(path: Path) -> bool:
    """Whether a file begins as an MCAP does."""
    try:
        return _first_bytes(path) == MCAP_MAGIC
    except UserError:
        return False


def _first_bytes(path: Path) -> bytes:
    """The first bytes of a file that can be read more than once.

    Raises:
        UserError: where there is no such file, or it is empty.
    """
    try:
        if path.is_fifo():
            raise UserError(f"{path}: a pipe, not a file", "write it to a file, and name that")
        with path.open("rb") as file:
            head = file.read(len(MCAP_MAGIC))
    except FileNotFoundError:
        hint = "a log is a file, write one first" if path.name == "-" else "check the path"
        raise UserError(f"{path}: no such file", hint) from None
    except IsADirectoryError:
        raise UserError(f"{path}: a folder, not a log", "name the log files in it") from None
    except OSError as error:
        raise UserError(f"{path}: {error.strerror}", "check the file's permissions") from None
    if not head:
        raise UserError(f"{path}: the file is empty", "check that the logger closed it")
    return head
