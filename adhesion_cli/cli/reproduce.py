"""`adhesion reproduce`: the paper's tables and figures compared with ours."""

from pathlib import Path
from typing import TYPE_CHECKING

from . import results
from .options import Shared, check, shared

if TYPE_CHECKING:
    from ..core.annotated import Json


@shared("out", "json", "force", "view")
def command(shared: Shared) -> int:
    """Reproduce the paper's table and figures.

    They are in its section 3. The command states the reading of the text behind each number.
    Writes reproduce.mcap and reproduce.rrd.

    Example: adhesion reproduce
    """
    from ..core.document import dumps
    from ..results import atomic_files, mcap
    from ..studies.reproduce import reproduce
    from .terminal import progress, wrote

    paths = [(shared.out or Path()) / f"reproduce.{kind}" for kind in ("mcap", "rrd")]
    check(shared, paths)
    study = reproduce(progress=progress(shared.quiet))

    from ..results import rrd  # slow to import: only after the checks

    with atomic_files.outputs(paths, shared.force) as (record, recording):
        mcap.write_results(record, study.results, dumps(study.document))
        rrd.write_results(recording, study.results)
    if shared.json:
        print(dumps({**study.document, "outputs": {path.suffix[1:]: str(path) for path in paths}}))
    else:
        print("\n\n".join(report(study.document)))
        print(f"\n{wrote(*paths)}")
    return results.finished(shared, paths[1], [])


def report(doc: "Json") -> list[str]:
    """The document as people read it, part by part."""
    from .terminal import number, table

    varying, sections = doc["conditions"]["varying"], [_table_2(doc)]
    frequencies = [x["frequency_hz"] for x in varying["neso"]["frequency"]]
    for key, title in (("gain", "varying: gain"), ("lag_s", "varying: lag [s]")):
        body = [
            [algo, number(x["rmse_n"]), *(number(f[key], 2) for f in x["frequency"])]
            for algo, x in varying.items()
        ]
        heads = [title, "rmse at 0.5 Hz [N]", *(f"{f:g} Hz" for f in frequencies)]
        sections.append(table(heads, body))
    sections.append("Read as:\n" + "\n".join(f"- {text}" for text in doc["readings"]))
    return sections


def _table_2(doc: "Json") -> str:
    from .terminal import number, table

    rows = [
        [
            algo,
            number(x["response_s"], 2),
            _range(x["response_interval_s"], 2),
            number(x["paper_response_s"], 2),
            f"{100.0 * (x['response_s'] / x['paper_response_s'] - 1.0):+.1f} %",
            number(x["max_error_n"], 1),
            _range(x["max_error_interval_n"], 1),
            number(x["paper_max_error_n"]),
        ]
        for algo, x in doc["conditions"]["constant"].items()
    ]
    seeds = f"{doc['seeds']} seeds"
    times, errors = ["95 % [s]", seeds, "paper", "apart"], ["max [N]", seeds, "paper"]
    return table(["Table 2", *times, *errors], rows)


def _range(interval: list[float], digits: int) -> str:
    lower, upper = interval
    return f"{lower:.{digits}f} to {upper:.{digits}f}"
