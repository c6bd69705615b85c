"""`adhesion recover`: what is whole in a damaged log."""

from pathlib import Path
from typing import Annotated

import typer


def command(
    log: Annotated[Path, typer.Argument(metavar="LOG", help="Damaged MCAP log.")],
    out: Annotated[Path, typer.Option("-o", "--out", metavar="FILE", help="MCAP to write.")],
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
) -> int:
    """Write what is whole in a damaged MCAP as a valid one; exit code 3 where something was lost.

    Example: adhesion recover damaged.mcap -o whole.mcap
    """
    from ..read.mcap import copy_whole
    from ..read.source import ReadOptions
    from ..write import files
    from . import show

    files.check([out], force, inputs=[log])
    with files.outputs([out], force, inputs=[log]) as (temporary,), temporary.open("wb") as target:
        found = copy_whole(log, target, ReadOptions())
    show.message(show.findings(found), quiet=not found)
    print(f"wrote {out}")
    return 3 if show.lossy(found) else 0
