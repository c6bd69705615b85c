"""What the functions return: records, arrays with units, and tables of them."""

import importlib.util
from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from ..analysis import inspection, outputs
from ..analysis.slip_of_log import SlipOfLog, carried, slip_document, summarise_slip
from ..analysis.summarise import brake_applications, summarise
from ..core import document, model, physics, toml
from ..core.annotated import Json, as_json
from ..core.errors import UserError, unknown
from ..core.finding import Finding
from ..core.model import Floats, Log, Quantity, Result, Score
from ..core.summary import BrakeApplication, ResultSummary, StopSummary
from ..core.toml import Table
from ..rail.rail_under_slides import Summary
from ..rail.slope import REGIONS
from ..reference.calibrated_vehicle import CalibratedParameter
from ..results import atomic_files, result_rows, slip_text, stop_rows, tables
from ..results.text_tables import non_empty, number, records
from ..scores.metrics import pool_scores
from ..stops.series import StopSeries
from ..studies import brake_test, calibrate
from .choices import File, axles_of, in_python

if TYPE_CHECKING:
    from ..results.report.plots import Plot

_Rows = Sequence[Mapping[str, str]]


class _Tables(ABC):
    """A result that gives tables, and shows itself as text."""

    _tables: ClassVar[tuple[str, ...]]  # the names; the first is the usual one

    @abstractmethod
    def _table(self, name: str) -> Any:
        """The arrow table of this name."""

    @abstractmethod
    def _display(self) -> tuple[str, dict[str, _Rows]]:
        """What is shown: a title, and rows by the caption of their table."""

    @property
    def findings(self) -> tuple[Finding, ...]:
        """What was found about the data: code, severity, place, values."""
        return tuple(f for _, group in self._grouped_findings() for f in group)

    @in_python
    def to_arrow(self, table: str | None = None) -> Any:
        """A `pyarrow.Table`; the metadata of each field states its ``unit``.

        Args:
            table: which of its tables, as the class lists them; the first if none is named.

        Raises:
            UserError: for a table that it does not have.
        """
        name = table or self._tables[0]
        if name not in self._tables:
            raise unknown("table", name, list(self._tables))
        return self._table(name)

    @in_python
    def to_pandas(self, table: str | None = None) -> Any:
        """The same as a `pandas.DataFrame`; its ``attrs["units"]`` has the units by column.

        Raises:
            UserError: where pandas is not installed, and as `to_arrow`.
        """
        if importlib.util.find_spec("pandas") is None:
            raise UserError("pandas is not installed", "pip install pandas, or use to_arrow()")
        arrow = self.to_arrow(table)
        frame = arrow.to_pandas()
        units = {f.name: (f.metadata or {}).get(b"unit", b"").decode() for f in arrow.schema}
        frame.attrs["units"] = {name: unit for name, unit in units.items() if unit}
        return frame

    def __repr__(self) -> str:
        title, captioned = self._display()
        sections = [f"{caption}\n{records(rows)}" for caption, rows in captioned.items() if rows]
        lines = [
            f"{log}{f.severity}: {f.message} ({f.code}) {f.channel}"
            for log, group in self._grouped_findings()
            for f in group
        ]
        text = "\n\n".join(filter(None, [title, *sections, "\n".join(lines)]))
        return "\n".join(line.rstrip() for line in text.splitlines())

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        """The findings, each group with what stands in front of it."""
        return []


class _Axles(dict[int, Any]):
    """Axles by number; one that is not there is an error with those that are."""

    def __missing__(self, axle: int) -> Any:
        raise AxleError(axle, list(self))


class AxleError(UserError, KeyError):
    """The error for an axle that was not analysed."""

    def __init__(self, axle: object, analysed: Sequence[int] = ()) -> None:
        numbers = ", ".join(map(str, analysed))
        UserError.__init__(self, f"no axle {axle!r} was analysed", f"analysed: {numbers}", 2)

    def __str__(self) -> str:  # KeyError shows a repr
        return self.text


_N = Annotated[Floats, Quantity("N", "")]


