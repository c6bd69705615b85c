"""`adhesion recover`: the undamaged parts of a damaged log."""

from pathlib import Path
from typing import Annotated

import typer

from ..core.errors import UserError
from . import results
from .options import Shared, check, inputs, load_settings, option, shared


@shared("config", "set_", "json", "force", "strict")
def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Damaged MCAP log.")],
    out: Annotated[Path, option("-o --out", "FILE", "MCAP to write.")],
    shared: Shared,
) -> int:
    """Write the undamaged parts of an MCAP as a valid file.

    The exit code is 3 if data was lost; with --strict that is an error.

    Example: adhesion recover sample_logs/low-adhesion.mcap -o whole.mcap
    """
    from ..formats.mcap.reader import McapSource
    from ..results import atomic_files, mcap_container

    options = load_settings(shared).read
    if out.suffix.lower() != ".mcap":
        raise UserError(f"{out}: the output is an MCAP file", "-o FILE.mcap", code=2)
    check(shared, [out], log)
    source = McapSource(log, options)
    with atomic_files.outputs([out], shared.force, inputs=inputs(shared, log)) as (temporary,):
        mcap_container.copy(temporary, source.walk)
    return results.single(shared, "recover", out, source.findings)
