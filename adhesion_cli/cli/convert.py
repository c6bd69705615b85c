"""`adhesion convert`: a log in another format."""

from pathlib import Path
from typing import Annotated

import typer

from .options import Shared, inputs, loader, places, shared, targets


@shared("config", "set_", "json", "force", "strict", "rejects")
def command(
    log: Annotated[Path, typer.Argument(metavar="IN", help="Log: CSV or MCAP.")],
    target: Annotated[Path, typer.Argument(metavar="OUT", help="File to write: .csv or .mcap.")],
    shared: Shared,
) -> int:
    """Write a log's channels, as logged, in the format of OUT's suffix; units survive.

    Example: adhesion convert leaf-film.mcap leaf-film.csv
    """
    from ..channels.log import unchanged
    from ..formats.open import open_source
    from ..results import atomic_files
    from ..results.log_writer import writer
    from . import terminal

    write = writer(target)
    settings = loader(shared)()
    atomic_files.check(targets(shared, [target]), shared.force, inputs=inputs(shared, log))
    result = unchanged(open_source(log, settings.read), settings.mappings)
    with places(shared, [[target]], [result], [log]) as ((temporary,),):
        write(temporary, result)
    if shared.json:
        from ..analysis.document import dumps, findings_document, tagged

        found, outputs = findings_document(result.findings), {target.suffix[1:]: str(target)}
        count = len(result.channels)
        print(dumps(tagged("convert", outputs=outputs, channels=count, findings=found)))
    else:
        terminal.message(terminal.findings(result.findings), shared.quiet or not result.findings)
        print(f"{terminal.wrote(target)}: {len(result.channels)} channels")
    return 3 if terminal.lossy(result.findings) else 0
