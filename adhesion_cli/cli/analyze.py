"""`adhesion analyze`: the main job."""

from . import results
from .options import EVERY, Logs, Shared, shared


@shared(*EVERY)
def command(logs: Logs, shared: Shared) -> int:
    """Compute reference and estimates of each log; write .adhesion.mcap and .adhesion.rrd.

    All logs are analysed before anything is written: if one fails, there are no results.

    Example: adhesion analyze leaf-film.mcap --set vehicle.phi=0.28
    """
    from ..analysis.document import document, dumps, entry
    from . import terminal

    pairs = [results.pair(shared, log, "adhesion") for log in logs]
    analysed = results.analysed(shared, logs, [path for pair in pairs for path in pair])
    results.write(shared, analysed, pairs)
    entries = [entry(r, results.named(pair)) for r, pair in zip(analysed, pairs, strict=True)]
    if shared.json:
        print(dumps(document(entries)))
    else:
        for result, one in zip(analysed, entries, strict=True):
            print(terminal.summary(result, one))
            terminal.show(result.findings, shared.quiet)
    return results.finished(shared, pairs[-1][1], [f for r in analysed for f in r.findings])
