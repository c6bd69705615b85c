"""`adhesion compare`: which estimator does best."""

from pathlib import Path
from typing import Annotated

import typer

from ..core.text import printable
from . import results
from .options import ALL_NAMES, Shared, inputs, shared


@shared(*ALL_NAMES)
def command(
    shared: Shared,
    logs: Annotated[
        list[Path] | None, typer.Argument(metavar="LOG", help="Logs and results.")
    ] = None,
) -> int:
    """Rank the estimators against the true force.

    Against the reference where the log has no true force. Writes <log>.compare.mcap and
    <log>.compare.rrd, named after the first log.

    With no LOG: the newest *.adhesion.mcap here, else the bundled sample.

    Example: adhesion compare sample_logs/low-adhesion.mcap -a neso -a leso
    """
    from ..analysis.outputs import write_results
    from ..analysis.summarise import summarise
    from ..core.document import dumps, result_document
    from ..results import atomic_files, vehicle_text
    from ..scores.metrics import pool_scores
    from . import terminal

    if not logs:
        logs = [_newest()]
        terminal.message(f"no log given: comparing {logs[0]}", shared.quiet)
    pair = results.pair(shared.out or Path(), logs[0], "compare")
    analysed = results.analysed(shared, logs, pair)
    summaries = [summarise(r, results.named(pair)) for r in analysed]
    with atomic_files.outputs(pair, shared.force, inputs=inputs(shared, *logs)) as written:
        write_results(written, analysed, summaries)
    if shared.json:
        print(dumps(result_document(summaries)))
    else:
        vehicles = vehicle_text.describe_vehicles(vehicle_text.vehicles_of_logs(summaries))
        print("\n".join(map(terminal.folded, vehicles)))
        for r in analysed:
            rows = [(str(a.record.axle), s) for a in r.axles for s in a.scores]
            print(terminal.scores(rows, Path(r.log.path).name))
        groups = [a.scores for r in analysed for a in r.axles]
        if len(groups) > 1:
            print(terminal.scores([("all", s) for s in pool_scores(groups)], "all axles"))
        for r in analysed:
            name = f"{printable(r.log.path)}:\n" if len(analysed) > 1 else ""
            terminal.show(r.findings, shared.quiet, name)
        print(terminal.wrote(*pair))
    return results.finished(shared, pair[1], [f for r in analysed for f in r.findings])


def _newest() -> Path:
    """The newest result in the current folder, else the bundled sample."""
    from ..core import bundled

    candidates = sorted(
        Path().glob("*.adhesion.mcap"), key=lambda p: (p.stat().st_mtime_ns, p.name)
    )
    return candidates[-1] if candidates else bundled.folder("sample_logs") / bundled.SAMPLE
