"""The commands, run in this process: what they print, and their exit code."""

import contextlib
import io
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import cast

import pytest

from adhesion_cli import __main__
from adhesion_cli.cli import app

Run = Callable[..., subprocess.CompletedProcess[str]]


def in_process(folder: Path, *arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """What the command prints, and its exit code."""
    words = ["adhesion", *map(str, arguments)]
    streams = [
        io.TextIOWrapper(io.BytesIO(), "utf-8", newline="\n", write_through=True) for _ in range(2)
    ]
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
        pytest.MonkeyPatch.context() as patch,
    ):
        patch.setattr(sys, "argv", words)
        try:
            code = app.run()
        except (Exception, KeyboardInterrupt) as error:
            code = __main__._report_end(error)
    out, err = (cast(io.BytesIO, stream.buffer).getvalue().decode() for stream in streams)
    return subprocess.CompletedProcess(words, code, out, err)