@dataclass(frozen=True, repr=False, eq=False)
class Axle(_Tables):
    """One axle over time: arrays of shape (n,), NaN where a value is not known.

    `to_arrow` gives one table, ``series``: a column each, and ``estimate_NAME`` [N] and
    ``sigma_NAME`` [N] of each estimator.

    Attributes:
        number: of the axle, from 1.
        time_ns: time stamps [ns], since 1970 where the log has a calendar.
        t_s: seconds after the start of the log [s].
        clamping_force: K of all pads of the axle, of the last pressure before each stamp [N].
        wheel_speed: ω [rad/s].
        force: adhesion force, the offline reference [N].
        sigma: standard uncertainty of the force by noise [N].
        lower: lower edge of the 95 % band of the force [N].
        upper: upper edge [N].
        coefficient: adhesion coefficient µ = force / (m g) [-].
        estimates: force by each online estimator [N], by its name.
        sigmas: its own standard uncertainty [N], of the estimators that have one.
        pressure: in the brake cylinder [Pa]; None without one.
        train_speed: [m/s]; None without one.
        slip: [-]; None without a train speed, as the next three.
        slope: dµ/ds [-].
        slope_confidence: from 0 to 1 [-].
        region: index into `regions`.
        truth: true force of a simulation [N]; None without one.
        method: of the reference.
        applications: its brake applications.
        estimators: scores of the online estimators, best first.
    """

    number: int
    method: str
    applications: tuple[BrakeApplication, ...]
    estimators: tuple[Score, ...]
    time_ns: Annotated[model.Times, Quantity("ns", "")]
    t_s: Annotated[Floats, Quantity("s", "")]
    clamping_force: _N
    wheel_speed: Annotated[Floats, Quantity("rad/s", "")]
    force: _N
    sigma: _N
    lower: _N
    upper: _N
    coefficient: Annotated[Floats, Quantity("-", "")]
    estimates: Mapping[str, Floats]
    sigmas: Mapping[str, Floats]
    pressure: Annotated[Floats | None, Quantity("Pa", "")] = None
    train_speed: Annotated[Floats | None, Quantity("m/s", "")] = None
    slip: Annotated[Floats | None, Quantity("-", "")] = None
    slope: Annotated[Floats | None, Quantity("-", "")] = None
    slope_confidence: Annotated[Floats | None, Quantity("-", "")] = None
    region: Annotated[Any, Quantity("-", "")] = None
    truth: Annotated[Floats | None, Quantity("N", "")] = None

    regions: ClassVar[tuple[str, ...]] = tuple(REGIONS)
    _tables = ("series",)

    def _table(self, name: str) -> Any:
        columns = {n: (getattr(self, n), q.unit) for n, q in model.quantities(Axle).items()}
        columns |= {f"estimate_{n}": (x, "N") for n, x in self.estimates.items()}
        columns |= {f"sigma_{n}": (x, "N") for n, x in self.sigmas.items()}
        return tables.columns_table(
            {n: column for n, column in columns.items() if column[0] is not None}
        )

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        rows = [{"axle": str(self.number)} | result_rows.score_row(s) for s in self.estimators]
        title = f"axle {self.number}: {len(self.t_s)} samples, reference {self.method}"
        return title, {"Estimators": rows}


def _axle(axle: model.AxleResult, result: Result, braked: tuple[BrakeApplication, ...]) -> Axle:
    record, reference = axle.record, axle.reference
    origins: tuple[tuple[object, str], ...] = (
        (record, "clamping_force wheel_speed pressure train_speed truth"),
        (reference, "method force sigma lower upper"),
        (axle, "estimates sigmas slip slope slope_confidence region"),
    )
    return Axle(
        number=record.axle,
        applications=braked,
        estimators=axle.scores,
        time_ns=record.t,
        t_s=(record.t - result.log.start_ns()).astype(np.float64) * 1e-9,
        coefficient=physics.coefficient(reference.force, result.vehicle, record.axle),
        **{name: getattr(x, name) for x, names in origins for name in names.split()},
    )


