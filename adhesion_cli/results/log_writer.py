"""Logs in the format their name ends with."""

from collections.abc import Callable
from pathlib import Path

from ..core.errors import UserError
from ..core.model import Log


def writer(target: Path) -> Callable[[Path, Log], None]:
    """What writes a log in the format of `target`'s suffix; takes the path to write to, the log.

    Raises:
        UserError: for a suffix no format has.
    """
    from . import mcap, wide_table

    writers = {
        ".csv": wide_table.write_csv,
        ".mcap": mcap.write_log,
        ".parquet": wide_table.write_parquet,
        ".xlsx": wide_table.write_workbook,
    }
    if target.suffix.lower() not in writers:
        suffixes = ", ".join(writers)
        text = f"{target}: unknown format {target.suffix!r}"
        raise UserError(text, f"end it with one of {suffixes}", code=2)
    return writers[target.suffix.lower()]
