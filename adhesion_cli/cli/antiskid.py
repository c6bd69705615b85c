"""`adhesion antiskid`: stops in closed loop, every controller on the same rail."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from .options import Shared, shared

if TYPE_CHECKING:
    from ..scenario import Limit, Scenario
    from ..stop import Stop, Verdict
    from ..sweep import Row

TrainSpeed = Literal["measured", "axles"]
_OF_LOGS = ("config", "axle", "from_", "to", "strict", "reference")


@shared(*_OF_LOGS, "out", "json", "force", "view")
def command(
    shared: Shared,
    scenario: Annotated[
        str | None,
        typer.Argument(metavar="[SCENARIO]", help="Bundled scenario, or a scenario TOML."),
    ] = None,
    from_log: Annotated[
        Path | None,
        typer.Option(
            "--from-log", metavar="LOG", help="Instead of a scenario, the stop and rail of a log."
        ),
    ] = None,
    algo: Annotated[
        str, typer.Option("-a", "--algo", metavar="NAME", help="Estimator in the loop.")
    ] = "kalman",
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="One setting, as patent.slip_high=0.05, rule.pulse=0.1; with --from-log also the "
            "log's, as vehicle.phi=0.28; repeatable.",
        ),
    ] = [],  # noqa: B006
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Seed of the noise, for the scenario's.")
    ] = None,
    train_speed: Annotated[
        TrainSpeed | None,
        typer.Option("--train-speed", help="How the unit knows it, for what the scenario says."),
    ] = None,
    rails: Annotated[
        bool, typer.Option("--rails", help="A set of rails instead of the scenario's; no files.")
    ] = False,
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", min=1, help="Stops on each rail of --rails.")
    ] = 10,
) -> int:
    """Stop a train under the patent's law, a rule-based WSP and none, on the same rail.

    With --from-log the rail is fitted to a log's slides, and each controller stops the log's train
    on it; intervals are those of the fit. Writes <name>.<controller>.antiskid.mcap, each a log, and
    <name>.antiskid.rrd.

    Example: adhesion antiskid slippery-stop
    """
    from .. import antiskid
    from ..controller import registry
    from ..document import dumps
    from ..errors import UserError
    from ..scenario import load
    from . import show

    if (scenario is None) == (from_log is None):
        raise UserError("one of SCENARIO and --from-log", "adhesion antiskid slippery-stop", code=2)
    if from_log:
        if rails:
            raise UserError("--rails has rails of its own", "leave --from-log out", code=2)
        return _replay(from_log, replace(shared, set_=set_), algo, seed or 0, train_speed)
    assert scenario is not None
    if any(getattr(shared, name) for name in _OF_LOGS):
        text = "--config, --axle, --from, --to, --strict and --reference concern a log"
        raise UserError(text, "name one with --from-log", code=2)
    case, settings, tell = load(scenario), _settings(set_), show.progress(shared.quiet)
    case = _told(case, train_speed)
    if rails:
        from ..sweep import sweep, sweep_document

        rows = sweep(case, seeds, algo, settings, tell)
        print(dumps(sweep_document(case, seeds, algo, rows)) if shared.json else _rails(rows))
        return 0

    paths = _paths(shared, case.name, Path(scenario))
    tell("dry rail")
    dry = antiskid.dry_distance(case)
    stops = {}
    for law in registry():
        tell(law)
        stop = antiskid.run(case, law, seed, algo, settings)
        stops[law] = (stop, antiskid.verdict(stop, case, dry))
    document = dumps(antiskid.document(case, dry, list(stops.values())))
    table = _verdicts({law: v._asdict() for law, (_, v) in stops.items()})
    kept = [line for law, (_, v) in stops.items() for line in _limits(law, case.limit, v)]
    text = "\n".join([f"{case.name}: {dry:.1f} m on dry rail, estimator {algo}", table, *kept])
    _write(
        paths,
        shared,
        Path(scenario),
        case,
        [s for s, _ in stops.values()],
        settings,
        document,
        text,
    )
    _say(paths, shared, document, text)
    return 0


def _replay(log: Path, shared: Shared, algo: str, seed: int, train_speed: TrainSpeed | None) -> int:
    from ..analysis import analyze
    from ..document import dumps
    from ..replay import answers, case, document
    from ..text import printable
    from . import show
    from .analyze import outputs
    from .options import checked

    load = checked(replace(shared, algo=[algo]), [log])
    name = outputs(Path(), log, "antiskid")[0].name.removesuffix(".antiskid.mcap")
    paths, tell = _paths(shared, name, log), show.progress(shared.quiet)
    result = analyze(
        log, load, [algo], shared.axle, (shared.from_, shared.to), tell, train_speed=True
    )
    tell(f"{log.name}: rail under each axle")
    replayed = case(result)
    replayed = replayed._replace(
        scenario=_told(replayed.scenario, train_speed),
        draws=[(_told(s, train_speed), track) for s, track in replayed.draws],
    )
    settings = load().overrides
    dry, found = answers(replayed, algo, settings, seed, tell)
    findings = [*result.findings, *replayed.findings]
    text = dumps(document(str(log), replayed, dry, found, findings))
    logged = replayed.logged_m
    head = f"{printable(str(log))}: {dry:.1f} m on dry rail, " + (
        f"{logged:.1f} m in the log, " if logged else "not stopped in the log, "
    )
    head += f"estimator {algo}; in brackets 95 % of {len(replayed.draws)} draws of the fitted rail"
    verdict = "\n".join([head, _verdicts({law: a.values for law, a in found.items()})])
    stops = [a.stop for a in found.values()]
    _write(paths, shared, log, replayed.scenario, stops, settings, text, verdict)
    _say(paths, shared, text, verdict)
    if not shared.json:
        show.message(show.findings(findings), shared.quiet or not findings)
    return 3 if show.lossy(findings) else 0


def _told(case: "Scenario", train_speed: TrainSpeed | None) -> "Scenario":
    """The scenario with another source of the unit's train speed."""
    return (
        replace(case, antiskid=replace(case.antiskid, train_speed=train_speed))
        if train_speed
        else case
    )


