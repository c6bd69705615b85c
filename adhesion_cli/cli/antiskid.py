"""`adhesion antiskid`: stops in closed loop, every controller on the same rail."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Shared, shared

if TYPE_CHECKING:
    from ..antiskid import Row
    from ..scenario import Limit
    from ..stop import Verdict


@shared("out", "json", "force", "view")
def command(
    shared: Shared,
    scenario: Annotated[
        str, typer.Argument(metavar="SCENARIO", help="Bundled scenario, or a scenario TOML.")
    ],
    algo: Annotated[
        str, typer.Option("-a", "--algo", metavar="NAME", help="Estimator in the loop.")
    ] = "kalman",
    set_: Annotated[
        list[str],
        typer.Option(
            "--set",
            metavar="NAME=VALUE",
            help="One setting, as patent.slip_high=0.05, rule.pulse=0.1, slope.rho=2; repeatable.",
        ),
    ] = [],  # noqa: B006
    seed: Annotated[
        int | None, typer.Option("--seed", min=0, help="Seed of the noise, for the scenario's.")
    ] = None,
    rails: Annotated[
        bool, typer.Option("--rails", help="A set of rails instead of the scenario's; no files.")
    ] = False,
    seeds: Annotated[
        int, typer.Option("--seeds", metavar="N", min=1, help="Stops on each rail of --rails.")
    ] = 10,
) -> int:
    """Stop a train under the patent's law, a rule-based WSP and none, on the same rail.

    Writes <scenario>.antiskid.mcap and .rrd.

    Example: adhesion antiskid slippery-stop
    """
    from .. import antiskid
    from ..controller import registry as controllers
    from ..document import dumps
    from ..physics import G
    from ..scenario import load
    from . import show

    case, settings, tell = load(scenario), _settings(set_), show.progress(shared.quiet)
    if rails:
        rows = antiskid.sweep(case, seeds, algo, settings, tell)
        print(
            dumps(antiskid.sweep_document(case, seeds, algo, rows)) if shared.json else _rails(rows)
        )
        return 0

    from ..write import files, mcap, rrd

    paths = [(shared.out or Path()) / f"{case.name}.antiskid.{kind}" for kind in ("mcap", "rrd")]
    files.check(paths, shared.force, inputs=[Path(scenario)])
    tell("dry rail")
    dry = antiskid.dry_distance(case)
    stops = []
    for controller in controllers():
        tell(controller)
        stop = antiskid.run(case, controller, seed, algo, settings)
        stops.append((stop, antiskid.verdict(stop, case, dry)))
    document = dumps(antiskid.document(case, dry, stops))
    table = _verdict({s.controller: v for s, v in stops})
    kept = [line for s, v in stops for line in _limits(s.controller, case.limit, v)]
    text = "\n".join([f"{case.name}: {dry:.1f} m on dry rail, estimator {algo}", table, *kept])
    with files.outputs(paths, shared.force, inputs=[Path(scenario)]) as (record, recording):
        mcap.write_log(record, antiskid.as_log(case, [s for s, _ in stops]), document)
        band = antiskid.bands(settings)[:2]
        weight = case.vehicle.axle_mass.value * G
        rrd.write_stops(recording, case.name, [s for s, _ in stops], weight, band, text)
    print(document if shared.json else "\n".join([text, show.wrote(*paths)]))
    if shared.view:
        from .view import show_recording

        show_recording(paths[1])
    return 0


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


def _verdict(verdicts: dict[str, "Verdict"]) -> str:
    from .show import number, table

    rows = [
        [name, *(number(x, d) for x, d in zip(v, _DIGITS, strict=True))]
        for name, v in verdicts.items()
    ]
    return table(["controller", *_HEADER], rows)


def _limits(controller: str, limits: "Sequence[Limit]", v: "Verdict") -> list[str]:
    from ..antiskid import against

    return [
        f"{controller}: {limit.quantity} {'within' if kept else 'OUTSIDE'} "
        f"{limit.least:g} to {limit.most:g} ({limit.source})"
        for limit, kept in against(limits, v)
    ]


def _rails(rows: "Sequence[Row]") -> str:
    from .show import number, table

    def cell(value: tuple[float, float, float] | None, digits: int) -> str:
        if value is None:
            return "-"
        mean, low, high = (number(x, digits) for x in value)
        return mean if low == high else f"{mean} ({low}–{high})"

    body = [
        [
            r.rail, r.controller,
            *(cell(r.values[k], d) for k, d in zip(r.values, _DIGITS, strict=True)),
            f"{r.shorter:.0%}",
        ]
        for r in rows
    ]  # fmt: skip
    return table(["rail", "controller", *_HEADER, "shortest"], body, left=2)
