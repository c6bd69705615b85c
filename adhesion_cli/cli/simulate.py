"""`adhesion simulate`: the log of a simulated brake, with the true force."""

from pathlib import Path
from typing import Annotated

from ..core.errors import UserError
from .options import ScenarioName, Seed, Shared, option, shared


@shared("json", "force")
def command(
    shared: Shared,
    scenario: Annotated[str, ScenarioName] = "",
    out: Annotated[
        Path | None, option("-o --out", "FILE", "Log: .csv, .mcap, .parquet or .xlsx.")
    ] = None,
    list_: Annotated[bool, option("--list", None, "Show the bundled scenarios.")] = False,
    seed: Seed = None,
    dt: Annotated[
        float | None,
        option("--dt", "S", "Time step, instead of the scenario's.", min=1e-6, max=0.02),
    ] = None,
) -> int:
    """Simulate a brake test and write its log.

    The log holds what the sensors measure, and the true force.

    Example: adhesion simulate leaf-film -o leaf-film.mcap
    """
    from ..core.document import dumps, tagged
    from ..results import atomic_files, wide_table
    from ..wsp import simulate
    from . import terminal

    if list_:
        names = simulate.scenarios()
        if shared.json:
            print(dumps(tagged("scenarios", scenarios=names)))
        else:
            print(terminal.table(["scenario", "what"], list(names.items()), text_columns=2))
        return 0
    if not scenario or out is None:
        hint = "for example: adhesion simulate service-brake -o brake.csv; --list shows scenarios"
        raise UserError("simulate needs a SCENARIO and -o FILE", hint, code=2)
    write = wide_table.writer(out)
    inputs = [Path(scenario)]
    atomic_files.check([out], shared.force, inputs=inputs)
    progress = terminal.progress(shared.quiet)
    progress(f"simulating {scenario}")
    log = simulate.as_log(simulate.run(simulate.load(scenario), seed, dt))
    progress(f"writing {out}")
    with atomic_files.outputs([out], shared.force, inputs=inputs) as (temporary,):
        write(temporary, log)
    if shared.json:
        counts = {"channels": len(log.channels), "samples": log.rows_read}
        outputs = {out.suffix[1:]: str(out)}
        print(dumps(tagged("simulate", scenario=log.path, outputs=outputs, **counts)))
    else:
        print(f"{terminal.wrote(out)}: {len(log.channels)} channels, {log.rows_read} samples")
    return 0