@dataclass(frozen=True, repr=False, eq=False)
class Analysis(_Tables):
    """A log, with tables of ``applications``, ``stops``, ``estimators`` and ``findings``."""

    result: Result  # all that was computed, as the rest of the program has it
    _tables = ("applications", "stops", "estimators", "findings")

    @property
    def log(self) -> Log:
        """The log as read: its path, format and channels in SI."""
        return self.result.log

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        return [("", self.result.findings)]

    @property
    def settings(self) -> Table:
        """Every parameter that was used, as tables of a settings file."""
        return self.result.settings

    @cached_property
    def axles(self) -> Mapping[int, Axle]:
        """Every axle with its time series, by its number."""
        by_number = {a.record.axle: a for a in self.result.axles}
        return _Axles((n, _axle(a, self.result, self._braked[n])) for n, a in by_number.items())

    @property
    def applications(self) -> tuple[BrakeApplication, ...]:
        """Every brake application of every axle, with force, adhesion coefficient and slides."""
        return tuple(application for of_axle in self._braked.values() for application in of_axle)

    @property
    def stops(self) -> tuple[StopSummary, ...]:
        """The stops of the whole train: distance, deceleration, response time."""
        return self._summary.stops

    @property
    def estimators(self) -> tuple[Score, ...]:
        """How well each online estimator follows, over all axles; best first."""
        return pool_scores(a.scores for a in self.result.axles)

    @property
    def document(self) -> Json:
        """What `adhesion analyze --json` prints."""
        return document.result_document([self._summary])

    @cached_property
    def _braked(self) -> dict[int, tuple[BrakeApplication, ...]]:
        return brake_applications(self.result)

    @cached_property
    def _summary(self) -> ResultSummary:
        return summarise(self.result, {}, self._braked)

    def _table(self, name: str) -> Any:
        return tables.of_results(name, [self._summary])

    @in_python
    def plot(self, axles: int | Iterable[int] = ()) -> "Plot":
        """Figures that a notebook shows, with linked time; drawn by Bokeh.

        Args:
            axles: of each of these, its speeds, pressure, force with its 95 % band, errors of
                estimators and µ over slip. If empty: speed and adhesion coefficient of all axles.

        Returns:
            The figures: a notebook shows them, ``write(FILE)`` makes a page of them, ``html()``
            gives its text, and ``layout`` is for Bokeh.
        """
        from ..results import mcap
        from ..results.report import run
        from ..results.report.plots import Plot  # Bokeh is slow to import

        wanted = axles_of(axles)
        for axle in wanted:
            if axle not in self._braked:
                raise unknown("axle", str(axle), [str(n) for n in self._braked])
        with TemporaryDirectory(prefix="adhesion-") as folder:  # a report is that of a result file
            record = Path(folder, "plot.mcap")
            mcap.write_results(record, [self.result], document.embedded([self._summary]))
            return Plot(run.read(record, axles=[*self._braked]), wanted)

    @in_python
    def write(
        self, folder: File = ".", *, report: bool = False, force: bool = False
    ) -> tuple[Path, ...]:
        """Writes ``<log>.adhesion.mcap`` and ``.rrd``, as `adhesion analyze` does; returns them.

        Args:
            folder: made if it is missing.
            report: whether to write ``<log>.adhesion.html`` as well, a page to forward.
            force: whether existing results are replaced, which else are a `UserError`.
        """
        return _write(Path(folder), "adhesion", [self], [self.result], force, report=report)

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        pairs = [(str(a.axle), x) for a in self._summary.axles for x in a.applications]
        whole_stops = [stop_rows.short_row(x) for x in self.stops if x.valid]
        return self.log.path, {
            "Stops of the train (± is 95 %)": non_empty(whole_stops),
            "Brake applications (± is 95 %)": [result_rows.row(*pair) for pair in pairs],
            "Slides": [result_rows.slid_row(*pair) for pair in pairs if pair[1].slides],
        }


