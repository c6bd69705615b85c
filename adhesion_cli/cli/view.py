"""`adhesion view`: a result in the Rerun viewer."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Shared, loader, shared


@shared
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Result: .mcap or .rrd.")],
    shared: Shared,
) -> int:
    """Open a result in the Rerun viewer, in its saved layout; the .rrd is made first if needed.

    Example: adhesion view log.adhesion.mcap
    """
    recording = result.with_suffix(".rrd")
    if result.suffix == ".mcap" and not _is_fresh(recording, result):
        from .. import estimator
        from ..analysis import analyze
        from ..write import files, rrd

        analysed = analyze(result, loader(shared))
        with files.outputs([recording], force=True, inputs=[result]) as (picture,):
            rrd.write_result(picture, analysed, list(estimator.registry()))
    show_recording(recording)
    return 0


def _is_fresh(recording: Path, result: Path) -> bool:
    """Whether the .rrd beside a result was made from it; a missing result is told by its reader."""
    try:
        return recording.stat().st_mtime_ns >= result.stat().st_mtime_ns
    except FileNotFoundError:
        return False


def show_recording(recording: Path) -> None:
    """Starts the viewer on a recording and returns; it goes on by itself.

    Raises:
        UserError: where the recording is missing.
    """
    import subprocess

    from ..errors import UserError

    if not recording.is_file():
        raise UserError(f"{recording}: no such file", "`adhesion analyze LOG` writes one")
    arguments = [sys.executable, "-m", "rerun", str(recording), "--bind", "127.0.0.1"]
    subprocess.Popen(arguments, stdin=subprocess.DEVNULL, start_new_session=True)
