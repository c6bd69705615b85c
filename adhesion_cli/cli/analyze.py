"""`adhesion analyze`: the main job."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

from .options import Logs, Shared, loader, shared

if TYPE_CHECKING:
    from ..model import Result


@shared
def command(logs: Logs, shared: Shared) -> int:
    """Compute reference and estimates of each log; write .adhesion.mcap and .adhesion.rrd.

    Example: adhesion analyze log.mcap -c vehicle.toml
    """
    from ..analysis import analyze
    from ..document import document, dumps, rows_used
    from ..write import files
    from . import show

    folder = shared.out or Path()
    paths = [outputs(folder, log, "adhesion") for log in logs]
    files.check_distinct([p for pair in paths for p in pair])
    for log, pair in zip(logs, paths, strict=True):
        files.check(pair, shared.force, inputs=[log])
    results = []
    for log, pair in zip(logs, paths, strict=True):
        result = analyze(
            log, loader(shared), shared.algo, shared.axle, (shared.from_, shared.to),
            show.progress(shared.quiet),
        )  # fmt: skip
        write(result, pair, shared.force)
        results.append(result)
        if not shared.json:
            scores = [(str(a.record.axle), s) for a in result.axles for s in a.scores]
            one = document([result], [named(pair)])["results"][0]
            print(show.headline(result, one["log"]["duration_s"], rows_used(result)))
            for axle in one["axles"]:
                r = axle["reference"]
                print(
                    f"axle {axle['axle']}: reference {r['method']}, "
                    f"noise ±{show.number(r['sigma_n'])} N (1 sigma), "
                    f"95 % band with vehicle tolerances ±{show.number(r['band_n'])} N"
                )
            print(show.scores(scores, "axle"))
            if result.findings:
                show.message(show.findings(result.findings), shared.quiet)
            print(f"wrote {pair[0]}\nwrote {pair[1]}")
    if shared.json:
        print(dumps(document(results, [named(p) for p in paths])))
    if shared.view:
        from .view import show_recording

        show_recording(paths[-1][1])
    return 3 if any(show.lossy(r.findings) for r in results) else 0


def outputs(folder: Path, log: Path, kind: str) -> tuple[Path, Path]:
    """The two files a command writes for a log: `<stem>.<kind>.mcap` and `.rrd`."""
    stem = log.name
    for ending in (".gz", log.suffix, ".adhesion"):
        stem = stem.removesuffix(ending)
    stem = stem.removesuffix(Path(stem).suffix) if log.name.endswith(".gz") else stem
    return folder / f"{stem}.{kind}.mcap", folder / f"{stem}.{kind}.rrd"


def named(pair: tuple[Path, Path]) -> dict[str, str]:
    """The outputs as the JSON names them."""
    return {"mcap": str(pair[0]), "rrd": str(pair[1])}


def write(result: "Result", pair: tuple[Path, Path], force: bool) -> None:
    """Writes both files of one result, together or not at all."""
    from .. import estimator
    from ..write import files, mcap, rrd

    with files.outputs(pair, force, inputs=[Path(result.log.path)]) as (record, picture):
        mcap.write_result(record, result, embedded([result]))
        rrd.write_result(picture, result, list(estimator.registry()))


def embedded(results: "list[Result]") -> str:
    """The document as a result file carries it: by file names, wherever the files lie."""
    from ..document import document, dumps

    whole: dict[str, Any] = document(results, [{} for _ in results])
    for one in whole["results"]:
        one["log"]["path"] = Path(one["log"]["path"]).name
        del one["outputs"]
    return dumps(whole)
