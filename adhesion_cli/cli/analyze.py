"""`adhesion analyze`: the main job."""

from . import results
from .options import EVERY, Logs, Shared, shared


@shared(*EVERY)
def command(logs: Logs, shared: Shared) -> int:
    """Compute adhesion force and coefficient of each log.

    Writes <log>.adhesion.mcap and <log>.adhesion.rrd: the reference and every estimate.

    Of several logs, those that fail are listed, and the others are written. With --strict, none is
    written if one fails.

    Example: adhesion analyze sample_logs/service-brake.csv --set vehicle.phi=0.28
    """
    from ..analysis.document import document, dumps, entry
    from . import terminal

    pairs = [results.pair(shared, log, "adhesion") for log in logs]
    found = results.analysed_or_failed(shared, logs, [path for pair in pairs for path in pair])
    failed = [f for f in found if isinstance(f, results.Failed)]
    done = [(f, p) for f, p in zip(found, pairs, strict=True) if not isinstance(f, results.Failed)]
    results.write(shared, [result for result, _ in done], [pair for _, pair in done])
    entries = [entry(r, results.named(pair)) for r, pair in done]
    if shared.json:
        of = iter(entries)
        every = (f.entry() if isinstance(f, results.Failed) else next(of) for f in found)
        print(dumps(document(list(every))))
    else:
        for (result, _), one in zip(done, entries, strict=True):
            print(terminal.summary(result, one))
            terminal.show(result.findings, shared.quiet)
        results.show_failed(failed)
    code = results.finished(shared, done[-1][1][1], [f for r, _ in done for f in r.findings])
    return 3 if failed else code
