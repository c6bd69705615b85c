"""The commands as functions: what is on the command line, in a program or a notebook.

Keywords that all of them share:

- `settings`: a TOML file, or a mapping with its tables, or a list of these. Later ones count.
- Any section of the settings, as ``vehicle={"phi": 0.28}``, ``channels={...}`` or
  ``neso={"beta1": 100}``. These count more than `settings`, as ``--set`` on the command line.
- ``./adhesion.toml`` is read where there is one. It counts less than `settings`.
- `strict`: damaged data is an error, not a finding.

A log is the path of a file, `Signals`, or a table of pandas, pyarrow or polars. Nothing is printed,
and nothing is written to the disk, except by `convert` and by `write` of a result.
"""

import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from ..analysis import analyze as analysis
from ..analysis.inspection import inspect_log
from ..analysis.settings import Settings
from ..analysis.slip_of_log import slip_of
from ..channels.log import unchanged
from ..core.errors import UserError
from ..core.model import IdentifiedVehicle
from ..formats.memory import Signals
from ..formats.open import open_source
from ..results import atomic_files, wide_table
from ..studies import brake_test as brake_tests
from ..studies import calibrate as calibration
from ..studies.named_together import identify_together
from ..studies.plan import Plan, planned_logs, read_plan
from ..wsp import simulate as simulation
from .choices import Choices, File, SettingsSources, Source, choices, in_python, log_of, logs_of
from .results import Analysis, Calibration, Comparison, Inspection, SlipAnalysis, StopAnalysis

_OF_LOG = ("settings", "strict")
_OF_SPAN = (*_OF_LOG, "reference", "axles", "from_s", "to_s")
_ALL_KEYWORDS = (*_OF_SPAN, "algos")


@in_python
def analyze(  # noqa: PLR0913 (the options of the command, each with a default)
    log: Source,
    *,
    settings: SettingsSources = None,
    algos: str | Iterable[str] = (),
    reference: str | None = None,
    axles: int | Iterable[int] = (),
    from_s: float | None = None,
    to_s: float | None = None,
    strict: bool = False,
    **sections: Any,
) -> Analysis:
    """Adhesion force and coefficient of one log, with their uncertainty.

    Args:
        log: path, `Signals` or table; also a result file.
        settings: TOML file or its tables; a list of them where the later ones count.
        algos: names of online estimators; all if empty.
        reference: ``"smoother"`` (default) or ``"butterworth"``.
        axles: numbers of axles, from 1; all if empty.
        from_s: seconds after the log's start [s].
        to_s: as `from_s` [s].
        strict: whether damaged data is an error.
        sections: any section of the settings, as ``vehicle={"phi": 0.28}``.

    Raises:
        UserError: what is wrong, with `text` and `hint`.

    >>> run = analyze("sample_logs/service-brake.csv", vehicle={"phi": 0.28})  # doctest: +SKIP
    >>> [(one.axle, one.coefficient.mean, one.coefficient.mean_u95) for one in run.applications]
    ... # doctest: +SKIP
    """
    span = from_s, to_s
    chosen = choices(settings, sections, _ALL_KEYWORDS, strict, span, reference, axles, algos)
    return _analyze(log_of(log), chosen, train_speed=True)


@in_python
def inspect(
    log: Source, *, settings: SettingsSources = None, strict: bool = False, **sections: Any
) -> Inspection:
    """Channels of a log with meaning, unit and reason, its rates, gaps and findings.

    `log` and keywords are as in `analyze`.

    Raises:
        UserError: where the log cannot be read.
    """
    chosen = choices(settings, sections, _OF_LOG, strict)
    return Inspection(inspect_log(log_of(log), chosen.settings))


@in_python
def compare(  # noqa: PLR0913 (the options of the command, each with a default)
    logs: Source | Sequence[Source],
    *,
    settings: SettingsSources = None,
    algos: str | Iterable[str] = (),
    reference: str | None = None,
    axles: int | Iterable[int] = (),
    from_s: float | None = None,
    to_s: float | None = None,
    strict: bool = False,
    **sections: Any,
) -> Comparison:
    """Ranks online estimators against the true force, or the reference where none is known.

    `logs` is one log or a list of logs and results; the keywords are those of `analyze`.

    Raises:
        UserError: see `analyze`.
    """
    span = from_s, to_s
    chosen = choices(settings, sections, _ALL_KEYWORDS, strict, span, reference, axles, algos)
    named = logs_of(logs)
    settings_of_logs, _, numbers, window = chosen
    pairs = zip(named, identify_together(named, settings_of_logs, numbers, window), strict=True)
    return Comparison(tuple(_analyze(log, chosen, identified=vehicle) for log, vehicle in pairs))


