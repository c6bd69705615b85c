"""`adhesion analyze`: the main job."""

from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING

from .options import EVERY, Logs, Shared, checked, rejects, shared, targets

if TYPE_CHECKING:
    from ..model import Result


@shared(*EVERY)
def command(logs: Logs, shared: Shared) -> int:
    """Compute reference and estimates of each log; write .adhesion.mcap and .adhesion.rrd.

    Of several logs all are analysed before anything is written: one that fails leaves no results.

    Example: adhesion analyze leaf-film.mcap --set vehicle.phi=0.28
    """
    from ..analysis import analyze
    from ..document import document, dumps, entry
    from ..write import files
    from . import show

    load = checked(shared, logs)
    folder = shared.out or Path()
    paths = [outputs(folder, log, "adhesion") for log in logs]
    files.check(targets(shared, [p for pair in paths for p in pair]), shared.force, inputs=logs)
    results = [
        analyze(
            log, load, shared.algo, shared.axle, (shared.from_, shared.to),
            show.progress(shared.quiet),
        )
        for log in logs
    ]  # fmt: skip
    with rejects(shared, (r.log for r in results), logs):
        write(results, paths, shared.force)
    entries = [entry(r, named(pair)) for r, pair in zip(results, paths, strict=True)]
    if shared.json:
        print(dumps(document(entries)))
    else:
        for result, one in zip(results, entries, strict=True):
            print(show.summary(result, one))
            show.message(show.findings(result.findings), shared.quiet or not result.findings)
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


def write(
    results: "Sequence[Result]", pairs: Sequence[tuple[Path, Path]], force: bool,
    notes: Sequence[Sequence[str]] = (),
) -> None:  # fmt: skip
    """Writes both files of each result; none gets its name before all are written.

    Args:
        results: of the logs.
        pairs: the files of each.
        force: whether existing ones are replaced.
        notes: on the slip of each axle of each log.
    """
    from .. import estimator
    from ..write import files, mcap, rrd

    inputs = [Path(result.log.path) for result in results]
    with ExitStack() as stack:
        for i, (result, pair) in enumerate(zip(results, pairs, strict=True)):
            record, picture = stack.enter_context(files.outputs(pair, force, inputs=inputs))
            mcap.write_result(record, result, embedded([result]))
            known = list(estimator.registry())
            rrd.write_result(picture, result, known, notes[i] if notes else ())


def embedded(results: "list[Result]") -> str:
    """The document as a result file carries it: by file names, wherever the files lie."""
    from ..document import document, dumps, entry

    entries = [entry(result, {}) for result in results]
    for one in entries:
        one["log"]["path"] = Path(one["log"]["path"]).name
        del one["outputs"]
    return dumps(document(entries))
