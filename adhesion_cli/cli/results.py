"""Shared by the commands that analyse logs: analyse all, then write everything."""

import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING

from ..analysis import outputs
from ..analysis.outputs import named as named
from ..analysis.outputs import pair as pair
from ..analysis.outputs import stem as stem
from ..core.errors import as_user_error
from .options import Shared, check, check_settings, inputs

if TYPE_CHECKING:
    from ..core.finding import Finding
    from ..core.model import Result
    from ..core.summary import FailedLog, ResultSummary
    from ..results.rrd.results import Note
    from ..studies.calibrate import CalibrationRun
    from ..studies.tune import Tuned


def analysed(
    shared: Shared, logs: Sequence[Path], paths: Iterable[Path], train_speed: bool = False
) -> "list[Result]":
    """Every log analysed, after a check of options, settings and outputs; raises UserError.

    With `train_speed`, a log without one gets a reference speed of its axles.
    """
    analyze = _analyzer(shared, logs, paths, train_speed)
    return [analyze(log) for log in logs]


def analysed_or_failed(
    shared: Shared, logs: Sequence[Path], paths: Iterable[Path]
) -> "list[Result | FailedLog]":
    """As `analysed` with a train speed; of several logs, one that fails does not stop the others.

    It does, by its error, with --strict, and where every log fails.
    """
    from ..core.summary import FailedLog
    from . import terminal

    analyze = _analyzer(shared, logs, paths, train_speed=True)
    outcomes: list[Result | FailedLog] = []
    errors: list[Exception] = []
    for log in logs:
        try:
            outcomes.append(analyze(log))
        except Exception as error:  # an internal error in one log must not stop the others
            if shared.strict or len(logs) == 1:
                raise
            if shared.debug:
                traceback.print_exc()
            errors.append(error)
            user_error = as_user_error(error)
            outcomes.append(FailedLog(str(log), user_error.text, user_error.hint))
    if len(errors) == len(logs):
        if not shared.json:
            terminal.show_failed(f for f in outcomes[1:] if isinstance(f, FailedLog))
        raise errors[0]
    return outcomes


def _analyzer(
    shared: Shared, logs: Sequence[Path], paths: Iterable[Path], train_speed: bool = False
) -> "Callable[[Path], Result]":
    """What analyses one of the logs, after a check of options, settings and outputs."""
    from ..analysis.analyze import analyze
    from ..studies.named_together import identify_together
    from . import terminal

    settings = check_settings(shared)
    check(shared, [*paths], *logs)
    window, progress = (shared.from_, shared.to), terminal.progress(shared.quiet)
    if len(logs) > 1:
        progress(f"finding the vehicle of {len(logs)} logs")
    vehicles = dict(zip(logs, identify_together(logs, settings, shared.axle, window), strict=True))
    return lambda log: analyze(
        log, settings, shared.algo, shared.axle, window, progress, train_speed, vehicles[log]
    )


@contextmanager
def written(
    shared: Shared,
    results: "Sequence[Result]",
    sets: Sequence[Sequence[Path]],
    summaries: "Sequence[ResultSummary]",
    slips: "Sequence[tuple[str, Sequence[Note]]]" = (),
) -> Iterator[dict[Path, Path]]:
    """Writes record and recording of each result; names appear when all is written.

    `sets` has the files of each: record, recording, and those that the caller writes. `slips` has
    the document on each log's slip, and a note on that of each axle with its rail.

    Yields:
        Where to write each file, by its name.
    """
    from ..results import atomic_files

    read = [Path(result.log.path) for result in results]
    with atomic_files.sets(sets, shared.force, inputs=inputs(shared, *read)) as place_sets:
        for i, (result, places) in enumerate(zip(results, place_sets, strict=True)):
            slip, notes = slips[i] if slips else ("", ())
            outputs.write_results(places[:2], [result], [summaries[i]], slip, notes)
        yield dict(zip(chain(*sets), chain(*place_sets), strict=True))


def finish_study(
    shared: Shared,
    logs: Sequence[Path],
    files: Sequence[Path],
    study: "Tuned | CalibrationRun",
    module: ModuleType,
    report: str,
) -> int:
    """Writes the TOML of a study into the file, if asked for, and prints it; returns the exit code.

    `module` is that of the study: its `as_toml` and `document` say what is written. `report` is
    what the screen shows.
    """
    from ..core.document import dumps
    from ..results import atomic_files
    from . import terminal

    if files:
        with atomic_files.outputs(files, shared.force, inputs=inputs(shared, *logs)) as (place,):
            place.write_text(module.as_toml(study), encoding="utf-8")
    if shared.json:
        print(dumps(module.document(study, named(files))))
    else:
        print(report)
        terminal.show(study.findings, shared.quiet)
        if files:
            print(terminal.wrote(*files))
    return 3 if terminal.lossy(study.findings) else 0


def finished(shared: Shared, recording: Path, findings: "Sequence[Finding]") -> int:
    """Opens the viewer if asked to; returns the exit code."""
    from .terminal import lossy

    if shared.view:
        from .view import show_recording

        show_recording(recording)
    return 3 if lossy(findings) else 0
