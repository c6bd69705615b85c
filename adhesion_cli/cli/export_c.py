"""`adhesion export-c`: an estimator or a control law as C99 for a brake control unit."""

from pathlib import Path
from typing import Annotated

import typer

from . import options
from .options import Shared, option, shared


@shared("config", "set_", "out", "json", "force")
def command(
    algo: Annotated[
        str,
        typer.Argument(
            metavar="ALGO",
            help="Estimator, or control law of antiskid.",
            **options.completes(lambda: [*options.estimators(), *options.controllers()]),
        ),
    ],
    shared: Shared,
    single: Annotated[
        bool, option("--float", None, "Single precision, instead of double.")
    ] = False,
    axle: Annotated[
        int, option("--axle", "N", "Axle whose wheel radius is the default; 1.", min=1)
    ] = 1,
) -> int:
    """Export an estimator or a control law as C99 source.

    C99 without allocation, translated from the same source that analyze and antiskid run. With a
    test on a bundled log, a Makefile, and a README with units and ranges. The settings stated are
    the defaults of the C.

    Example: adhesion export-c kalman -o bcu --float
    """
    from ..core.document import dumps, tagged
    from ..export import files
    from ..results import atomic_files
    from . import terminal

    folder = shared.out or Path()
    paths = [folder / name for name in files.names(algo)]
    options.check(shared, paths)
    settings = options.load_settings(shared)
    progress = terminal.progress(shared.quiet)
    exported = files.export(algo, settings.overrides, settings.vehicle, axle, not single, progress)
    with atomic_files.outputs(paths, shared.force, inputs=shared.config) as places:
        for place, text in zip(places, exported.texts.values(), strict=True):
            place.write_text(text, encoding="utf-8")
    unit = "N" if algo in options.estimators() else "-"
    if shared.json:
        kinds = ("header", "source", "test", "makefile", "readme")
        outputs = {kind: str(path) for kind, path in zip(kinds, paths, strict=True)}
        error = {"value": exported.single_error, "unit": unit}
        body = {"algo": algo, "type": "float" if single else "double", "samples": exported.samples}
        print(dumps(tagged("export-c", **body, single_precision_error=error, outputs=outputs)))
        return 0
    print(terminal.wrote(*paths))
    single_error = f"{exported.single_error:.2g}{' N' if unit == 'N' else ''}"
    text = f"`make -C {folder} test` runs it on {exported.samples} samples."
    text += f" Single precision differs by at most {single_error} there."
    terminal.message(text, shared.quiet)
    return 0
