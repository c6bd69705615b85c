"""Search for the parameters of a controller: the same rails, seeds, aim and effort for each law.

    python benchmarks/tune.py --law patent|rule [--candidates N] [--seeds S...] [--held-out S...]

Stops of `slippery-stop` with one axle from two speeds, on all rails of `tests/helpers/rails.py` but
dry. The aim, the less the better, is the mean over all stops of ln(distance), of 0.005 ln(air)
(twice the air is worth 0.35 % of distance), of 1 for a wheel that locks, and of what utilisation
lacks of 0.955. The shipped parameters are the first candidate; of
the others a third is drawn evenly within the limits below, the rest about the best so far. A
candidate that is worse than the best by more than `HOPELESS` after a seed is not given the next.
Aims are told less that of the shipped parameters on the same seeds. The best `FINALISTS` and the
shipped ones are then ranked by the same aim on held-out seeds, which no candidate was chosen by.
"""

import argparse
import math
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from adhesion_cli.core.errors import UserError
from adhesion_cli.wsp import scenario, wsp_controller
from adhesion_cli.wsp.closed_loop import ESTIMATOR
from adhesion_cli.wsp.stop import Verdict

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from helpers import rails

FINALISTS = 10
HOPELESS = 0.01
SPEEDS = (30.0, 15.0)  # [m/s]
LEAST = 0.955  # utilisation
RAILS = [name for name in rails.RAILS if name != "dry"]
# Limits by law and parameter, evenly in the logarithm where both have one sign.
SPACES = {
    "patent": {
        "patent.slip_low": (0.003, 0.03), "patent.slip_high": (0.02, 0.4),
        "patent.slope_low": (-2.0, -0.005), "patent.slope_high": (0.005, 3.0),
        "patent.horizon": (0.05, 1.5), "patent.patience": (0.02, 1.0),
        "patent.probe": (0.005, 0.5),
        "slope.delta": (0.2, 6.0), "slope.rho": (0.2, 6.0), "slope.guard": (1.0, 5.0),
        "slope.doubt": (0.05, 1.0),
    },
    "rule": {
        "rule.vent_slip": (0.01, 0.3), "rule.hold_slip": (0.005, 0.2),
        "rule.vent_deceleration": (0.5, 10.0), "rule.recovery": (0.05, 5.0),
        "rule.filter_time": (0.01, 1.0), "rule.pulse": (0.02, 2.0), "rule.pause": (0.005, 1.0),
        "rule.watchdog": (1.0, 10.0), "rule.reset": (0.1, 5.0),
    },
}  # fmt: skip
Point = dict[str, float]


def settings(x: Point) -> dict[str, dict[str, float]]:
    found: dict[str, dict[str, float]] = {}
    for name, value in x.items():
        section, key = name.split(".")
        found.setdefault(section, {})[key] = value
    return found


def shipped(law: str) -> Point:
    known = wsp_controller.parameters([law], ESTIMATOR, {})
    return {name: known[name.split(".")[0]][name.split(".")[1]] for name in SPACES[law]}


def aim(law: str, x: Point, seed: int) -> float:
    """What is to be small, see above; infinite where a train does not stand at last."""
    found: list[Verdict] = []
    for speed in SPEEDS:
        case = replace(scenario.load("slippery-stop"), train=scenario.ScenarioTrain(speed=speed))
        try:
            stops = rails.verdicts(case, RAILS, [law], [seed], settings=settings(x))
        except UserError:
            return math.inf
        found += [v for (v,) in stops.values()]
    total = 0.0
    for v in found:
        total += math.log(v.stopping_distance_m) + 0.005 * math.log(v.air_nl) + (v.locked_s > 0.0)
        total += max(LEAST - (1.0 if v.utilisation is None else v.utilisation), 0.0)
    return total / len(found)


def over(law: str, x: Point, zero: dict[int, float], enough: float = math.inf) -> float:
    """Mean of the aim over that of the shipped parameters, `zero` by seed; early if hopeless."""
    more: list[float] = []
    for seed, shipped_aim in zero.items():
        more.append(aim(law, x, seed) - shipped_aim)
        if np.mean(more) > enough:
            break
    return float(np.mean(more))


def candidates(law: str, count: int, random: np.random.Generator) -> Iterator[Point]:
    """Each is sent its aim before the next is made."""
    space = SPACES[law]
    best, least = shipped(law), math.inf
    for k in range(count):
        x = dict(best)
        if k > 0:
            near = random.random() < 2.0 / 3.0
            for name, (low, high) in space.items():
                sign = math.copysign(1.0, high)
                a, b = math.log(min(abs(low), abs(high))), math.log(max(abs(low), abs(high)))
                if not near:
                    x[name] = sign * math.exp(random.uniform(a, b))
                elif random.random() < 0.5:
                    step = 0.15 * (b - a) * random.standard_normal()
                    x[name] = sign * math.exp(min(max(math.log(abs(x[name])) + step, a), b))
        got = yield x
        if got < least:
            best, least = x, got


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--law", choices=list(SPACES), required=True)
    parser.add_argument("--candidates", type=int, default=200)
    parser.add_argument("--seeds", type=int, nargs="+", default=[101, 102, 103])
    parser.add_argument("--held-out", type=int, nargs="+", default=[201, 202, 203, 204, 205])
    parser.add_argument("--random", type=int, default=0, help="seed of the candidates")
    given = parser.parse_args()
    law, first = given.law, shipped(given.law)
    zero = {seed: aim(law, first, seed) for seed in given.seeds}
    draw = candidates(law, given.candidates, np.random.default_rng(given.random))
    tried = [(0.0, 0, next(draw))]
    for k in range(1, given.candidates):
        x = draw.send(tried[-1][0])
        tried.append((over(law, x, zero, min(tried)[0] + HOPELESS), k, x))
        if k % 20 == 0:
            print(f"{k}: best {min(tried)[0]:+.4f}", file=sys.stderr)
    place = 1 + sum(t[0] < 0.0 for t in tried)
    print(f"{law}: shipped parameters are {place} of {len(tried)} on seeds {given.seeds}")
    final = {k: x for _, k, x in sorted(tried)[:FINALISTS]} | {0: first}
    zero = {seed: aim(law, first, seed) for seed in given.held_out}
    held = sorted((over(law, x, zero), k) for k, x in final.items())
    place = 1 + [k for _, k in held].index(0)
    print(f"and {place} of {len(held)} finalists on held-out seeds {given.held_out}:")
    for value, k in held:
        text = " ".join(f"--set {name}={value:.4g}" for name, value in final[k].items())
        print(f"{value:+.5f} {'shipped' if k == 0 else k}: {text}")


if __name__ == "__main__":
    main()
