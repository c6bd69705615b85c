"""`adhesion inspect`: what is in a log."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from ..core.text import printable
from .options import Logs, Shared, load_settings, shared

if TYPE_CHECKING:
    from ..core.finding import Finding
    from ..core.summary import InspectedChannel, InspectedLog, VehicleSummary

_WORST = (0, 3, 1, 2)  # exit codes from good to bad
_TO_STATE = ("not-analysable", "unit-unknown")  # findings that a setting ends


@shared("config", "set_", "dbc", "json", "strict")
def command(logs: Logs, shared: Shared) -> int:
    """Show what is in a log: channels, units, gaps, findings.

    Of each channel: its meaning and why, its unit, its rate and its faults.

    Example: adhesion inspect sample_logs/low-adhesion.mcap
    """
    from ..analysis.inspection import inspect
    from ..core.annotated import as_json
    from ..core.document import dumps, tagged

    settings = load_settings(shared)
    inspected = [inspect(log, settings, shared.debug) for log in logs]
    if shared.json:
        print(dumps(tagged("inspect", logs=[as_json(i.summary) for i in inspected])))
    else:
        print("\n\n".join(_text(i.summary, i.findings, i.vehicle) for i in inspected))
    return max((i.code for i in inspected), key=_WORST.index)


def _text(
    log: "InspectedLog", findings: "Sequence[Finding]", vehicle: "VehicleSummary | None"
) -> str:
    from ..results.vehicle_text import describe_vehicle
    from . import terminal

    lines = [f"{printable(log.path)}: {log.format or 'unknown format'}, {log.status}"]
    if log.error:
        lines += [f"error: {printable(log.error)}", f"hint: {printable(log.hint or '')}"]
        return "\n".join(lines)
    lines += [f"{log.rows_read} rows, {log.duration_s:.3f} s", f"time: {log.time}"]
    stated_values = {name: value for name, value in log.stated.items() if value not in ("", None)}
    lines += [f"{name}: {printable(str(value))}" for name, value in stated_values.items()]
    lines += _channels(log.channels)
    lines += [terminal.folded(describe_vehicle(vehicle))] if vehicle else []
    lines += [terminal.findings(findings)] if findings else []
    # What has to be stated is shown as it can be pasted, without line breaks.
    remedies = dict.fromkeys(f.hint for f in findings if f.code in _TO_STATE and f.hint)
    return "\n".join([*lines, *(f"hint: {printable(remedy)}" for remedy in remedies)])


def _channels(channels: "Sequence[InspectedChannel]") -> list[str]:
    """A row each, with its axles and each fault that occurs; then the reason for each meaning."""
    from ..results.result_rows import channel_row
    from . import terminal

    faults = {"unused": [c.rows - c.valid for c in channels]}
    for name in ("gaps", "duplicates", "backward"):
        faults[name] = [getattr(c, name) for c in channels]
    present = [name for name, counts in faults.items() if any(counts)]
    axles_of_row: dict[tuple[tuple[str, str], ...], list[str]] = {}
    for i, c in enumerate(channels):
        counts = {"Hz": terminal.number(c.rate_hz, 2), "rows": str(c.rows)}
        row = channel_row(c) | counts | {name: str(faults[name][i]) for name in present}
        axles_of_row.setdefault(tuple((row | {"axle": ""}).items()), []).append(row["axle"])
    rows = [dict(row) | {"axle": ", ".join(axles)} for row, axles in axles_of_row.items()]
    lines = [terminal.records(rows, text_columns=2)] if rows else []
    if absent := [name for name in faults if name not in present]:
        lines.append(f"{', '.join(absent)}: none")
    axles_of: dict[tuple[str, str], list[str]] = {}
    for c in channels:
        axle = [] if c.axle is None else [str(c.axle)]
        axles_of.setdefault((c.meaning or "-", c.reason), []).extend(axle)
    for (meaning, reason), axles in axles_of.items():
        axle_list = f" {', '.join(dict.fromkeys(axles))}" if axles else ""
        lines.append(terminal.folded(f"{meaning}{axle_list}: {printable(reason)}", "  "))
    return lines