@in_python
def slip(  # noqa: PLR0913 (the options of the command, each with a default)
    log: Source,
    *,
    settings: SettingsSources = None,
    reference: str | None = None,
    axles: int | Iterable[int] = (),
    from_s: float | None = None,
    to_s: float | None = None,
    strict: bool = False,
    **sections: Any,
) -> SlipAnalysis:
    """Slip, slides and the adhesion curve of every axle.

    `log` and keywords are as in `analyze`.

    Raises:
        UserError: see `analyze`.
    """
    chosen = choices(settings, sections, _OF_SPAN, strict, (from_s, to_s), reference, axles)
    analysis_of_log = _analyze(log_of(log), chosen, train_speed=True)
    return SlipAnalysis(analysis_of_log, slip_of(analysis_of_log.result))


@in_python
def brake_test(  # noqa: PLR0913 (the options of the command, each with a default)
    logs: File | Sequence[File] = (),
    *,
    plan: File | None = None,
    settings: SettingsSources = None,
    axles: int | Iterable[int] = (),
    from_s: float | None = None,
    to_s: float | None = None,
    strict: bool = False,
    **sections: Any,
) -> StopAnalysis:
    """The brake test: the stops of all logs as one series, its groups, limits and WSP figures.

    `logs` is the path of one log or a list of paths; `plan` a TOML file that says which log is of
    which group, and which logs there are if none is given. The other keywords are as in `analyze`.

    Raises:
        UserError: where a log is no file or in no group of the plan, or every log fails.
    """
    keywords = _OF_LOG, strict, (from_s, to_s), None, axles
    chosen = choices(settings, sections, *keywords)

    def load(files: Sequence[Path]) -> Settings:
        sources: Any = settings if isinstance(settings, list | tuple) else [settings or {}]
        return choices([*sources, *files], sections, *keywords).settings

    stated_plan = read_plan(Path(plan)) if plan else Plan()
    paths = planned_logs(stated_plan) if plan and not logs else logs_of(logs)
    files = [log for log in paths if isinstance(log, Path)]
    if len(files) < len(paths):
        raise UserError("a log in memory is no file", "give the paths of logs", code=2)
    return StopAnalysis(
        brake_tests.run(files, load, stated_plan, chosen.axles, chosen.window, lambda _: None)
    )


@in_python
def calibrate(
    logs: Source | Sequence[Source],
    *,
    settings: SettingsSources = None,
    strict: bool = False,
    **sections: Any,
) -> Calibration:
    """The vehicle's force from the deceleration of its own logs.

    `logs` is one log or a list of logs, all of one vehicle; keywords are as in `analyze`.

    Raises:
        UserError: where the logs do not determine the vehicle, or contradict each other.
    """
    chosen = choices(settings, sections, _OF_LOG, strict)
    return Calibration(calibration.calibrate(logs_of(logs), chosen.settings))


@in_python
def simulate(scenario: File, *, seed: int | None = None, dt: float | None = None) -> Signals:
    """The log of a simulated stop: what the sensors measure, and the true force.

    Args:
        scenario: name of a bundled scenario, or the path of a scenario TOML.
        seed: of the noise, in place of the scenario's.
        dt: time step [s], in place of the scenario's.

    Raises:
        UserError: for an unknown scenario, a value out of range.
    """
    simulated = simulation.run(simulation.load(os.fspath(scenario)), seed, dt)
    return Signals.of_log(simulation.as_log(simulated))


@in_python
def convert(
    log: Source,
    target: File,
    *,
    settings: SettingsSources = None,
    strict: bool = False,
    force: bool = False,
    **sections: Any,
) -> Path:
    """Writes a log in the format of the target's suffix; units survive.

    Returns the file. An older one is replaced with `force`; log and other keywords are as in
    `analyze`.

    Raises:
        UserError: where it exists already, the log cannot be read, or the disk refuses.
    """
    path, source = Path(target), log_of(log)
    write = wide_table.writer(path)
    checked = choices(settings, sections, (*_OF_LOG, "force"), strict).settings
    inputs = [source] if isinstance(source, Path) else []
    atomic_files.check([path], force, inputs=inputs)
    read = unchanged(open_source(source, checked.read), checked.mappings)
    with atomic_files.outputs([path], force, inputs=inputs) as (place,):
        write(place, read)
    return path


def _analyze(
    log: Path | Signals,
    chosen: Choices,
    train_speed: bool = False,
    identified: IdentifiedVehicle | None = None,
) -> Analysis:
    settings, algos, axles, window = chosen
    run = analysis.analyze(
        log, settings, algos, axles, window, train_speed=train_speed, identified=identified
    )
    return Analysis(run)
