"""Text for people: tables on stdout, progress and findings on stderr."""

import shutil
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.finding import Finding, Severity, catalogue
from ..core.model import Score
from ..core.summary import AxleSummary, ResultSummary
from ..core.text import printable
from ..results.result_rows import newtons, score_row
from ..results.text_tables import NARROW as NARROW
from ..results.text_tables import at_least as at_least
from ..results.text_tables import folded as folded
from ..results.text_tables import number as number
from ..results.text_tables import records as records
from ..results.text_tables import table as table

if TYPE_CHECKING:
    from ..fleet.run import State

_WIDEST = 120  # columns of a line on a finding
_CHANNEL = 28  # of these for names of channels
_INSTANT = 0.005  # a shorter span is one time [s]
_HEADINGS: dict[Severity, str] = {"error": "errors", "warning": "warnings", "info": "notes"}
_EXPLAINS = "`adhesion explain CODE` shows cause, effect and remedy."
_ALIKE = 3  # messages of one code that are shown one by one


def scores(rows: Sequence[tuple[str, Score]], log: str = "") -> str:
    """The scores of the estimators, by what they are measured against.

    Args:
        rows: the axle and a score, best first.
        log: named in the heading, if not empty.
    """
    by_target: dict[str, list[dict[str, str]]] = {}
    for axle, s in rows:
        by_target.setdefault(s.against, []).append(score_row(axle, s))
    where = f"{printable(log)}, " if log else ""
    tables = [
        f"{where}against {target}:\n{records(_known(of), left=2)}"
        for target, of in by_target.items()
    ]
    marked = ["≈: the noise of the reference explains the difference from the best (95 %)."]
    some = any(s.alike and s.relative != 1.0 for _, s in rows)
    return "\n".join([*tables, *(marked * some), *_bands([s for _, s in rows])])


def _bands(scores: Sequence[Score]) -> list[str]:
    """A line for each estimator that knows its uncertainty."""
    by_algo: dict[str, list[tuple[float, float]]] = {}
    for s in scores:
        if s.band_n is not None and s.within is not None:
            by_algo.setdefault(s.algo, []).append((s.band_n, 100.0 * s.within))
    lines = []
    for algo, found in by_algo.items():
        width, share = (_range([x[i] for x in found]) for i in (0, 1))
        lines.append(f"{algo}: own 95 % band ± {width} N, holds {share} % of the samples")
    return lines


def _range(values: Sequence[float]) -> str:
    low, high = f"{min(values):.0f}", f"{max(values):.0f}"
    return low if low == high else f"{low} to {high}"


def _known(rows: Sequence[Mapping[str, str]]) -> list[dict[str, str]]:
    """The rows without the columns that hold no value."""
    keys = [key for key in rows[0] if any(row[key] != "-" for row in rows)]
    return [{key: row[key] for key in keys} for row in rows]


def findings(found: Sequence[Finding], width: int | None = None) -> str:
    """A line per finding, folded at `width`, grouped by severity; then how to ask for more.

    Findings with one code and one message share a line. So do more than three with one code: the
    line then says the title of the code, because their messages differ.
    """
    columns = min(_WIDEST, width or shutil.get_terminal_size((_WIDEST, 24)).columns)
    lines: list[str] = []
    for severity, heading in _HEADINGS.items():
        groups = _grouped([f for f in found if f.severity == severity])
        codes = max((len(of[0].code) for of, _ in groups), default=0)
        lines += [f"{heading}:"] if groups else []
        for of, message in groups:
            where = ", ".join(filter(None, (_channels(of), _when(of))))
            parts = [of[0].code.ljust(codes), *([where] if where else []), printable(message)]
            line = _cut("  " + "  ".join(parts), 2 * _WIDEST)
            lines.append(folded(line, " " * 6, columns))
    return "\n".join([*lines, _EXPLAINS] if lines else lines)


def show(found: Sequence[Finding], quiet: bool, heading: str = "") -> None:
    """The findings on stderr, if there are any."""
    message(heading + findings(found), quiet or not found)


def _grouped(found: Sequence[Finding]) -> list[tuple[list[Finding], str]]:
    """The findings that share a line, each with what the line says."""
    by_code: dict[str, dict[str, list[Finding]]] = {}
    for f in found:
        by_code.setdefault(f.code, {}).setdefault(f.message, []).append(f)
    groups: list[tuple[list[Finding], str]] = []
    for code, by_message in by_code.items():
        if len(by_message) <= _ALIKE:
            groups += [(of, message) for message, of in by_message.items()]
        else:
            every = [f for of in by_message.values() for f in of]
            groups.append((every, catalogue()[code].title))
    return groups


