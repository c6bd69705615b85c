"""Faults while files are written."""

FAULTS = [
    f"{call}:{what}"
    for call, faults in {
        "write": ["error=ENOSPC", "error=EIO", "signal=KILL"],
        "fsync": ["error=EIO", "signal=KILL"],
        "rename": ["error=EIO", "signal=KILL"],
        "unlink": ["error=EIO", "signal=KILL"],
    }.items()
    for what in faults
]