@dataclass(frozen=True, repr=False, eq=False)
class Comparison(_Tables):
    """Estimators over logs, with tables of ``estimators``, ``applications`` and ``findings``."""

    analyses: tuple[Analysis, ...]
    _tables = ("estimators", "applications", "findings")

    @property
    def estimators(self) -> tuple[Score, ...]:
        """Scores over all axles of all logs, best first."""
        return pool_scores(a.scores for x in self.analyses for a in x.result.axles)

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        is_single = len(self.analyses) == 1
        return [("" if is_single else f"{x.log.path}: ", x.findings) for x in self.analyses]

    @property
    def document(self) -> Json:
        """What `adhesion compare --json` prints."""
        return document.result_document([analysis._summary for analysis in self.analyses])

    def _table(self, name: str) -> Any:
        return tables.of_results(name, [analysis._summary for analysis in self.analyses])

    @in_python
    def write(self, folder: File = ".", *, force: bool = False) -> tuple[Path, ...]:
        """Writes ``<first log>.compare.mcap`` and ``.rrd``; see `Analysis.write`."""
        results = [analysis.result for analysis in self.analyses]
        return _write(Path(folder), "compare", self.analyses, results, force)

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        by_target: dict[str, list[dict[str, str]]] = {}
        for s in self.estimators:
            rows = by_target.setdefault(f"Against {s.against}", [])
            rows.append({"axle": "all"} | result_rows.score_row(s))
        return ", ".join(analysis.log.path for analysis in self.analyses), dict(by_target)


@dataclass(frozen=True, repr=False, eq=False)
class SlipAnalysis(_Tables):
    """Slip, slides and the adhesion curve of one log, with tables of ``slides`` and ``axles``."""

    analysis: Analysis
    _slip: SlipOfLog
    _tables = ("slides", "axles")

    @property
    def axles(self) -> Mapping[int, Summary]:
        """By its number, what the log shows of the rail under each axle."""
        return _Axles((s.axle, s) for s in self._slip.axles)

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        return [("", self._slip.findings)]

    @cached_property
    def document(self) -> Json:
        """What `adhesion slip --json` prints."""
        return slip_document([self._slip], [{}])

    def _table(self, name: str) -> Any:
        axles = summarise_slip(self._slip)
        if name == "axles":
            return tables.table(axles, tables.RAILS)
        slides = (({"log": a.log, "axle": a.axle}, x) for a in axles for x in a.slides)
        return tables.keyed(slides, tables.SLIDES)

    @in_python
    def write(self, folder: File = ".", *, force: bool = False) -> tuple[Path, ...]:
        """Writes ``<log>.slip.mcap`` and ``.rrd``; see `Analysis.write`."""
        slip = carried(self._slip)
        return _write(Path(folder), "slip", [self.analysis], [self._slip.result], force, slip)

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        axles, log = self._slip.axles, self.analysis.log
        rails = [{"axle": str(s.axle)} | slip_text.rail_row(s.rail) for s in axles if s.rail]
        slides = slip_text.slide_rows(axles, log.start_ns(), self._slip.route)
        return log.path, {"Rail": rails, "Slides": slides}


@dataclass(frozen=True, repr=False, eq=False)
class Inspection(_Tables):
    """What is in a log, with tables of ``channels`` and ``findings``."""

    _inspected: inspection.LogInspection
    _tables = ("channels", "findings")

    @property
    def log(self) -> Log:
        """The log with every numeric channel; SI where the unit is known."""
        assert self._inspected.log is not None  # else `inspect` raised
        return self._inspected.log

    @property
    def channels(self) -> tuple[model.Channel, ...]:
        """Every channel with its meaning, its unit and the reason, and its samples."""
        return self.log.channels

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        return [("", self._inspected.findings)]

    @property
    def document(self) -> Json:
        """What `adhesion inspect --json` prints."""
        return document.tagged("inspect", logs=[as_json(self._inspected.summary)])

    def _table(self, name: str) -> Any:
        if name == "channels":
            return tables.table(self._inspected.summary.channels, tables.CHANNELS)
        keys = tables.keys_of_log(self.log)
        return tables.keyed(((keys, f) for f in self._inspected.summary.findings), tables.FINDINGS)

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        rows = [
            result_rows.channel_row(c)
            | {"Hz": number(c.rate_hz, 2), "rows": str(c.rows), "why": c.reason}
            for c in self._inspected.summary.channels
        ]
        return self.log.path, {"Channels": rows}


