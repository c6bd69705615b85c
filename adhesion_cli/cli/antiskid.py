"""`adhesion antiskid`: stops in closed loop, every controller on the same rail."""

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from ..core.errors import UserError
from ..core.text import printable
from . import options, results
from .options import Shared, option, shared

if TYPE_CHECKING:
    from ..core.annotated import Json
    from ..core.finding import Finding
    from ..wsp.plant import RailConditions
    from ..wsp.replay import Compared
    from ..wsp.scenario import Scenario
    from ..wsp.stop import Stop
    from ..wsp.wsp_controller import Settings as Stated

TrainSpeed = Literal["measured", "axles"]
_OF_LOGS = {
    "--" + name.strip("_"): name for name in ("axle", "from_", "to", "strict", "reference", "dbc")
}


@shared(*_OF_LOGS.values(), "force", "out", "view", "config", "set_", "json")
def command(
    shared: Shared,
    scenario: Annotated[str | None, options.ScenarioName] = None,
    from_log: Annotated[
        Path | None,
        option("--from-log", "LOG", "Instead of a scenario, the stop and rail of a log."),
    ] = None,
    algo: Annotated[
        str,
        option(
            "-a --algo",
            "NAME",
            "Estimator in the loop; else kalman.",
            **options.completes(options.estimators),
        ),
    ] = "kalman",
    seed: options.Seed = None,
    train_speed: Annotated[
        TrainSpeed | None,
        option("--train-speed", None, "Source of train speed, instead of the scenario's."),
    ] = None,
) -> int:
    """Stop a train with different WSPs on the same rail.

    The WSPs are the patent's law, a rule-based WSP and none.

    --from-log fits the rail to the slides of a log. Each controller then stops the log's train on
    that rail; intervals are those of the fit. Writes <name>.<controller>.antiskid.mcap, each a log,
    and <name>.antiskid.rrd.

    Settings: [patent], [rule], [slope] and the estimator; with --from-log also those of logs.

    Example: adhesion antiskid slippery-stop --set patent.slip_high=0.05
    """
    from ..core import compiled
    from ..wsp.scenario import load
    from . import terminal

    if (scenario is None) == (from_log is None):
        raise UserError("one of SCENARIO and --from-log", "adhesion antiskid slippery-stop", code=2)
    settings: Stated = options.load_settings(shared).overrides
    if scenario:
        stated = {flag: getattr(shared, name) for flag, name in _OF_LOGS.items()}
        idle = [flag for flag, x in stated.items() if x not in (None, []) and x is not False]
        if idle := [*idle, *_idle_settings(shared, settings)]:
            hint = "leave it out; `adhesion antiskid --help` shows the options"
            raise UserError(f"{', '.join(idle)}: no effect with SCENARIO", hint, code=2)
    compiled.report = functools.cache(lambda text: terminal.message(text, shared.quiet))
    if from_log:
        return _replay(from_log, shared, algo, seed or 0, train_speed)
    assert scenario is not None
    case = load(scenario).with_train_speed(train_speed)
    return _on_own_rail(shared, Path(scenario), case, seed, algo, settings)


def _idle_settings(shared: Shared, settings: "Stated") -> list[str]:
    """The flags whose settings only a log uses; a message if a file states a vehicle."""
    from ..analysis.settings import stated_sections
    from ..core.model import Vehicle
    from . import terminal

    flags = [f"--set {x}" for x in sorted(stated_sections(shared.set_) - set(settings))]
    if not flags and options.load_settings(shared).vehicle != Vehicle():
        text = "note: [vehicle] has no effect here: the TOML of a scenario states its vehicle"
        terminal.message(text, shared.quiet)
    return flags


def _on_own_rail(
    shared: Shared, source: Path, case: "Scenario", seed: int | None, algo: str, settings: "Stated"
) -> int:
    """The stops of every controller on the scenario's rail."""
    from ..wsp import closed_loop, documents, wsp_controller
    from ..wsp.controller import registry
    from . import terminal

    paths, progress = _paths(shared, case.name), terminal.progress(shared.quiet)
    options.check(shared, paths, source)
    used_parameters = wsp_controller.parameters(registry(), algo, settings)
    dry, stops = closed_loop.compare_laws(case, seed, algo, settings, progress)
    verdicts = {law: v._asdict() for law, (_, v) in stops.items()}
    stopped = [stop for stop, _ in stops.values()]
    document = documents.antiskid_document(stopped[0], case.name, used_parameters, dry, verdicts)
    head = f"{case.name}: {dry:.1f} m on dry rail, estimator {algo}"
    text = f"{head}\n{_verdicts(verdicts)}\n{_MEANING}"
    return _write(paths, shared, source, _Outcome(case, settings, stopped, document, text))