def _paths(shared: Shared, name: str, source: Path) -> list[Path]:
    """The files of every controller's stop, and the recording of all; none may be there yet."""
    from ..controller import registry
    from ..write import files

    names = [f"{name}.antiskid.rrd", *(f"{name}.{law}.antiskid.mcap" for law in registry())]
    paths = [(shared.out or Path()) / n for n in names]
    files.check(paths, shared.force, inputs=[source])
    return paths


def _write(
    paths: Sequence[Path], shared: Shared, source: Path, case: "Scenario",
    stops: "Sequence[Stop]", settings: Mapping[str, Mapping[str, float]], document: str, text: str,
) -> None:  # fmt: skip
    from ..antiskid import bands
    from ..physics import G
    from ..settings import Settings, tree
    from ..write import files, mcap, rrd

    with files.outputs(paths, shared.force, inputs=[source]) as (recording, *records):
        carried = tree(Settings(case.vehicle), [])
        for record, stop in zip(records, stops, strict=True):
            mcap.write_stop(record, case.name, stop, case.vehicle, carried, document)
        weight = case.vehicle.axle_mass.value * G
        rrd.write_stops(recording, case.name, stops, weight, bands(settings)[:2], text)


def _say(paths: Sequence[Path], shared: Shared, document: str, text: str) -> None:
    from . import show

    print(document if shared.json else "\n".join([text, show.wrote(*paths)]))
    if shared.view:
        from .view import show_recording

        show_recording(paths[0])


def _settings(given: Sequence[str]) -> dict[str, dict[str, float]]:
    """The numbers of `--set`, by the name before the dot."""
    from ..errors import UserError

    settings: dict[str, dict[str, float]] = {}
    for text in given:
        name, _, value = text.partition("=")
        owner, _, key = name.partition(".")
        try:
            settings.setdefault(owner, {})[key] = float(value)
        except ValueError:
            raise UserError(
                f"--set {text}: not NAME=NUMBER", "for example --set patent.slip_high=0.05", code=2
            ) from None
    return settings


_HEADER = [
    "distance [m]", "over dry", "utilisation", "max slip", "locked [s]", "air [Nl]", "slip error",
    "slides [s]", "limited [s]",
]  # fmt: skip
_DIGITS = (1, 3, 3, 3, 2, 0, 3, 1, 1)


_Value = float | tuple[float, float, float] | None  # alone or with its interval


def _cell(value: _Value, digits: int) -> str:
    from .show import number

    if not isinstance(value, tuple):
        return number(value, digits)
    middle, low, high = (number(x, digits) for x in value)
    return middle if low == high == middle else f"{middle} ({low}–{high})"


def _cells(values: "Mapping[str, _Value]") -> list[str]:
    return [_cell(x, d) for x, d in zip(values.values(), _DIGITS, strict=True)]


def _verdicts(of: "Mapping[str, Mapping[str, _Value]]") -> str:
    from .show import table

    return table(["controller", *_HEADER], [[law, *_cells(v)] for law, v in of.items()])


def _limits(controller: str, limits: "Sequence[Limit]", v: "Verdict") -> list[str]:
    from ..antiskid import against

    return [
        f"{controller}: {limit.quantity} {'within' if kept else 'OUTSIDE'} "
        f"{limit.least:g} to {limit.most:g} ({limit.source})"
        for limit, kept in against(limits, v)
    ]


def _rails(rows: "Sequence[Row]") -> str:
    from .show import table

    body = [[r.rail, r.controller, *_cells(r.values), f"{r.shorter:.0%}"] for r in rows]
    return table(["rail", "controller", *_HEADER, "shortest"], body, left=2)
