"""`adhesion estimators`: the registry, and how its members answer."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from .options import Shared, loader, shared

if TYPE_CHECKING:
    from ..analysis.settings import Settings
    from ..core.estimator import Estimator


@shared("config", "set_", "out", "algo", "axle", "json", "force")
def command(
    shared: Shared,
    response: Annotated[
        bool, typer.Option("--response", help="Measure gain, delay, noise over frequency.")
    ] = False,
) -> int:
    """Show every online estimator: method, source, parameters as set, with unit, range, default.

    With --response: how each answers to sines, at the settings stated; writes response.svg.
    Only then --out, --axle and --force mean something.

    Example: adhesion estimators --response --set neso.beta1=100
    """
    from ..analysis.analyze import chosen
    from ..analysis.document import dumps, tagged
    from ..core.errors import UserError

    known, settings = chosen(shared.algo), loader(shared)()
    if response:
        return _response(known, settings, shared)
    if shared.out or shared.axle or shared.force:
        text = "--out, --axle and --force say nothing without --response"
        raise UserError(text, "add --response, or leave them out", code=2)
    if shared.json:
        listed = [_entry(e, settings.params(e)._asdict()) for e in known]
        print(dumps(tagged("estimators", estimators=listed)))
    else:
        print("\n\n".join(_text(e, settings.params(e)._asdict()) for e in known))
    return 0


def _entry(e: "Estimator", values: dict[str, float]) -> dict[str, object]:
    from ..analysis.document import finite
    from ..core.methods import parameters

    return {
        "algo": e.name,
        "title": e.title,
        "source": e.source,
        "claims": {k: c._asdict() for k, c in e.claims.items()},
        "parameters": [
            {
                "name": name, "unit": q.unit, "text": q.text,
                "value": values[name], "default": default,
                "low": finite(q.low), "high": finite(q.high),
            }
            for name, q, default in parameters(e)
        ],
    }  # fmt: skip


def _text(e: "Estimator", values: dict[str, float]) -> str:
    from ..core.methods import parameters
    from .terminal import folded

    lines = [folded(f"{e.name}: {e.title}", "  "), folded(f"  {e.source}", "  ")]
    for name, q, default in parameters(e):
        unit = "" if q.unit == "-" else f" {q.unit}"
        value = f"{e.name}.{name} = {values[name]:g}{unit}"
        lines.append(folded(f"  {value}  ({q.range}; default {default:g}) {q.text}", "    "))
    return "\n".join(lines)


def _response(known: "list[Estimator]", settings: "Settings", shared: Shared) -> int:
    from ..analysis.document import dumps, finite, tagged
    from ..core.physics import wheelset
    from ..evaluation.response import FREQUENCIES, panels, responses
    from ..results import atomic_files, svg
    from . import terminal

    picture = (shared.out or Path()) / "response.svg"
    atomic_files.check([picture], shared.force)
    w = wheelset(settings.vehicle, min(shared.axle, default=1))
    found = [r for e in known for r in responses(e, settings.params(e), w)]
    with atomic_files.outputs([picture], shared.force) as (temporary,):
        svg.write(temporary, "Frequency response of the estimators", panels(found), columns=3)
    columns = {
        "gain": [r.gain for r in found],
        "delay_s": [r.delay_s for r in found],
        "noise_gain": [r.noise_gain for r in found],
    }
    if shared.json:
        listed = [
            {
                "algo": r.algo, "amplitude_n": r.amplitude_n,
                "frequency_hz": r.frequency_hz.tolist(),
                **{name: [finite(x) for x in v[i].tolist()] for name, v in columns.items()},
            }
            for i, r in enumerate(found)
        ]  # fmt: skip
        print(dumps(tagged("response", responses=listed, outputs={"svg": str(picture)})))
        return 0
    titles = ("gain of the force", "delay of the force [s]", "force per wheel speed [N/(rad/s)]")
    for title, values, digits in zip(titles, columns.values(), (3, 3, 0), strict=True):
        header = [title, "amplitude", *(f"{f:g} Hz" for f in FREQUENCIES)]
        rows = [
            [
                r.algo,
                "any" if r.amplitude_n is None else f"{r.amplitude_n:.0f} N",
                *(terminal.number(x, digits) for x in values[i].tolist()),
            ]
            for i, r in enumerate(found)
        ]
        print(terminal.table(header, rows), end="\n\n")
    print(terminal.wrote(picture))
    return 0
