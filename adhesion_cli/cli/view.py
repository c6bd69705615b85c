"""`adhesion view`: a result in the Rerun viewer."""

import functools
import re
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import typer

from .options import Shared, shared

_ESTIMATE = re.compile(r"/axle/\d+/estimate/")  # of a result; a comparison's begin with the log


@shared()
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Result: .mcap or .rrd.")],
    shared: Shared,
) -> int:
    """Open a result in the Rerun viewer, in its saved layout.

    The .rrd of an analysis is written again if it is missing or belongs to another result.

    Example: adhesion view leaf-film.adhesion.mcap
    """
    from ..results import atomic_files
    from . import terminal

    recording = result.with_suffix(".rrd")
    if result.suffix == ".mcap" and not atomic_files.belong_together([result, recording]):
        _remake(result, recording, terminal.progress(shared.quiet))
    show_recording(recording)
    return 0


def _remake(result: Path, recording: Path, tell: Callable[[str], None]) -> None:
    """Writes the recording of one analysed log again, with the settings that the result holds.

    Raises:
        UserError: for another kind of file, whose recording shows something else.
    """
    from ..analysis import analyze, settings
    from ..core.errors import UserError
    from ..core.estimator import registry
    from ..formats.open import open_source
    from ..formats.source import ReadOptions
    from ..results import atomic_files, rrd
    from ..results.names import SETTINGS

    source = open_source(result, ReadOptions())
    carried = settings.nested(source.metadata.get(SETTINGS, {}))
    ran = {f.channel.rpartition("/")[2] for f in source.fields if _ESTIMATE.match(f.channel)}
    if not carried or not ran:
        raise UserError(
            f"{result}: {recording.name} is missing, or was not made from it",
            f"write both again by the command that wrote it, with --force; or view {recording}",
        )
    load = functools.partial(settings.load, folder=False)
    algos = [name for name in registry() if name in ran]
    analysed = analyze.analyze(result, load, algos, tell=tell)
    with atomic_files.outputs([result, recording], force=True) as (record, picture):
        shutil.copyfile(result, record)
        rrd.write_result(picture, analysed, list(registry()))


def show_recording(recording: Path) -> None:
    """Starts the viewer on a recording and returns; the viewer keeps running.

    Raises:
        UserError: where the recording is missing.
    """
    import subprocess

    from ..core.errors import UserError

    if not recording.is_file():
        raise UserError(f"{recording}: no such file", "`adhesion analyze LOG` writes one")
    arguments = [sys.executable, "-m", "rerun", str(recording), "--bind", "127.0.0.1"]
    subprocess.Popen(arguments, stdin=subprocess.DEVNULL, start_new_session=True)
