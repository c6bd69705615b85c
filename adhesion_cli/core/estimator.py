"""What an online estimator is, and which ones there are.

An estimator is a method in `estimators/`; `methods` says what its file holds. Its `State` ends with
`F`, the estimate [N]. It may have `sigma`, the standard uncertainty of F by the noise [N]. Its
`ABOUT` is the `About` of this module. It has

- `init(p, w, K, y) -> State`, the state at the first sample of a segment;
- `step(p, w, s, h, K, y) -> State`, the state one sample later. `w` is `model.Wheelset`. `h` is the
  actual interval to this sample [s], `K` its clamping force [N], `y` its wheel speed [rad/s].

The same `step` runs sample by sample (`advance`) and compiled over whole logs (`compiled.batch`).
`nis(p, w, s, h, K, y) -> float` is optional: the normalised innovation squared of this sample, by
the state before it. It is NaN where the estimator does not use the sample.
`longest_step(p) -> float` is optional. It is the longest interval [s] at which `step` is stable,
for parameters that are not stable at every interval.

Time and rate. At t_k both ends of the interval (t_{k-1}, t_k] are known. An estimator takes K and y
as straight lines across it. That is exact for ramps, and half an interval from a step. The result
depends on the signals, not on how often they were logged. `euler = 1` is the printed alternative:
both keep their value at t_{k-1}.

Start. ω̂ = y and F̂ = 0, as in the paper, also where a segment starts while the brake is on. The
wheel may slide there, so no better force is known. `td` has no force but the paper's (5): it starts
at φK. `imm` assumes a wheel that rolls, and an uncertainty. The response time at the start of such
a segment is not scored (`brake_applications.find_start_ups`).
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields
from typing import Annotated, Any, NamedTuple

from . import errors, methods, toml
from .methods import Interval, Kind, Method
from .model import Quantity, Wheelset


class Claim(NamedTuple):
    """How well an estimator follows the true force on a named scenario; tests check it."""

    rmse: float  # [N]
    lag: float  # [s]


@dataclass(frozen=True, slots=True)
class About(methods.About):
    """What a method is called, where it was published, and what it claims by scenario name."""

    claims: Mapping[str, Claim]


class Sample(NamedTuple):
    """What `step` receives, with the ranges that a control unit accepts."""

    h: Interval
    K: Annotated[float, Quantity("N", "clamping force", 0.0, 1e6)]
    y: Annotated[float, Quantity("rad/s", "wheel speed", -1e3, 1e3)]


@dataclass(frozen=True, slots=True, eq=False)
class Estimator(Method):
    """One estimator, as found in its file."""

    claims: Mapping[str, Claim]
    longest_step: Callable[[Any], float]
    nis: Callable[..., float] | None

    @property
    def has_sigma(self) -> bool:
        """Whether it knows its uncertainty."""
        return "sigma" in self.State._fields


KIND = Kind("estimators", "an estimator", About, ("F",), "the estimate [N]", "core.estimator")


def registry() -> dict[str, Estimator]:
    """Every estimator by name, sorted; a UserError for a file without one."""
    return {
        name: Estimator(
            **{f.name: getattr(m, f.name) for f in fields(m)},
            claims=module.ABOUT.claims,
            longest_step=getattr(module, "longest_step", lambda _: math.inf),
            nis=getattr(module, "nis", None),
        )
        for name, (m, module) in methods.scan(KIND).items()
    }


def advance(  # noqa: PLR0913 (a step, and whose)
    est: Estimator, p: Any, w: Wheelset, state: Any, h: float, K: float, y: float
) -> Any:
    """The state after a sample; `state` is None before the first of a segment, and `h` no matter.

    Raises as `check_step`.
    """
    if state is None:
        return est.init(p, w, K, y)
    check_step(est, p, h)
    return est.step(p, w, state, h, K, y)


def check_step(est: Estimator, p: Any, h: float) -> None:
    """Refuses, by a UserError, an interval `h` [s] at which `est` with these `p` is unstable."""
    longest = est.longest_step(p)
    if h > longest:
        raise errors.UserError(
            f"{est.name}: an interval of {h:.4g} s is unstable with euler = 1, "
            f"the longest stable one is {longest:.4g} s",
            f"state {toml.option(f'{est.name}.euler = 0')}, which is stable at every interval",
        )