@dataclass(frozen=True, repr=False, eq=False)
class StopAnalysis(_Tables):
    """The stops of one or several logs as a brake test, with the table ``stops``."""

    _test: brake_test.BrakeTest
    _tables = ("stops",)

    @property
    def series(self) -> StopSeries:
        """The `stops` with log and group, `groups`, `differences`, `limits` and `wsp` figures."""
        return self._test.series

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        return [("", [finding for _, finding in self._test.findings_by_log])]

    @property
    def document(self) -> Json:
        """What `adhesion stops --json` prints."""
        return brake_test.document(self._test)

    def _table(self, name: str) -> Any:
        return tables.sheets_of_series(self.series)["stops"]

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        shown = stop_rows.series_tables(self.series, braked_weight=False, budget=False)
        return "\n".join(self._test.vehicle_lines), {x.title: x.rows for x in shown}


@dataclass(frozen=True, repr=False, eq=False)
class Calibration(_Tables):
    """A vehicle from its own logs, with the table ``parameters``."""

    _calibration: calibrate.CalibrationRun
    _tables = ("parameters",)

    @property
    def parameters(self) -> Mapping[str, CalibratedParameter]:
        """By name: `prior`, `prior_u`, `posterior`, `posterior_u` (1 sigma) and `unit`."""
        return self._calibration.result.rows

    @property
    def vehicle(self) -> model.Vehicle:
        """The calibrated vehicle."""
        return self._calibration.settings.vehicle

    @property
    def settings(self) -> Table:
        """Tables that `analyze(log, settings=...)` takes."""
        return calibrate.as_tables(self._calibration)

    def _grouped_findings(self) -> Sequence[tuple[str, Sequence[Finding]]]:
        return [("", self._calibration.findings)]

    @property
    def document(self) -> Json:
        """What `adhesion calibrate --json` prints."""
        return calibrate.document(self._calibration, {})

    def _table(self, name: str) -> Any:
        return tables.keyed(
            (({"parameter": key}, x) for key, x in self.parameters.items()), tables.PARAMETERS
        )

    @in_python
    def write(self, file: File, *, force: bool = False) -> Path:
        """Writes the ``.toml`` that ``settings=`` and ``-c`` take; see `Analysis.write`."""
        path = toml.target(Path(file))
        read = [Path(u.log.path) for u in self._calibration.logs]
        with atomic_files.outputs([path], force, inputs=read) as (place,):
            place.write_text(calibrate.as_toml(self._calibration), encoding="utf-8")
        return path

    def _display(self) -> tuple[str, dict[str, _Rows]]:
        title = f"Calibration by {self._calibration.applications} brake applications"
        return title, {"± is 1 sigma": calibrate.as_rows(self._calibration)}


def _write(  # noqa: PLR0913 (the options of the command)
    folder: Path,
    kind: str,
    analyses: Sequence[Analysis],
    results: Sequence[Result],
    force: bool,
    slip: tuple[str, Sequence[Any]] = ("", ()),
    report: bool = False,
) -> tuple[Path, ...]:
    """Writes record and recording of results, and the page of one; they appear together."""
    inputs = [Path(analysis.log.path) for analysis in analyses]
    files: tuple[Path, ...] = outputs.pair(folder, inputs[0], kind)
    if report:
        files = (*files, files[0].with_suffix(".html"))
    with (
        atomic_files.folder(folder),
        atomic_files.outputs(files, force, inputs=inputs) as places,
    ):
        outputs.write_results(places[:2], results, [x._summary for x in analyses], *slip)
        for place in places[2:]:
            outputs.write_report(place, places[0], files[0].name)
    return files
