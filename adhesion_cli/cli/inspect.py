"""`adhesion inspect`: what is in a log."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from .options import Logs, Shared, loader, rejects, shared, targets

if TYPE_CHECKING:
    from ..model import Log

_WORST = (0, 3, 1, 2)  # exit codes from good to bad


@shared("config", "set_", "json", "force", "strict", "rejects")
def command(logs: Logs, shared: Shared) -> int:
    """Show channels, what each means and why, units, rates, gaps and everything found.

    Example: adhesion inspect leaf-film.mcap
    """
    from ..document import dumps, tagged
    from ..inspection import inspect
    from ..write import files

    files.check(targets(shared), shared.force, inputs=logs)
    read: list[Log] = []
    seen = [
        inspect(log, loader(shared), lambda log: read.append(replace(log, channels=())))
        for log in logs
    ]
    with rejects(shared, read, logs):
        pass
    if shared.json:
        print(dumps(tagged("inspect", logs=[doc for doc, _ in seen])))
    else:
        print("\n\n".join(_text(doc) for doc, _ in seen))
    return max((code for _, code in seen), key=_WORST.index)


def _text(doc: dict[str, Any]) -> str:
    from ..model import Finding
    from ..text import printable
    from . import show

    lines = [f"{printable(doc['path'])}: {doc['format'] or 'unknown format'}, {doc['status']}"]
    if doc["error"]:
        return "\n".join(
            [*lines, f"error: {printable(doc['error'])}", f"hint: {printable(doc['hint'])}"]
        )
    lines += [f"{doc['rows_read']} rows, {doc['duration_s']:.3f} s", f"time: {doc['time']}"]
    lines += [
        f"{name}: {printable(str(value))}"
        for name, value in doc["stated"].items()
        if value not in ("", None)
    ]
    rows = [
        [
            f"{c['name']} {c['field']}".strip(), c["meaning"] or "-", show.number(c["axle"]),
            c["unit"] or "-", show.number(c["rate_hz"], 2), str(c["rows"]),
            str(c["rows"] - c["valid"]), str(c["gaps"]), str(c["duplicates"]), str(c["backward"]),
            c["reason"],
        ]
        for c in doc["channels"]
    ]  # fmt: skip
    header = [
        "channel", "meaning", "axle", "unit", "Hz", "rows", "unused", "gaps", "dupl.", "back",
        "why",
    ]  # fmt: skip
    lines.append(show.table(header, rows, left=2, prose=True))
    found = [Finding(**f) for f in doc["findings"]]
    return "\n".join([*lines, show.findings(found)] if found else lines)
