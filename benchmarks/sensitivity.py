"""Stops whose unit takes φ, wheel radii or mass for more or less than they are.

    python benchmarks/sensitivity.py [SCENARIO]

The scenario is `slippery-stop` if not given, of four axles if another; each stop is on its rail and
on dry rail, each error is a key of its `[antiskid]`.
"""

import sys
from dataclasses import replace

from adhesion_cli.wsp import closed_loop, scenario

CASES = (
    {}, {"friction": 0.8}, {"friction": 0.9}, {"friction": 1.1}, {"friction": 1.2},
    *({"radius": (1.0 + x,)} for x in (-0.03, -0.02, -0.01, 0.01, 0.02, 0.03)),
    {"radius": (1.05, 1.0, 1.0, 1.0)}, {"mass": 0.8}, {"mass": 1.2},
)  # fmt: skip


def main(name: str) -> None:
    case = scenario.load(name)
    dry = closed_loop.dry_distance(case)
    for errors in CASES:
        s = replace(case, antiskid=replace(case.antiskid, **errors))
        cells = []
        for law in ("patent", "rule"):
            v = closed_loop.verdict(closed_loop.run(s, law), s, dry)
            used = "-" if v.utilisation is None else f"{v.utilisation:.3f}"
            cells.append(f"{law} {v.stopping_distance_m:6.1f} m, {used}, ")
            cells[-1] += f"locked {v.locked_s:.1f} s, {v.air_nl:.0f} Nl, "
            good = replace(s, rail=closed_loop.DRY)
            v = closed_loop.verdict(closed_loop.run(good, law), good, dry)
            cells[-1] += f"dry {v.stopping_distance_m:.1f} m"
        label = ", ".join(f"{k} {_percent(x)}" for k, x in errors.items()) or "as it is"
        print(f"{label:24} {' | '.join(cells)}", flush=True)


def _percent(factor: float | tuple[float, ...]) -> str:
    factors = factor if isinstance(factor, tuple) else (factor,)
    return " ".join(f"{x - 1.0:+.0%}" for x in factors)


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "slippery-stop")
