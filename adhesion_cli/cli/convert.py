"""`adhesion convert`: a log in another format."""

from pathlib import Path
from typing import Annotated

import typer

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
    from ..core.document import dumps, findings_document, tagged
    from ..formats.open import open_source
    from ..results import atomic_files, wide_table
    from . import terminal

    write = wide_table.writer(target)
    settings = load_settings(shared)
    check(shared, [target], log)
    result = unchanged(open_source(log, settings.read), settings.mappings)
    with atomic_files.outputs([target], shared.force, inputs=inputs(shared, log)) as (temporary,):
        write(temporary, result)
    channels = len(result.channels)
    if shared.json:
        entries = {"channels": channels, "findings": findings_document(result.findings)}
        print(dumps(tagged("convert", outputs={target.suffix[1:]: str(target)}, **entries)))
    else:
        terminal.show(result.findings, shared.quiet)
        print(f"{terminal.wrote(target)}: {channels} channels")
    return 3 if terminal.lossy(result.findings) else 0
