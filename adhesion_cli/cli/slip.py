"""`adhesion slip`: the slip-adhesion curve of a log."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from . import results
from .options import EVERY, Logs, Shared, draw, pictures, shared

if TYPE_CHECKING:
    from ..rail.fit import RailFit
    from ..rail.slip import Summary


@shared(*EVERY, "figure")
def command(logs: Logs, shared: Shared) -> int:
    """Slip, slope and region of every axle; slides, peak and rail; write .slip.mcap and .slip.rrd.

    Without a train speed, one is made of all axles. Of several logs all are analysed before
    anything is written: one that fails leaves no results. --figure draws curve, slope and
    confidence of the axles that slid.

    Example: adhesion slip leaf-film.mcap --set bands.slip_high=0.15
    """
    from ..analysis.document import dumps, slip_document
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
        zero = result.brake_ns()
        notes = [(f"```\n{table([s], zero, shares=False)}\n```", s.rail) for s in of]
        slips.append((dumps(slip_document([result.log], [of], findings[-1:])), notes))
    first, title = analysed[0], f"Slip of {Path(analysed[0].log.path).name}"
    bands = Bands(**first.settings["bands"])
    results.write(
        shared, analysed, pairs, slips,
        lambda place: draw(place, title, of_slip(first, summaries[0], bands)),
    )  # fmt: skip
    if shared.json:
        outputs = [results.named([*pair, *pictures(shared)]) for pair in pairs]
        print(dumps(slip_document([r.log for r in analysed], summaries, findings, outputs)))
    else:
        for result, pair, of, told in zip(analysed, pairs, summaries, findings, strict=True):
            print(f"{printable(result.log.path)}\n{table(of, result.log.start_ns())}")
            print(terminal.wrote(*pair, *pictures(shared)))
            terminal.message(terminal.findings(told), shared.quiet or not told)
    return results.finished(shared, pairs[-1][1], [f for of in findings for f in of])


_OF_CURVE = (
    "Constants are those of Polach's curve (3), or of the nearest one; the peak's interval holds "
    "on other curves, too (docs/explanation/slip.md)."
)


def table(summaries: "Sequence[Summary]", zero_ns: int, shares: bool = True) -> str:
    """Peak, utilisation and regions of every axle, the rails, every slide from `zero_ns` on.

    Without `shares` there are no regions, each value is a line, and all is as narrow as a
    recording's notes; times there are a recording's, from the brake on.
    """
    from ..rail.slope import REGIONS
    from . import terminal

    def spread(x: tuple[float, float, float] | None, digits: int, factor: float = 1.0) -> str:
        if x is None:
            return "not told"
        value, low, high = (terminal.number(factor * v, digits) for v in x)
        return f"{value} ({low} to {high})"

    def peak(rail: "RailFit | None") -> str:
        if rail and rail.below and not rail.peak_slip:
            return f"below {terminal.number(100.0 * rail.below, 2)}"
        return spread(rail.peak_slip if rail else None, 2, 100.0)

    regions, width = (REGIONS, None) if shares else ((), terminal.NARROW)
    head = ["axle", "peak slip [%]", "peak µ", "at [m/s]", "utilisation", "slides"]
    scored = any(s.slip_rmse is not None for s in summaries)
    head += ["slip rmse [%]"] if scored else []
    head += [f"{r} [%]" for r in regions]
    rows = [
        [
            str(s.axle), peak(s.rail),
            spread(s.rail.peak_mu if s.rail else None, 3),
            terminal.number(s.rail.speed if s.rail and s.rail.below else None, 1),
            spread(s.rail.utilisation if s.rail else None, 3),
            str(len(s.slides)),
            *([terminal.number(s.slip_rmse and 100.0 * s.slip_rmse, 2)] if scored else []),
            *(terminal.number(100.0 * s.regions[r] if s.regions else None, 1) for r in regions),
        ]
        for s in summaries
    ]  # fmt: skip
    constants = ["axle", "f0", "A", "B [s/m]", "kA", "kS"]
    rails = [
        [str(s.axle), *(spread(s.rail.told.get(n), 3) for n in ("f0", "A", "B", "k_a", "k_s"))]
        for s in summaries
        if s.rail
    ]
    both = (head, rows), (constants, rails)
    if shares:
        parts = [terminal.table(*of) for of in both if of[1]]
    else:
        values = [x for names, of in both for row in of for x in zip(names, row, strict=True)]
        parts = [terminal.table(values[0], [x for x in values if x[0] != "axle"], width=width)]
    parts += [terminal.folded(_OF_CURVE, width=width)] if rails else []
    head = [
        "axle",
        "slide at [s]" if shares else "from brake [s]",
        "duration [s]",
        "distance [m]",
        "largest slip [%]",
        "energy [kJ]",
    ]
    rows = [
        [
            str(s.axle), terminal.number((x.start - zero_ns) / 1e9, 2),
            *(
                "≥ " * (x.at_least and value is not None) + terminal.number(value, digits)
                for value, digits in (
                    (x.duration, 2), (x.distance, 1), (100.0 * x.max_slip, 1),
                    (x.energy and x.energy / 1e3, 1),
                )
            ),
        ]
        for s in summaries
        for x in s.slides
    ]  # fmt: skip
    parts += [terminal.table(head, rows, width=width)] if rows else []
    return "\n".join(parts)
