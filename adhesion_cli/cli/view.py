"""`adhesion view`: a result in the Rerun viewer."""

import functools
import sys
from pathlib import Path
from typing import Annotated

import typer

from .options import Shared, shared


@shared()
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Result: .mcap or .rrd.")],
    shared: Shared,
) -> int:
    """Open a result in the Rerun viewer, in its saved layout; the .rrd is made first if needed.

    Example: adhesion view log.adhesion.mcap
    """
    recording = result.with_suffix(".rrd")
    if result.suffix == ".mcap" and not _is_fresh(recording, result):
        from .. import analysis, settings
        from ..estimator import registry
        from ..read.log import open_source
        from ..read.source import ReadOptions
        from ..write import files, rrd
        from . import show

        carried = open_source(result, ReadOptions()).metadata.get("adhesion.settings", {})
        known = list(registry())
        ran = [name for name in known if name in settings.nested(carried)]
        load = functools.partial(settings.load, folder=False)  # as the result was made
        analysed = analysis.analyze(result, load, ran, tell=show.progress(shared.quiet))
        with files.outputs([recording], force=True, record=result) as (picture,):
            rrd.write_result(picture, analysed, known)
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
