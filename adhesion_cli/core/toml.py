"""TOML files from the user."""

import tomllib
from pathlib import Path
from typing import Any

from .errors import UserError


def read(path: Path, hint: str) -> dict[str, Any]:
    """The tables of a file.

    Raises:
        UserError: for a file that cannot be read or is not TOML; `hint` says what it should be.
    """
    try:
        return tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        text = "no such file" if isinstance(error, FileNotFoundError) else error.strerror
        raise UserError(f"{path}: {text}", hint, code=2) from error
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: {error}", hint, code=2) from error
