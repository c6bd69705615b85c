"""`adhesion report`: a result as one page that can be forwarded."""

from pathlib import Path
from typing import Annotated

import typer

from . import results
from .options import Shared, option, shared

_Results = Annotated[list[Path], typer.Argument(metavar="RESULT", help="Results: *.adhesion.mcap.")]


@shared("json", "force")
def command(
    paths: _Results,
    shared: Shared,
    out: Annotated[Path | None, option("-o --out", "FILE.html", "Page to write.")] = None,
) -> int:
    """Write a result as one HTML page that can be forwarded.

    It shows verdict, figures, uncertainty, findings and settings. It needs no network and no other
    file, and prints on A4. Without -o it is <log>.adhesion.html in the current folder.

    Several results are compared with the first one: overlaid from the start of braking, with
    differences and their uncertainty. The page is then <log>.compare.html.

    Example: adhesion report service-brake.adhesion.mcap -o brake.html
    """
    from ..analysis.json_documents import dumps, tagged
    from ..core.errors import UserError
    from ..results import atomic_files
    from ..results.report import differences, page, run
    from . import terminal

    kind = "adhesion" if len(paths) == 1 else "compare"
    target = out or Path(f"{results.stem(paths[0])}.{kind}.html")
    if target.suffix.lower() not in (".html", ".htm"):
        raise UserError(f"{target}: a report is an HTML page", "-o FILE.html", code=2)
    atomic_files.check([target], shared.force, inputs=paths)
    tell = terminal.progress(shared.quiet)
    runs = []
    for path in paths:
        tell(f"reading {path.name}")
        runs.append(run.read(path))
    tell(f"writing {target.name}")
    with atomic_files.outputs([target], shared.force, inputs=paths) as (place,):
        page.write(place, runs)
    if shared.json:
        found = [d._asdict() for d in differences.every(runs)]
        print(dumps(tagged("report", outputs={"html": str(target)}, differences=found)))
    else:
        print(terminal.wrote(target))
    return 0
