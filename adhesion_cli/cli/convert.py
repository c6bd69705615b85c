"""`adhesion convert`: a log in another format."""

from pathlib import Path
from typing import Annotated

import typer

from . import results
from .options import LOG_KINDS, Shared, check, inputs, load_settings, shared


@shared("config", "set_", "dbc", "json", "force", "strict")
def command(
    log: Annotated[Path, typer.Argument(metavar="IN", help=f"{LOG_KINDS}, or a result.")],
    target: Annotated[
        Path, typer.Argument(metavar="OUT", help="A .csv, .mcap, .parquet or .xlsx.")
    ],
    shared: Shared,
) -> int:
    """Convert a log to CSV, MCAP, Parquet or Excel; units survive.

    Writes the channels as logged, in the format of OUT's suffix.

    Example: adhesion convert sample_logs/low-adhesion.mcap low-adhesion.csv
    """
    from ..channels.log import unchanged
    from ..formats.open import open_source
    from ..results import atomic_files
    from ..results.log_writer import writer

    write = writer(target)
    settings = load_settings(shared)
    check(shared, [target], log)
    result = unchanged(open_source(log, settings.read), settings.mappings)
    with atomic_files.outputs([target], shared.force, inputs=inputs(shared, log)) as (temporary,):
        write(temporary, result)
    return results.single(shared, "convert", target, result.findings, channels=len(result.channels))
