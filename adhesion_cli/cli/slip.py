"""`adhesion slip`: the slip-adhesion curve of a log."""

from collections.abc import Sequence
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..core.text import printable
from . import results
from .options import ALL_NAMES, Logs, Shared, option, shared

if TYPE_CHECKING:
    from ..rail.rail_under_slides import Summary
    from ..records.route import Route


@shared(*(name for name in ALL_NAMES if name != "algo"))
def command(
    logs: Logs,
    shared: Shared,
    rows: Annotated[bool, option("--rows", None, "Show every slide, however many.")] = False,
) -> int:
    """Show slip, slides and the adhesion curve of every axle.

    Writes <log>.slip.mcap and <log>.slip.rrd.

    Without a train speed, all axles together give a reference speed. All logs are analysed before
    anything is written: if one fails, there are no results.

    Example: adhesion slip sample_logs/low-adhesion.mcap --axle 1
    """
    from ..analysis.slip_of_log import carried, slip_document, slip_of
    from ..analysis.summarise import summarise
    from ..core.document import dumps
    from ..core.summary import summarise_vehicle
    from ..results.vehicle_text import describe_vehicle
    from . import terminal

    pairs = [results.pair(shared.out or Path(), log, "slip") for log in logs]
    analysed = results.analysed(shared, logs, [p for pair in pairs for p in pair], train_speed=True)
    progress = terminal.progress(shared.quiet)
    slip_results = []
    for result in analysed:
        progress(f"{result.log.path}: rail under each axle")
        slip_results.append(slip_of(result))
    summaries, documents = [summarise(r, {}) for r in analysed], [*map(carried, slip_results)]
    with results.written(shared, analysed, pairs, summaries, documents):
        pass
    if shared.json:
        print(dumps(slip_document(slip_results, [*map(results.named, pairs)])))
    else:
        for slip, files_of in zip(slip_results, pairs, strict=True):
            log = slip.result.log
            vehicle = describe_vehicle(summarise_vehicle(slip.result.identified))
            text = table(slip.axles, log.start_ns(), slip.route, rows)
            print(f"{printable(log.path)}\n{terminal.folded(vehicle)}\n{text}")
            print(terminal.wrote(*files_of))
            terminal.show(slip.findings, shared.quiet)
    return results.finished(shared, pairs[-1][1], [f for s in slip_results for f in s.findings])


_MANY_SLIDES, _SHOWN_SLIDES = 40, 20  # slides of all axles; of more, so many are shown
_OF_REGIONS = """\
Share of the braked time in each region:
  unknown  the slope of µ over slip cannot be measured: slip changes too little, too
           briefly (a short slide), or no more than its noise
  below    below the peak: µ rises with slip, or slip is small
  flat     µ hardly changes with slip: the peak, or a flat part beyond it
           (`optimal` in files: slip and slope in the bands of the AND-test)
  beyond   beyond the peak: µ falls with slip, or slip is above its band"""


def table(
    summaries: "Sequence[Summary]",
    start_ns: int,
    route: "Route | None" = None,
    all_rows: bool = False,
) -> str:
    """What the screen shows of a log: rails, regions, slides after its start [ns], or the worst."""
    from ..rail.slope import REGION_TITLES
    from ..records.route import NOWHERE
    from ..results.slip_text import OF_CURVE, constants, rail_row, slide_rows
    from .terminal import folded, number, records, table

    regions = []
    noise = any(s.slip_rmse is not None for s in summaries)
    for s in summaries:
        shares = zip(REGION_TITLES, (s.regions or {}).values(), strict=False)
        share_columns = {f"{region} [%]": number(100.0 * x, 1) for region, x in shares}
        rmse = number(None if s.slip_rmse is None else 100.0 * s.slip_rmse, 2)
        noise_column = {"slip RMSE [%]": rmse} if noise else {}
        regions.append({"axle": str(s.axle)} | share_columns | noise_column)
    sections = [records(regions), _OF_REGIONS]
    rails = {s.axle: s.rail for s in summaries if s.rail}
    if rail_rows := [{"axle": str(axle)} | rail_row(rail) for axle, rail in rails.items()]:
        sections.insert(0, records(rail_rows))
    if rows := constants(list(rails.values())):
        sections += [table(["rail", *(f"axle {axle}" for axle in rails)], rows), folded(OF_CURVE)]
    if slides := slide_rows(summaries, start_ns, route or NOWHERE):
        listed, heading = slides, ""
        if len(slides) > _MANY_SLIDES and not all_rows:
            ways = (slide.lag_at_most for s in summaries for slide in s.slides)
            ranked_rows = sorted(zip(ways, slides, strict=True), key=itemgetter(0), reverse=True)
            listed = [row for _, row in ranked_rows[:_SHOWN_SLIDES]]
            heading = (
                f"{len(listed)} of {len(slides)} slides, those with the largest distance times "
                "slip first; --rows shows all:\n"
            )
        sections.append(heading + records(listed))
    return "\n\n".join(sections)
