"""Stops whose unit takes φ, wheel radius or mass for more or less than they are.

    python benchmarks/sensitivity.py [SCENARIO]

The scenario is `slippery-stop` if not given; each error is a key of its `[antiskid]`.
"""

import sys
from dataclasses import replace

from adhesion_cli import antiskid, scenario

CASES = (
    {}, {"friction": 0.8}, {"friction": 0.9}, {"friction": 1.1}, {"friction": 1.2},
    {"radius": 0.99}, {"radius": 1.01}, {"mass": 0.8}, {"mass": 1.2},
)  # fmt: skip


def main(name: str) -> None:
    case = scenario.load(name)
    dry = antiskid.dry_distance(case)
    for errors in CASES:
        s = replace(case, antiskid=replace(case.antiskid, **errors))
        cells = []
        for law in ("patent", "rule"):
            v = antiskid.verdict(antiskid.run(s, law), s, dry)
            used = "-" if v.utilisation is None else f"{v.utilisation:.3f}"
            cells.append(f"{law} {v.stopping_distance_m:6.1f} m, {used}, ")
            cells[-1] += f"locked {v.locked_s:.1f} s, {v.air_nl:.0f} Nl"
        label = ", ".join(f"{k} {x - 1.0:+.0%}" for k, x in errors.items()) or "as it is"
        print(f"{label:14} {' | '.join(cells)}")


if __name__ == "__main__":
    main(sys.argv[1] if len(sys.argv) > 1 else "slippery-stop")
