"""The files of an export, by name."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

from .. import __version__
from ..core import controller, estimator, physics
from ..core.errors import UserError, unknown
from ..core.methods import Method, validate
from ..core.model import Vehicle
from ..wsp.wsp_controller import Settings, bands
from . import check_program, pages, vectors
from .c_types import Number
from .interface import STATED, Interface


class Exported(NamedTuple):
    """What a run writes, and its figures."""

    texts: dict[str, str]  # by file name; the first is the header
    samples: int  # in the test program
    single_error: float  # largest error of the answer in single precision [N]; of a slip [-]


def methods() -> dict[str, Method]:
    """Every method that C can have, by name: estimators, and controllers with parameters."""
    laws = {name: m for name, m in controller.registry().items() if m.Params._fields}
    return {**estimator.registry(), **laws}


def names(algo: str) -> list[str]:
    """The names of an export's files.

    Raises:
        UserError: for an unknown method.
    """
    if algo not in (known := methods()):
        if algo in controller.registry():
            text = f"{algo!r} has no parameters and no state: there is nothing to export"
            raise UserError(text, f"known: {', '.join(known)}", code=2)
        raise unknown("algorithm", algo, list(known))
    return [f"adhesion_{algo}.h", f"adhesion_{algo}.c", f"test_{algo}.c", "Makefile", "README.md"]


def export(
    algo: str,
    settings: Settings,
    vehicle: Vehicle,
    axle: int = 1,
    double: bool = True,
    tell: Callable[[str], None] = lambda _: None,
) -> Exported:
    """The files of one method.

    Args:
        algo: estimator or controller.
        settings: parameters by the names of methods; others have their defaults.
        vehicle: for the wheelset.
        axle: the one whose wheel radius counts.
        double: double precision, else single.
        tell: receives a line at each step.

    Raises:
        UserError: an unknown name, a value out of range, parameters that are unstable on the log.
    """
    names(algo)
    method = methods()[algo]
    p = validate(method, settings.get(algo, {}))
    vehicle = replace(vehicle, wheel_radius=(vehicle.radius(axle),))
    w = physics.wheelset(vehicle, 1)
    stated = {name: getattr(w, name) for name in STATED}
    of = Interface(method, p, tuple(stated.values()), Number(double), __version__)
    code = of.code()
    tell(f"running {algo} on {vectors.LOG}")
    if isinstance(method, estimator.Estimator):
        found = vectors.of_estimator(method, p, w, vehicle)
    else:
        bands(settings)
        found = vectors.of_controller(method, p, settings, vehicle)
    if not double and found.lost:
        text = f"{algo}: no finite answer in single precision at {found.lost} samples"
        raise UserError(f"{text} of {vectors.LOG}", "leave out --float")
    facts = pages.Facts(of, code, found, stated, vehicle)
    texts = (code.header, code.source, check_program.program(of, found), pages.makefile(of),
             pages.readme(facts))  # fmt: skip
    answer = -1 if of.estimator else 0
    error = max(found.single_errors(answer))
    return Exported(dict(zip(names(algo), texts, strict=True)), len(found.rows), error)
