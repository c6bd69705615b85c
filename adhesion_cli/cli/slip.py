"""`adhesion slip`: the slip-adhesion curve of a log."""

from pathlib import Path
from typing import TYPE_CHECKING

from .options import EVERY, Logs, Shared, checked, rejects, shared, targets

if TYPE_CHECKING:
    from ..slip import Summary


@shared(*EVERY)
def command(logs: Logs, shared: Shared) -> int:
    """Slip, slope and region of every axle; slides, peak and rail; write .slip.mcap and .slip.rrd.

    Without a train speed, one is made of all axles. Of several logs all are analysed before
    anything is written: one that fails leaves no results.

    Example: adhesion slip leaf-film.mcap --set bands.slip_high=0.15
    """
    from ..analysis import analyze
    from ..document import dumps, findings_document, slip_axle
    from ..slip import summary
    from ..text import printable
    from ..write import files
    from . import show
    from .analyze import outputs, write

    load = checked(shared, logs)
    paths = [outputs(shared.out or Path(), log, "slip") for log in logs]
    files.check(targets(shared, [p for pair in paths for p in pair]), shared.force, inputs=logs)
    tell = show.progress(shared.quiet)
    results, summaries, findings = [], [], []
    for log in logs:
        result = analyze(
            log, load, shared.algo, shared.axle, (shared.from_, shared.to), tell,
            train_speed=True,
        )  # fmt: skip
        tell(f"{log.name}: rail under each axle")
        of, told = zip(*(summary(axle, result.vehicle) for axle in result.axles), strict=True)
        results.append(result)
        summaries.append(list(of))
        findings.append([*result.findings, *(f for axle in told for f in axle)])
    starts = [result.log.start_ns() for result in results]
    notes = [
        [f"```\n{table([s], start, shares=False)}\n```" for s in of]
        for of, start in zip(summaries, starts, strict=True)
    ]
    with rejects(shared, (r.log for r in results), logs):
        write(results, paths, shared.force, notes)
    found = [f for of in findings for f in of]
    if shared.json:
        axles = [
            slip_axle(str(log), start, s)
            for log, start, of in zip(logs, starts, summaries, strict=True)
            for s in of
        ]
        document = {"schema": "adhesion.slip/1", "axles": axles}
        print(dumps({**document, "findings": findings_document(found)}))
    else:
        for log, pair, start, of, told in zip(
            logs, paths, starts, summaries, findings, strict=True
        ):
            print(f"{printable(str(log))}\n{table(of, start)}")
            print(show.wrote(*pair))
            show.message(show.findings(told), shared.quiet or not told)
    if shared.view:
        from .view import show_recording

        show_recording(paths[-1][1])
    return 3 if show.lossy(found) else 0


def table(summaries: "list[Summary]", start_ns: int, shares: bool = True) -> str:
    """Peak, utilisation and (with `shares`) regions of every axle, every slide, the rails."""
    from ..slope import REGIONS
    from . import show

    def spread(x: tuple[float, float, float] | None, digits: int, factor: float = 1.0) -> str:
        if x is None:
            return "not told"
        value, low, high = (show.number(factor * v, digits) for v in x)
        return f"{value} ({low} to {high})"

    regions = REGIONS if shares else ()
    head = ["axle", "peak slip [%]", "peak µ", "utilisation", "slides"]
    head += [f"{r} [%]" for r in regions]
    rows = [
        [
            str(s.axle), spread(s.rail.peak_slip if s.rail else None, 2, 100.0),
            spread(s.rail.peak_mu if s.rail else None, 3), show.number(s.utilisation, 3),
            str(len(s.slides)),
            *(show.number(100.0 * s.regions[r] if s.regions else None, 1) for r in regions),
        ]
        for s in summaries
    ]  # fmt: skip
    parts = [show.table(head, rows)]
    head = [
        "axle",
        "slide at [s]",
        "duration [s]",
        "distance [m]",
        "largest slip [%]",
        "energy [kJ]",
    ]
    rows = [
        [
            str(s.axle), show.number((x.start - start_ns) / 1e9, 2), show.number(x.duration, 2),
            show.number(x.distance, 1), show.number(100.0 * x.max_slip, 1),
            show.number(None if x.energy is None else x.energy / 1e3, 1),
        ]
        for s in summaries
        for x in s.slides
    ]  # fmt: skip
    parts += [show.table(head, rows)] if rows else []
    head = ["axle", "f0", "A", "B [s/m]", "kA", "kS"]
    rows = [
        [str(s.axle), *(spread(s.rail.told.get(n), 3) for n in ("f0", "A", "B", "k_a", "k_s"))]
        for s in summaries
        if s.rail
    ]
    parts += [show.table(head, rows)] if rows else []
    return "\n".join(parts)
