"""Text for people: tables on stdout, progress and findings on stderr."""

import itertools
import shutil
import sys
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..core.finding import Finding
from ..core.model import Result, Score
from ..core.text import printable

_NAMES = 200  # characters of the channels of a finding; all of them are in --json
_SEVERE = {"error": 0, "warning": 1, "info": 2}
NARROW = 80  # columns where there is no terminal, and in a recording
_TEXT = 16  # columns that a text keeps
_ALIKE = 3  # findings of one code that are shown one by one


def table(
    header: Sequence[str],
    rows: Sequence[Sequence[str]],
    left: int = 1,
    prose: bool = False,
    width: int | None = None,
) -> str:
    """Columns under their header; the first `left` ones to the left, numbers to the right.

    With `prose` the last column is a text, to the left as well. What is wider than `width`, or else
    the terminal, is folded: headers first, then texts; numbers that still have no room follow in a
    table of their own beside the first `left` columns.
    """
    width = width or shutil.get_terminal_size((NARROW, 24)).columns
    cells = [[printable(c) for c in row] for row in (header, *rows)]
    texts = [*range(left), *([len(header) - 1] if prose else [])]
    widths = [max(len(row[i]) for row in cells) for i in range(len(header))]
    gaps = 2 * (len(header) - 1)
    if sum(widths) + gaps > width:
        for i in set(range(len(header))) - set(texts):
            words = [len(w) for w in cells[0][i].split()]
            widths[i] = max([*(len(row[i]) for row in cells[1:]), *words, 1])
        while sum(widths) + gaps > width and max(widths[i] for i in texts) > _TEXT:
            widths[max(texts, key=lambda i: widths[i])] -= 1
    if sum(widths) + gaps > width and len(header) - left > 1:
        fit = left + 1
        while sum(widths[: fit + 1]) + 2 * fit <= width:
            fit += 1
        head, *body = ([*row[:left], *row[fit:]] for row in cells)
        first = table(header[:fit], [row[:fit] for row in rows], left, width=width)
        return f"{first}\n\n{table(head, body, left, prose, width)}"
    lines = []
    for row in cells:
        folds = [textwrap.wrap(c, w) for c, w in zip(row, widths, strict=True)]
        for line in itertools.zip_longest(*folds, fillvalue=""):
            parts = [
                c.ljust(w) if i in texts else c.rjust(w)
                for i, (c, w) in enumerate(zip(line, widths, strict=True))
            ]
            lines.append("  ".join(parts).rstrip())
        if row is cells[0]:
            lines.append("  ".join("-" * w for w in widths))
    return "\n".join(lines)


def folded(text: str, indent: str = "", width: int | None = None) -> str:
    """A line of text as wide as `width`, or else the terminal; what follows indented."""
    width = width or shutil.get_terminal_size((NARROW, 24)).columns
    return textwrap.fill(
        text, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    )


def number(value: float | None, digits: int = 0) -> str:
    """A number with fixed digits, a dash where there is none."""
    return "-" if value is None else f"{round(value, digits) + 0.0:.{digits}f}"  # no "-0"


def _newtons(value: float | None) -> str:
    """A force's error [N], with one decimal where that says more."""
    return number(value, 1 if value is not None and value < 10.0 else 0)


def scores(rows: Sequence[tuple[str, Score]], title: str) -> str:
    """The table of estimators, whatever stands in the first column.

    What they are measured against has a column only where that is not the same for all.
    """
    against = {s.against for _, s in rows}
    own = len(against) > 1
    header = [
        title, "algorithm", *(["against"] if own else []), "rmse [N]", "bias [N]", "max [N]",
        "lag [s]", "gain", "95 % [s]", "ripple [N]", "relative",
    ]  # fmt: skip
    lines = [
        [
            name, s.algo, *([s.against] if own else []), number(s.rmse_n), number(s.bias_n),
            number(s.max_error_n), number(s.lag_s, 3), number(s.gain, 3), number(s.response_s, 2),
            _newtons(s.ripple_n), number(s.relative, 2),
        ]
        for name, s in rows
    ]  # fmt: skip
    found = table(header, lines, left=3 if own else 2)
    return f"against {against.pop()}:\n{found}" if len(against) == 1 else found


def findings(found: Sequence[Finding]) -> str:
    """Findings, the severest first: a line each, one for all where many channels share a code."""
    by_code: dict[str, list[Finding]] = {}
    for f in sorted(found, key=lambda f: _SEVERE[f.severity]):
        by_code.setdefault(f.code, []).append(f)
    lines = []
    for same in by_code.values():
        shown = same if len(same) <= _ALIKE else same[:1]
        for f in shown:
            where = f" at {f.first_s:.3f} s" if f.first_s is not None else ""
            count = (
                f" ({f.count}×{where})" if f.count > 1 else f" ({where.strip()})" if where else ""
            )
            named = f.channel if len(f.channel) <= _NAMES else f.channel[: _NAMES - 1] + "…"
            channel = f" {printable(named)}:" if f.channel else ""
            lines.append(f"{f.severity:7s} {f.code}:{channel} {printable(f.message)}{count}")
        if len(shown) < len(same):
            others = ", ".join(printable(f.channel) for f in same[1:6])
            more = f" and {len(same) - 6} more" if len(same) > 6 else ""
            alike = len({replace(f, channel="") for f in same}) == 1
            which, own = (
                ("the same", "") if alike else ("also", ", with their own figures (--json)")
            )
            lines.append(f"{'':7s} {same[0].code}: {which} for {others}{more}{own}")
    return "\n".join(lines)


def lossy(found: Sequence[Finding]) -> bool:
    """Whether data was dropped, repaired or refused: exit code 3."""
    return any(f.severity != "info" for f in found)


def summary(result: Result, entry: dict[str, Any]) -> str:
    """What `analyze` says of one log: the log, the reference's errors, scores, files."""
    log = entry["log"]
    axles = ", ".join(str(a["axle"]) for a in entry["axles"])
    many = "axles" if len(entry["axles"]) > 1 else "axle"
    lines = [
        f"{printable(log['path'])}: {log['format']}, {log['duration_s']:.1f} s, "
        f"{log['rows_used']} of {log['rows_read']} rows used, {many} {axles}"
    ]
    for axle in entry["axles"]:
        reference = axle["reference"]
        lines.append(
            f"axle {axle['axle']}: reference {reference['method']}, "
            f"noise ±{_newtons(reference['sigma_n'])} N (1 sigma), "
            f"95 % band with vehicle tolerances ±{_newtons(reference['band_n'])} N"
        )
    lines.append(scores([(str(a.record.axle), s) for a in result.axles for s in a.scores], "axle"))
    return "\n".join([*lines, wrote(*entry["outputs"].values())])


def wrote(*paths: str | Path) -> str:
    """Which files were written, a line each; several are a set and have a manifest."""
    from ..results import atomic_files

    names = [*paths, *([atomic_files.manifest(Path(paths[0]))] if len(paths) > 1 else [])]
    return "\n".join(f"wrote {printable(str(name))}" for name in names)


def progress(quiet: bool) -> Callable[[str], None]:
    """Tells what is being done: on stderr, and only where somebody watches."""
    if quiet or not sys.stderr.isatty():
        return lambda _: None
    return lambda text: print(f"\r\x1b[K{printable(text)} …", end="\r", file=sys.stderr, flush=True)


def message(text: str, quiet: bool) -> None:
    """Text on stderr."""
    if not quiet:
        print("\n".join(map(printable, text.split("\n"))), file=sys.stderr)
