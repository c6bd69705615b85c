"""`adhesion recover`: the undamaged parts of a damaged log."""

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import UserError
from .options import Shared, inputs, loader, shared


@shared("config", "set_", "json", "force", "strict")
def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Damaged MCAP log.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="MCAP to write.")],
    shared: Shared,
) -> int:
    """Write the undamaged parts of an MCAP as a valid file; exit code 3 if data was lost.

    With --strict: an error if data was lost.

    Example: adhesion recover leaf-film.mcap -o whole.mcap
    """
    from ..formats.mcap.reader import McapSource
    from ..results import atomic_files, mcap_container
    from . import terminal

    options = loader(shared)().read
    if out.suffix.lower() != ".mcap":
        raise UserError(f"{out}: the output is an MCAP file", "-o FILE.mcap", code=2)
    atomic_files.check([out], shared.force, inputs=inputs(shared, log))
    source = McapSource(log, options)
    found = source.findings
    with atomic_files.outputs([out], shared.force, inputs=inputs(shared, log)) as (temporary,):
        mcap_container.copy(temporary, source.walk)
    if shared.json:
        from ..analysis.document import dumps, findings_document, tagged

        told = findings_document(found)
        print(dumps(tagged("recover", outputs={"mcap": str(out)}, findings=told)))
    else:
        terminal.message(terminal.findings(found), shared.quiet or not found)
        print(terminal.wrote(out))
    return 3 if terminal.lossy(found) else 0
