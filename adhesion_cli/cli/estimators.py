"""`adhesion estimators`: the registry."""

from typing import Annotated

import typer


def command(
    json: Annotated[bool, typer.Option("--json", help="One JSON document.")] = False,
) -> int:
    """Show every online estimator: method, source, parameters with unit, range and default.

    Example: adhesion estimators
    """
    from ..estimator import parameters, registry

    known = registry().values()
    if json:
        import json as json_module

        from ..document import finite

        listed = [
            {
                "algo": e.name,
                "title": e.title,
                "source": e.source,
                "claims": {k: c._asdict() for k, c in e.claims.items()},
                "parameters": [
                    {
                        "name": name, "unit": q.unit, "text": q.text, "default": default,
                        "low": finite(q.low), "high": finite(q.high),
                    }
                    for name, q, default in parameters(e)
                ],
            }
            for e in known
        ]  # fmt: skip
        print(
            json_module.dumps({"schema": "adhesion.estimators/1", "estimators": listed}, indent=1)
        )
        return 0
    for e in known:
        print(f"{e.name}: {e.title}\n  {e.source}")
        for name, q, default in parameters(e):
            bounds = f"{q.low:g} to {q.high:g}"
            print(f"  {e.name}.{name} = {default:g} {q.unit}  ({bounds}) {q.text}")
        print()
    return 0