def _replay(log: Path, shared: Shared, algo: str, seed: int, train_speed: TrainSpeed | None) -> int:
    from ..wsp.controller import registry
    from ..wsp.documents import replay_document
    from ..wsp.replay import answers, case, distance_findings
    from ..wsp.wsp_controller import parameters
    from . import terminal

    paths, progress = _paths(shared, results.stem(log)), terminal.progress(shared.quiet)
    (result,) = results.analysed(replace(shared, algo=[algo]), [log], paths, train_speed=True)
    progress(f"{log.name}: rail under each axle")
    replayed = case(result, train_speed)
    settings, name = options.load_settings(shared).overrides, printable(log.name)
    count = len(registry()) * (1 + len(replayed.draws))
    terminal.message(f"{name}: rail fitted; {count} stops to simulate", shared.quiet)
    dry, laws = answers(replayed, algo, settings, seed, progress)
    findings = [*result.findings, *replayed.findings, *distance_findings(replayed, laws)]
    used_parameters = parameters(registry(), algo, settings)
    document = replay_document(str(log), replayed, used_parameters, dry, laws, findings)
    on_dry = f"{dry:.1f} m on dry rail" if dry else "on dry rail not known"
    logged = replayed.logged_m
    since = f" from {replayed.start_s:.1f} s, the first brake force, on"
    in_log = f"{logged:.1f} m in the log{since}" if logged else "not stopped in the log"
    caption = f"median and, in brackets, 95 % of {len(replayed.draws)} draws of the fitted rail"
    compared = {law: x.compared for law, x in laws.items()}
    verdict = _verdicts({law: x.values for law, x in laws.items()}, compared)
    text = f"{printable(str(log))}: {on_dry}, {in_log}, estimator {algo}; {caption}"
    head = terminal.folded(text)
    origin = {"log": name, "log_sha256": result.log.sha256}
    stops, said = [laws[law].stop for law in registry()], f"{head}\n{verdict}\n{_MEANING}"
    on_rail = findings, replayed.track, origin
    outcome = _Outcome(replayed.scenario, settings, stops, document, said, *on_rail)
    return _write(paths, shared, log, outcome)


def _paths(shared: Shared, name: str) -> list[Path]:
    """The files of every controller's stop, and the recording of all."""
    from ..wsp.controller import registry

    names = [f"{name}.antiskid.rrd", *(f"{name}.{law}.antiskid.mcap" for law in registry())]
    return [(shared.out or Path()) / n for n in names]


@dataclass(frozen=True, slots=True)
class _Outcome:
    case: "Scenario"
    settings: "Stated"
    stops: "Sequence[Stop]"
    document: "Json"
    text: str
    findings: "Sequence[Finding]" = ()
    track: "RailConditions | None" = None  # the rail that was fitted to a log
    origin: Mapping[str, str] = field(default_factory=dict)  # of the log


def _write(paths: Sequence[Path], shared: Shared, source: Path, outcome: _Outcome) -> int:
    from ..analysis.settings import AnalysisSettings, Settings, tree
    from ..core import estimator, physics
    from ..core.document import dumps
    from ..results import atomic_files, mcap, rrd
    from ..wsp import controller
    from ..wsp.documents import stop_settings
    from ..wsp.wsp_controller import bands
    from . import terminal

    methods, laws = estimator.registry(), controller.registry()
    case, stops, metrics = outcome.case, outcome.stops, dumps(outcome.document)
    weight = case.vehicle.axle_mass.value * physics.G
    exact = AnalysisSettings(vehicle="stated")  # a simulation knows its vehicle
    curve_bands = {"patent": bands(outcome.settings)}
    stated = tree(Settings(case.vehicle, analysis=exact, bands=bands(outcome.settings)), [])
    read = options.inputs(shared, source)
    with atomic_files.outputs(paths, shared.force, inputs=read) as (recording, *places):
        origin: Json = {}
        for record, stop in zip(places, stops, strict=True):
            sources = methods[stop.algo].source, laws[stop.controller].source
            carried = stop_settings(
                stop, case, outcome.settings, stated, outcome.track, **outcome.origin
            )
            origin |= carried
            mcap.write_stop(record, case.name, stop, case.vehicle, carried, metrics, sources)
        findings = terminal.findings(outcome.findings, terminal.NARROW)
        verdict = "\n".join([outcome.text, _EPILOG, findings]).rstrip()
        origin["antiskid"] = {k: v for k, v in origin["antiskid"].items() if k != "controller"}
        page = rrd.StopsPage(stops, weight, curve_bands, verdict, origin)
        rrd.write_stops(recording, case.name, page)
    kinds = ["rrd", *(f"{stop.controller}.mcap" for stop in stops)]
    document = {**outcome.document, "outputs": dict(zip(kinds, map(str, paths), strict=True))}
    print(dumps(document) if shared.json else f"{outcome.text}\n{terminal.wrote(*paths)}")
    terminal.show([] if shared.json else outcome.findings, shared.quiet)
    return results.finished(shared, paths[0], outcome.findings)


_ROWS = {  # decimals of the fields of a `Verdict`, in their order
    "distance [m]": 1,
    "over dry": 3,
    "utilisation": 3,
    "max slip": 3,
    "locked [s]": 2,
    "air [Nl]": 0,
    "slip error": 3,
    "slides [s]": 1,
    "limited [s]": 1,
}
_MEANING = """\
Seconds are summed over the axles.
limited: the brake demands more force than the rail can transmit.
slip error: mean difference of slip and the slip of the rail's peak, if limited."""

_EPILOG = """\
over dry: distance over that on dry rail without WSP, minus 1.
utilisation: share of the force that the rail can transmit, if limited.
air: consumption of all brake cylinders, in litres of normal air."""


_Value = float | tuple[float, float, float] | None  # alone or with its interval


def _verdicts(
    verdicts: "Mapping[str, Mapping[str, _Value]]", paired: "Mapping[str, Compared] | None" = None
) -> str:
    """A column per controller, a row per value."""
    from .terminal import NARROW, number, table

    def cell(value: _Value, digits: int) -> str:
        if not isinstance(value, tuple):
            return number(value, digits)
        middle, lower, upper = (number(x, digits) for x in value)
        return middle if lower == upper == middle else f"{middle} ({lower}–{upper})"

    rows = [
        [name, *(cell(list(values.values())[i], digits) for values in verdicts.values())]
        for i, (name, digits) in enumerate(_ROWS.items())
    ]
    if paired:
        compared = [paired[law] for law in verdicts]
        rows.append(["patent less [m]", *(cell(b.patent_less_this_m, 1) for b in compared)])
        rows.append(["shortest", *(f"{b.shortest:.0%}" for b in compared)])
    return table(["", *verdicts], rows, width=NARROW)
