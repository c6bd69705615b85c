"""The files of an export, by name."""

from collections.abc import Callable
from typing import NamedTuple

from .. import __version__, wsp
from ..core import estimator, model, physics
from ..core.errors import UserError, unknown
from ..core.methods import Method, validate
from ..wsp.wsp_controller import Settings, bands
from . import pages, templates, vectors
from .c_types import DOUBLE, SINGLE
from .interface import WHEELSET_INPUTS, Interface


class Exported(NamedTuple):
    """What a run writes, and its figures."""

    texts: dict[str, str]  # by file name; the first is the header
    samples: int  # in the test program
    single_error: float  # largest error of the answer in single precision [N]; of a slip [-]


def methods() -> dict[str, Method]:
    """Every method that C can have, by name: estimators, and controllers with parameters."""
    laws = {name: m for name, m in wsp.controller.registry().items() if m.Params._fields}
    return {**estimator.registry(), **laws}


def names(algo: str) -> list[str]:
    """The names of an export's files; a UserError for an unknown method."""
    if algo not in (supported := methods()):
        if algo in wsp.controller.registry():
            text = f"{algo!r} has no parameters and no state: there is nothing to export"
            raise UserError(text, f"known: {', '.join(supported)}", code=2)
        raise unknown("algorithm", algo, list(supported))
    return [f"adhesion_{algo}.h", f"adhesion_{algo}.c", f"test_{algo}.c", "Makefile", "README.md"]


def export(
    algo: str,
    settings: Settings,
    vehicle: model.Vehicle,
    axle: int = 1,
    double: bool = True,
    progress: Callable[[str], None] = lambda _: None,
) -> Exported:
    """The files of one method; a UserError for what is unknown, out of range or unstable.

    `settings` are parameters by the names of methods; others have their defaults. `axle` is the one
    whose wheel radius counts.
    """
    names(algo)
    method = methods()[algo]
    p = validate(method, settings.get(algo, {}))
    vehicle = vehicle.of_axle(axle)
    w = physics.wheelset(vehicle, 1)
    wheelset_values = {name: getattr(w, name) for name in WHEELSET_INPUTS}
    number = DOUBLE if double else SINGLE
    interface = Interface(method, p, tuple(wheelset_values.values()), number, __version__)
    code = interface.code()
    progress(f"running {algo} on {vectors.LOG}")
    if isinstance(method, estimator.Estimator):
        test_vectors = vectors.of_estimator(method, p, w, vehicle)
    else:
        bands(settings)
        test_vectors = vectors.of_controller(method, p, settings, vehicle)
    if not double and test_vectors.missing_count:
        text = f"{algo}: no finite answer in single precision at {test_vectors.missing_count}"
        raise UserError(f"{text} samples of {vectors.LOG}", "leave out --float")
    readme = pages.readme(interface, code, test_vectors, wheelset_values, vehicle)
    program = pages.program(interface, test_vectors)
    makefile = templates.render("Makefile.jinja", interface=interface, deviations=pages.DEVIATIONS)
    texts = (code.header, code.source, program, makefile, readme)
    error = max(test_vectors.single_errors(-1 if interface.estimator else 0))
    return Exported(dict(zip(names(algo), texts, strict=True)), len(test_vectors.rows), error)
