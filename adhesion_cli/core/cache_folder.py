"""The folder of this user for what can be made again."""

import atexit
import os
import shutil
import sys
import tempfile
from collections.abc import Callable
from functools import cache
from pathlib import Path


def silent(text: str) -> None:
    """Reports nothing."""


report: Callable[[str], None] = silent  # reports that nothing can be kept; a program sets it

_WRITABLE_BY_OTHERS = 0o022


def cache_folder() -> Path:
    """A folder that this user alone can write, as its code is executed; else a temporary one."""
    return _prepared(os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA") or "")


@cache
def _prepared(base: str) -> Path:
    folder = Path(base or os.path.expanduser("~/.cache"), "adhesion-cli")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
        problem = "" if _is_private(folder) else "other users can write to it"
    except OSError as error:
        problem = f"it cannot be written: {error.strerror}"
    if problem:
        report(f"{folder}: not used, {problem}. Every run compiles its code anew.")
        temporary = tempfile.mkdtemp(prefix="adhesion-")
        atexit.register(shutil.rmtree, temporary, ignore_errors=True)
        folder = Path(temporary, "adhesion-cli")
        folder.mkdir(mode=0o700)
    return folder


def _is_private(folder: Path) -> bool:
    if sys.platform == "win32":  # folders of a user are by default
        return True
    status = folder.stat()
    return status.st_uid == os.geteuid() and not status.st_mode & _WRITABLE_BY_OTHERS
