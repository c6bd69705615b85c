"""`adhesion estimators`: the registry, and the frequency response of its members."""

from typing import TYPE_CHECKING, Annotated

from .options import Shared, load_settings, option, shared

if TYPE_CHECKING:
    from ..analysis.settings import Settings
    from ..core.estimator import Estimator


@shared("config", "set_", "algo", "json")
def command(
    shared: Shared,
    response: Annotated[
        bool, option("--response", None, "Measure gain, delay, noise over frequency.")
    ] = False,
) -> int:
    """Show every online estimator and its parameters.

    With method and source; each parameter as set, with unit, range and default.

    --response measures the response to sines with the settings stated.

    Example: adhesion estimators --response --set neso.beta1=100
    """
    from ..analysis.request import choose_estimators
    from ..core.document import dumps, tagged

    chosen, settings = choose_estimators(shared.algo), load_settings(shared)
    if response:
        return _response(chosen, settings, shared)
    if shared.json:
        listed = [_entry(e, settings.params(e)._asdict()) for e in chosen]
        print(dumps(tagged("estimators", estimators=listed)))
    else:
        print("\n\n".join(_text(e, settings.params(e)._asdict()) for e in chosen))
    return 0


def _entry(e: "Estimator", values: dict[str, float]) -> dict[str, object]:
    from ..core.document import finite
    from ..core.methods import parameters

    rows = []
    for name, q, default in parameters(e):
        row = {"name": name, "unit": q.unit, "text": q.text, "value": values[name]}
        limits = {"low": finite(q.minimum), "high": finite(q.maximum)}
        rows.append({**row, "default": default, **limits})
    claims = {k: c._asdict() for k, c in e.claims.items()}
    head = {"algo": e.name, "title": e.title, "source": e.source}
    return {**head, "claims": claims, "parameters": rows}


def _text(e: "Estimator", values: dict[str, float]) -> str:
    from ..core.methods import parameters
    from .terminal import folded

    lines = [folded(f"{e.name}: {e.title}", "  "), folded(f"  {e.source}", "  ")]
    for name, q, default in parameters(e):
        unit = "" if q.unit == "-" else f" {q.unit}"
        value = f"{e.name}.{name} = {values[name]:g}{unit}"
        lines.append(folded(f"  {value}  ({q.range}; default {default:g}) {q.text}", "    "))
    return "\n".join(lines)


def _response(chosen: "list[Estimator]", settings: "Settings", shared: Shared) -> int:
    from ..core.document import dumps, finite, tagged
    from ..core.physics import wheelset
    from ..studies.response import FREQUENCIES, responses
    from . import terminal

    w = wheelset(settings.vehicle, 1)
    all_responses = [r for e in chosen for r in responses(e, settings.params(e), w)]
    if shared.json:
        listed = []
        for r in all_responses:
            head = {"algo": r.algo, "amplitude_n": r.amplitude_n}
            curves = {"frequency_hz": r.frequency_hz.tolist()}
            for name in ("gain", "delay_s", "noise_gain"):
                curves[name] = [finite(x) for x in getattr(r, name).tolist()]
            listed.append(head | curves)
        print(dumps(tagged("response", responses=listed)))
        return 0
    for title, name, factor, digits in (
        ("Gain of the force", "gain", 1.0, 2),
        ("Delay of the force [ms]", "delay_s", 1e3, 0),
        ("Force per wheel speed [N/(rad/s)]", "noise_gain", 1.0, 0),
    ):
        rows = []
        for r in all_responses:
            values = zip(FREQUENCIES, getattr(r, name).tolist(), strict=True)
            columns = {f"{f:g}": terminal.number(factor * x, digits) for f, x in values}
            rows.append({"method": r.algo, "A [N]": terminal.number(r.amplitude_n), **columns})
        print(f"{title} by frequency [Hz]:\n{terminal.records(rows)}\n")
    print("A: amplitude of the force; - where it makes no difference.")
    return 0
