"""`adhesion report`: a result as one page that can be forwarded."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import UserError
from . import results
from .options import Shared, option, shared

if TYPE_CHECKING:
    from ..core.finding import Finding


@shared("axle", "json", "force", texts={"axle": "Draw figures of this axle; repeatable."})
def command(
    paths: Annotated[
        list[Path],
        typer.Argument(
            metavar="RESULT", help="Results: *.adhesion.mcap, or the folder of a fleet."
        ),
    ],
    shared: Shared,
    out: Annotated[Path | None, option("-o --out", "FILE.html", "Page to write.")] = None,
) -> int:
    """Write a result as one HTML page that can be forwarded.

    It shows verdict, figures, uncertainty, findings and settings. It needs no network and no other
    file, and prints on A4. Without -o it is <log>.adhesion.html in the current folder.

    Several results are compared with the first one: overlaid from the start of braking, with
    differences and their uncertainty. The page is then <log>.compare.html.

    Of a folder that `adhesion fleet` wrote, the page has what `fleet --summary` shows. It is then
    <folder>.html.

    Example: adhesion report service-brake.adhesion.mcap -o brake.html
    """
    from ..core.document import dumps, findings_document, tagged
    from ..results import atomic_files
    from ..results.report import differences, page, run
    from . import terminal

    folders = [path for path in paths if path.is_dir()]
    if folders and len(paths) > 1:
        refusal = f"{folders[0]}: is a folder beside other results"
        raise UserError(refusal, "one page shows result files, or one folder of a fleet", code=2)
    kind = "adhesion" if len(paths) == 1 else "compare"
    name = folders[0].resolve().name if folders else f"{results.stem(paths[0])}.{kind}"
    target = out or Path(f"{name}.html")
    if target.suffix.lower() not in (".html", ".htm"):
        raise UserError(f"{target}: a report is an HTML page", "-o FILE.html", code=2)
    atomic_files.check([target], shared.force, inputs=paths)
    progress = terminal.progress(shared.quiet)
    runs: list[run.ReportRun] = []
    loss: list[Finding] = []
    if folders:
        from ..fleet.summary import summarise_fleet
        from ..fleet.summary_tables import campaign

        fleet = summarise_fleet(folders[0])
        loss, text = fleet.loss, page.campaign_page(campaign(name, fleet))
    else:
        for path in paths:
            progress(f"reading {path.name}")
            runs.append(run.read(path, axles=shared.axle or None))
        text = page.page(runs)
    progress(f"writing {target.name}")
    with atomic_files.outputs([target], shared.force, inputs=paths) as (place,):
        place.write_bytes(text.encode())
    findings = differences.friction_findings(runs) if runs else []
    if shared.json:
        difference_rows = [d._asdict() for d in differences.compare(runs)] if runs else []
        outputs, listing = {"html": str(target)}, findings_document(findings)
        document = tagged("report", outputs=outputs, differences=difference_rows, findings=listing)
        print(dumps(document))
    else:
        print(terminal.wrote(target))
    terminal.show([*findings, *loss], shared.quiet)
    terminal.show_commands(findings, shared.quiet)
    return 3 if loss else 0
