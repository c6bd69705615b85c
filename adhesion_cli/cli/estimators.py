"""`adhesion estimators`: the registry."""

from typing import TYPE_CHECKING

from .options import Shared, load_settings, shared

if TYPE_CHECKING:
    from ..core.estimator import Estimator


@shared("config", "set_", "algo", "json")
def command(shared: Shared) -> int:
    """Show every online estimator and its parameters.

    With method and source; each parameter as set, with unit, range and default.

    Example: adhesion estimators -a neso --set neso.beta1=100
    """
    from ..analysis.request import choose_estimators
    from ..core.document import dumps, tagged

    chosen, settings = choose_estimators(shared.algo), load_settings(shared)
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
