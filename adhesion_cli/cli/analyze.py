"""`adhesion analyze`: the main job."""

from typing import TYPE_CHECKING, Annotated, Any

from . import results
from .options import EVERY, Logs, Shared, option, shared

if TYPE_CHECKING:
    from ..core.model import Result


@shared(*EVERY)
def command(
    logs: Logs,
    shared: Shared,
    scores: Annotated[bool, option("--scores", None, "Score the estimators axle by axle.")] = False,
    budget: Annotated[
        bool, option("--budget", None, "Show what each quantity adds to the uncertainty.")
    ] = False,
) -> int:
    """Compute adhesion force and coefficient of each log.

    Shows each brake application with its uncertainty, the slides, and how well each online
    estimator follows. Writes <log>.adhesion.mcap and <log>.adhesion.rrd.

    Of several logs, those that fail are listed, and the others are written. With --strict, none is
    written if one fails.

    Example: adhesion analyze sample_logs/service-brake.csv
    """
    from ..analysis.json_documents import document, dumps, entry

    pairs = [results.pair(shared, log, "adhesion") for log in logs]
    paths = [path for pair in pairs for path in pair]
    found = results.analysed_or_failed(shared, logs, paths)
    failed = [f for f in found if isinstance(f, results.Failed)]
    done = [(f, p) for f, p in zip(found, pairs, strict=True) if not isinstance(f, results.Failed)]
    entries = [entry(r, results.named(pair)) for r, pair in done]
    results.write(shared, [result for result, _ in done], [pair for _, pair in done], entries)
    if shared.json:
        of = iter(entries)
        every = (f.entry() if isinstance(f, results.Failed) else next(of) for f in found)
        print(dumps(document(list(every))))
    else:
        for (result, _), one in zip(done, entries, strict=True):
            _show(result, one, scores, budget, shared.quiet)
        results.show_failed(failed)
    code = results.finished(shared, done[-1][1][1], [f for r, _ in done for f in r.findings])
    return 3 if failed else code


def _show(
    result: "Result", entry: dict[str, Any], by_axle: bool, budget: bool, quiet: bool
) -> None:
    """One log: brake applications, findings, scores, files."""
    from ..evaluation.metrics import overall
    from . import applications, terminal

    print(f"{terminal.of_log(entry)}\n\n{applications.tables(entry['axles'])}\n", flush=True)
    if budget:
        print(applications.budgets(entry["axles"]))
    terminal.show(result.findings, quiet)
    rows = [(str(a.record.axle), s) for a in result.axles for s in a.scores]
    if by_axle:
        print("\n".join(map(terminal.of_reference, entry["axles"])))
    elif len(result.axles) > 1:
        rows = [("all", s) for s in overall(a.scores for a in result.axles)]
    if rows:
        print(f"Estimators {terminal.scores(rows)}")
    print(terminal.wrote(*entry["outputs"].values()))
