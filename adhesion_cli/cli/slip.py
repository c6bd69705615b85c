"""`adhesion slip`: the slip-adhesion curve of a log."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from . import results
from .options import EVERY, Logs, Shared, draw, pictures, shared

if TYPE_CHECKING:
    from ..rail.fit import RailFit
    from ..rail.slip import Summary


@shared(*(name for name in EVERY if name != "algo"), "figure")
def command(logs: Logs, shared: Shared) -> int:
    """Show slip, slides and the adhesion curve of every axle.

    Writes <log>.slip.mcap and <log>.slip.rrd.

    Without a train speed, all axles together give a reference speed. All logs are analysed before
    anything is written: if one fails, there are no results. --figure draws curve, slope and
    confidence of the axles that slid.

    Example: adhesion slip sample_logs/low-adhesion.mcap --axle 1
    """
    from ..analysis.json_documents import dumps, entry, slip_document
    from ..core.errors import UserError
    from ..core.text import printable
    from ..rail.slip import summary
    from ..rail.slope import Bands
    from ..results.figures import of_slip
    from . import terminal

    if shared.figure and len(logs) > 1:
        raise UserError("--figure shows one log", "run it for each of them", code=2)
    pairs = [results.pair(shared, log, "slip") for log in logs]
    analysed = results.analysed(shared, logs, [p for pair in pairs for p in pair], train_speed=True)
    tell = terminal.progress(shared.quiet)
    summaries, findings, slips = [], [], []
    for result in analysed:
        tell(f"{result.log.path}: rail under each axle")
        of, told = zip(*(summary(axle, result.vehicle) for axle in result.axles), strict=True)
        summaries.append(of)
        findings.append([*result.findings, *(f for axle in told for f in axle)])
        zero = result.log.start_ns()
        notes = [(f"```\n{note(s, zero)}\n```", s.rail) for s in of]
        slips.append((dumps(slip_document([result.log], [of], findings[-1:])), notes))
    first, title = analysed[0], f"Slip of {Path(analysed[0].log.path).name}"
    bands = Bands(**first.settings["bands"])
    results.write(
        shared, analysed, pairs, [entry(r, {}) for r in analysed], slips,
        lambda place: draw(shared, place, title, of_slip(first, summaries[0], bands)),
    )  # fmt: skip
    if shared.json:
        outputs = [results.named([*pair, *pictures(shared)]) for pair in pairs]
        print(dumps(slip_document([r.log for r in analysed], summaries, findings, outputs)))
    else:
        for result, pair, of, told in zip(analysed, pairs, summaries, findings, strict=True):
            print(f"{printable(result.log.path)}\n{table(of, result.log.start_ns())}")
            print(terminal.wrote(*pair, *pictures(shared)))
            terminal.show(told, shared.quiet)
    return results.finished(shared, pairs[-1][1], [f for of in findings for f in of])


_OF_CURVE = (
    "Constants of Polach's creep law, or of the law nearest to it. The peak's interval also holds "
    "for other laws (docs/explanation/slip.md)."
)
_OF_REGIONS = """\
Share of the braked time in each region:
  unknown  slip hardly changes, so that its slope cannot be measured
  below    below the peak: µ rises with slip, or slip is small
  flat     µ hardly changes with slip: the peak, or a flat part beyond it
           (`optimal` in files: slip and slope in the bands of the AND-test)
  beyond   beyond the peak: µ falls with slip, or slip is above its band"""
_LOCKED = 0.9995  # slip that is shown as 100 %
_CONSTANTS = {"f0": "f0", "A": "A", "B [s/m]": "B", "kA": "k_a", "kS": "k_s"}


def table(summaries: "Sequence[Summary]", start_ns: int) -> str:
    """What the screen shows of a log: rail and regions of every axle, and every slide."""
    from ..rail.slope import SHOWN
    from .terminal import folded, number, records, table

    regions = []
    noise = any(s.slip_rmse is not None for s in summaries)
    for s in summaries:
        shares = zip(SHOWN, (s.regions or {}).values(), strict=False)
        shown = {f"{region} [%]": number(100.0 * x, 1) for region, x in shares}
        rmse = number(None if s.slip_rmse is None else 100.0 * s.slip_rmse, 2)
        regions.append({"axle": str(s.axle)} | shown | ({"slip RMSE [%]": rmse} if noise else {}))
    parts = [records(regions), _OF_REGIONS]
    known = {s.axle: s.rail for s in summaries if s.rail}
    if known:
        parts.insert(0, records([{"axle": str(axle)} | _rail(of) for axle, of in known.items()]))
    if rows := _constants(list(known.values())):
        parts += [table(["rail", *(f"axle {axle}" for axle in known)], rows), folded(_OF_CURVE)]
    if slides := _slides(summaries, start_ns):
        parts.append(records(slides))
    return "\n\n".join(parts)


def note(summary: "Summary", start_ns: int) -> str:
    """What a recording says of an axle: as `table`, without regions."""
    from . import terminal

    width, rail = terminal.NARROW, summary.rail
    values = [*_rail(rail).items(), *_constants([rail])] if rail else []
    parts = [terminal.table(["axle", str(summary.axle)], values, width=width)] if rail else []
    parts += [terminal.folded(_OF_CURVE, width=width)] if rail else []
    if slides := _slides([summary], start_ns):
        parts.append(terminal.records(slides, width))
    return "\n".join(parts) or "no slide"


def _spread(x: tuple[float, float, float] | None, digits: int, factor: float = 1.0) -> str:
    from .terminal import number

    if x is None:
        return "-"
    value, low, high = (number(factor * v, digits) for v in x)
    return f"{value} ({low}–{high})"


def _rail(rail: "RailFit") -> dict[str, str]:
    """What the slides show of the curve's peak, and a dash for what they do not."""
    from .terminal import number

    peak = _spread(rail.peak_slip, 2, 100.0)
    if rail.below and not rail.peak_slip:
        peak = f"below {number(100.0 * rail.below, 2)}"
    return {
        "peak slip [%]": peak,
        "peak µ": _spread(rail.peak_mu, 3),
        "speed [m/s]": number(rail.speed if rail.below else None, 1),
        "utilisation": _spread(rail.utilisation, 3),
    }


def _constants(rails: "Sequence[RailFit]") -> list[list[str]]:
    """A row for each constant that is known of some rail."""
    return [
        [shown, *(_spread(rail.told.get(name), 3) for rail in rails)]
        for shown, name in _CONSTANTS.items()
        if any(name in rail.told for rail in rails)
    ]


def _slides(summaries: "Sequence[Summary]", start_ns: int) -> list[dict[str, str]]:
    """A row for each slide."""
    from .terminal import at_least, number

    return [
        {
            "axle": str(s.axle),
            "start [s]": number((x.start - start_ns) / 1e9, 2),
            "duration [s]": at_least(x.duration, 2, x.at_least),
            "distance [m]": at_least(x.distance, 1, x.at_least),
            # of a locked wheel it is 100 %, whatever the train speed's error
            "max slip [%]": (
                at_least(100.0 * x.max_slip, 1, x.at_least) if x.max_slip < _LOCKED else "100.0"
            ),
            "energy [kJ]": at_least(x.energy and x.energy / 1e3, 1, x.at_least),
        }
        for s in summaries
        for x in s.slides
    ]
