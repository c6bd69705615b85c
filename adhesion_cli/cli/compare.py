"""`adhesion compare`: which estimator does best."""

from pathlib import Path
from typing import Annotated

import typer

from .options import EVERY, Shared, checked, rejects, shared, targets


@shared(*EVERY)
def command(
    shared: Shared,
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="LOG", help="Logs and results.")
    ] = None,
) -> int:
    """Rank the estimators against truth where the log has it, else against the reference.

    With no LOG: the newest *.adhesion.mcap here, else the bundled sample.

    Example: adhesion compare leaf-film.mcap --algo neso --algo leso
    """
    from ..analysis import analyze
    from ..document import document, dumps, entry
    from ..estimator import registry
    from ..metrics import overall
    from ..text import printable
    from ..write import files, mcap, rrd
    from . import show
    from .analyze import embedded, named, outputs

    if not logs:
        logs = [_newest()]
        show.message(f"no log given: comparing {logs[0]}", shared.quiet)
    load = checked(shared, logs)
    pair = outputs(shared.out or Path(), logs[0], "compare")
    files.check(targets(shared, pair), shared.force, inputs=logs)
    results = [
        analyze(
            log, load, shared.algo, shared.axle, (shared.from_, shared.to),
            show.progress(shared.quiet),
        )
        for log in logs
    ]  # fmt: skip
    with (
        rejects(shared, (r.log for r in results), logs),
        files.outputs(pair, shared.force, inputs=logs) as (record, picture),
    ):
        mcap.write_comparison(record, results, embedded(results))
        rrd.write_comparison(picture, results, list(registry()))
    if shared.json:
        print(dumps(document([entry(r, named(pair)) for r in results])))
    else:
        rows = [
            (f"{Path(r.log.path).name} axle {a.record.axle}", s)
            for r in results
            for a in r.axles
            for s in a.scores
        ]
        groups = [a.scores for r in results for a in r.axles]
        if len(groups) > 1:
            rows += [("all", s) for s in overall(groups)]
        print(show.scores(rows, "log"))
        for r in results:
            name = f"{printable(r.log.path)}:\n" if len(results) > 1 else ""
            show.message(name + show.findings(r.findings), shared.quiet or not r.findings)
        print(show.wrote(*pair))
    if shared.view:
        from .view import show_recording

        show_recording(pair[1])
    return 3 if any(show.lossy(r.findings) for r in results) else 0


def _newest() -> Path:
    """The newest result in the current folder, else the bundled sample."""
    from .. import bundled

    found = sorted(Path().glob("*.adhesion.mcap"), key=lambda p: (p.stat().st_mtime_ns, p.name))
    return found[-1] if found else bundled.folder("sample_logs") / bundled.SAMPLE
