"""`adhesion analyze`: the main job."""

from pathlib import Path
from typing import TYPE_CHECKING

from .options import Logs, Shared, loader, shared

if TYPE_CHECKING:
    from ..model import Result


@shared
def command(logs: Logs, shared: Shared) -> int:
    """Compute reference and estimates of each log; write .adhesion.mcap and .adhesion.rrd.

    Example: adhesion analyze log.mcap -c vehicle.toml
    """
    from ..analysis import analyze
    from ..document import document, dumps, entry
    from ..write import files
    from . import show

    folder = shared.out or Path()
    paths = [outputs(folder, log, "adhesion") for log in logs]
    files.check([p for pair in paths for p in pair], shared.force, inputs=logs)
    entries = []
    for log, pair in zip(logs, paths, strict=True):
        result = analyze(
            log, loader(shared), shared.algo, shared.axle, (shared.from_, shared.to),
            show.progress(shared.quiet),
        )  # fmt: skip
        write(result, pair, shared.force)
        entries.append(entry(result, named(pair)))
        if not shared.json:
            print(show.summary(result, entries[-1]))
            show.message(show.findings(result.findings), shared.quiet or not result.findings)
    if shared.json:
        print(dumps(document(entries)))
    if shared.view:
        from .view import show_recording

        show_recording(paths[-1][1])
    lossy = any(f["severity"] != "info" for e in entries for f in e["findings"])
    return 3 if lossy else 0


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
    from ..document import document, dumps, entry

    entries = [entry(result, {}) for result in results]
    for one in entries:
        one["log"]["path"] = Path(one["log"]["path"]).name
        del one["outputs"]
    return dumps(document(entries))
