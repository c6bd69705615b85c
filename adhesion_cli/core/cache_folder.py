"""The folder of this user for what can be made again."""

import os
from pathlib import Path


def cache_folder() -> Path:
    """Where the cache is; it may not exist, or not be writable."""
    from_environment = os.environ.get("XDG_CACHE_HOME") or os.environ.get("LOCALAPPDATA")
    return Path(from_environment or Path.home() / ".cache") / "adhesion-cli"
