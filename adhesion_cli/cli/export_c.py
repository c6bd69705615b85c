"""`adhesion export-c`: an estimator or a control law as C99 for a brake control unit."""

from pathlib import Path
from typing import Annotated

import typer

from .options import (
    Shared,
    check,
    completes,
    controllers,
    estimators,
    load_settings,
    option,
    shared,
)


@shared("config", "set_", "out", "json", "force")
def command(
    algo: Annotated[
        str,
        typer.Argument(
            metavar="ALGO", help="Estimator, or control law of antiskid.",
            **completes(lambda: [*estimators(), *controllers()]),
        ),
    ],
    shared: Shared,
    single: Annotated[
        bool, option("--float", None, "Single precision, instead of double.")
    ] = False,
    axle: Annotated[
        int, option("--axle", "N", "Axle whose wheel radius is the default; 1.", min=1)
    ] = 1,
) -> int:  # fmt: skip
    """Export an estimator or a control law as C99 source.

    C99 without allocation, translated from the same source that analyze and antiskid run. With a
    test on a bundled log, a Makefile, and a README with units, ranges and operation counts. The
    settings stated are the defaults of the C.

    Example: adhesion export-c kalman -o bcu --float
    """
    from ..analysis.json_documents import dumps, tagged
    from ..export import files
    from ..results import atomic_files
    from . import terminal

    folder = shared.out or Path()
    paths = [folder / name for name in files.names(algo)]
    _check_folder(folder, algo, paths)
    check(shared, paths)
    settings = load_settings(shared)
    tell = terminal.progress(shared.quiet)
    made = files.export(algo, settings.overrides, settings.vehicle, axle, not single, tell)
    with atomic_files.outputs(paths, shared.force, inputs=shared.config) as places:
        for place, text in zip(places, made.texts.values(), strict=True):
            place.write_text(text, encoding="utf-8")
    unit = "N" if algo in estimators() else "-"
    if shared.json:
        kinds = ("header", "source", "test", "makefile", "readme")
        outputs = {kind: str(path) for kind, path in zip(kinds, paths, strict=True)}
        error = {"value": made.single_error, "unit": unit}
        body = {"algo": algo, "type": "float" if single else "double", "samples": made.samples}
        print(dumps(tagged("export-c", **body, single_precision_error=error, outputs=outputs)))
        return 0
    print(terminal.wrote(*paths))
    text = f"`make -C {folder} test` runs it on {made.samples} samples. Single precision differs by"
    text += f" at most {made.single_error:.2g}{' N' if unit == 'N' else ''} there."
    terminal.message(text, shared.quiet)
    return 0


def _check_folder(folder: Path, algo: str, paths: list[Path]) -> None:
    """Refuses the folder of another export: its Makefile and README would be lost.

    Raises:
        UserError: names a folder to write to.
    """
    from ..core.errors import UserError
    from ..core.text import printable

    others = [x for x in folder.glob("adhesion_*.h") if x != paths[0]]
    there = [path for path in paths if path.exists()]
    if others and there and not paths[0].exists():
        shown = printable(str(folder))
        text = f"{printable(str(there[0]))}: belongs to the export {printable(others[0].name)}"
        other = printable(str(folder.with_name(f"{folder.name}-{algo}"))) if folder.name else algo
        raise UserError(text, f"each export needs a folder of its own, as -o {other}; not {shown}")