def _channels(of: Sequence[Finding]) -> str:
    """As many channels as have room, at least one, and how many more there are."""
    names = list(dict.fromkeys(_cut(printable(f.channel), _CHANNEL) for f in of if f.channel))
    shown = len(names)
    while shown > 1 and len(", ".join(names[:shown])) > _CHANNEL:
        shown -= 1
    more = f" and {len(names) - shown} more" if shown < len(names) else ""
    return ", ".join(names[:shown]) + more


def _when(of: Sequence[Finding]) -> str:
    """The first time span and how many more there are; else how often."""
    spans = sorted(span for f in of for span in f.spans)
    if not spans:
        count = sum(f.count for f in of)
        return f"{count}×" if count > len(of) else ""
    begin, end = spans[0]
    first = f"{begin:.2f} s" if end - begin < _INSTANT else f"{begin:.2f}–{end:.2f} s"
    return f"{first} and {len(spans) - 1} more" if len(spans) > 1 else first


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 1].rstrip() + "…"


def lossy(found: Sequence[Finding]) -> bool:
    """Whether data was dropped, repaired or refused, or may be wrong: exit code 3."""
    return any(f.lossy for f in found)


def describe_log(summary: ResultSummary) -> str:
    """The log's path, and below it format, duration, rows and axles."""
    log, axles = summary.log, [str(a.axle) for a in summary.axles]
    return (
        f"{printable(log.path)}:\n{log.format}, {log.duration_s:.1f} s, "
        f"{log.rows_used} of {log.rows_read} rows used, "
        f"{'axles' if len(axles) > 1 else 'axle'} {', '.join(axles)}"
    )


def describe_reference(axle: AxleSummary) -> str:
    """The reference of an axle and its uncertainty in one line."""
    reference = axle.reference
    return (
        f"axle {axle.axle}: reference {reference.method}, "
        f"noise ±{newtons(reference.sigma_n)} N (1 sigma), "
        f"95 % band with vehicle tolerances ±{newtons(reference.band_n)} N"
    )


def wrote(*paths: str | Path) -> str:
    """Which files were written, a line each; several are a set and have a manifest."""
    from ..results import atomic_files

    names = [*paths, *([atomic_files.manifest(Path(paths[0]))] if len(paths) > 1 else [])]
    return "\n".join(f"wrote {printable(str(name))}" for name in names)


def progress(quiet: bool) -> Callable[[str], None]:
    """Shows what is being done: on stderr, and only if that is a terminal."""
    if quiet or not sys.stderr.isatty():
        return lambda _: None
    from rich.console import Console
    from rich.control import Control
    from rich.segment import ControlType
    from rich.text import Text

    console = Console(stderr=True, highlight=False)
    clear = Control(ControlType.CARRIAGE_RETURN, (ControlType.ERASE_IN_LINE, 2))

    def tell(text: str) -> None:
        console.control(clear)
        console.print(Text(f"{printable(text)} …"), end="\r", no_wrap=True, overflow="ellipsis")

    return tell


@contextmanager
def campaign(quiet: bool, logs: int) -> "Iterator[Callable[[State], None]]":
    """Shows how far a run over many logs is: on stderr, and only if that is a terminal.

    Args:
        quiet: whether it is shown at all.
        logs: how many there are.
    """
    if quiet or not sys.stderr.isatty():
        yield lambda _: None
        return
    from rich import progress as bars
    from rich.console import Console

    columns = (
        bars.TextColumn("{task.description}"), bars.BarColumn(), bars.MofNCompleteColumn(),
        bars.TextColumn("{task.fields[more]}"), bars.TimeRemainingColumn(),
    )  # fmt: skip
    with bars.Progress(*columns, console=Console(stderr=True), transient=True) as shown:
        reads = shown.add_task("reading", total=logs, more="")
        works: bars.TaskID | None = None
        begin, skipped = 0.0, 0

        def tell(state: "State") -> None:
            nonlocal works, begin, skipped
            failed = len(state.failed)
            ended = state.done + state.skipped + failed
            if state.read < logs:
                shown.update(reads, completed=state.read)
                return
            if works is None:
                shown.remove_task(reads)
                works = shown.add_task("analysing", total=logs - ended, more="")
                begin, skipped = time.monotonic(), ended
            rate = (ended - skipped) / max(time.monotonic() - begin, 1e-9)
            more = f"{rate:.1f} logs/s, {failed} failed"
            shown.update(works, completed=ended - skipped, more=more)

        yield tell


def message(text: str, quiet: bool) -> None:
    """Text on stderr."""
    if not quiet:
        print("\n".join(map(printable, text.split("\n"))), file=sys.stderr)
