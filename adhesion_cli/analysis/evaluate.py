"""A log to its summary: of its axles, or of the stops of a train whose axles have no record."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

from ..core.errors import UserError
from ..core.finding import Finding
from ..core.model import IdentifiedVehicle, Log, Result
from ..core.summary import ResultSummary
from ..records.faults import Window
from .analyze import analyze_log
from .request import choose_estimators, read_log
from .settings import Settings
from .stops_of_log import stops_of_log
from .summarise import summarise, summarise_stops


class EvaluatedLog(NamedTuple):
    """A log with its summary."""

    log: Log
    summary: ResultSummary
    result: Result | None  # None: no axle can be analysed, and there are the stops alone

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Those of the analysis, else those of the log."""
        return self.result.findings if self.result else self.log.findings


def evaluate(  # noqa: PLR0913 (as of `analyze`)
    path: Path,
    settings: Settings,
    algos: Sequence[str],
    axles: Sequence[int],
    window: Window,
    train_speed: bool = False,
    identified: IdentifiedVehicle | None = None,
) -> EvaluatedLog:
    """Analyses a log; one that has no axle to analyse gives the stops of the train.

    Arguments as of `analyze`.

    Raises:
        UserError: where the log cannot be read, or has neither.
    """
    choose_estimators(algos)  # a wrong name is an error before a long log is read
    settings, log = read_log(path, settings)
    try:
        result = analyze_log(
            log, settings, algos, axles, window, train_speed=train_speed, identified=identified
        )
    except UserError as refusal:
        stops = stops_of_log(log, settings, window)
        if refusal.code == 2 or not stops:  # 2: the log does not have what is asked for
            raise
        reason = refusal.text.removeprefix(f"{log.path}: ").partition(" (")[0]
        remark = Finding("stops-alone", "info", names={"reason": reason})
        log = replace(log, findings=(*log.findings, remark))
        return EvaluatedLog(log, summarise_stops(log, settings.vehicle, stops), None)
    return EvaluatedLog(result.log, summarise(result, {}), result)
