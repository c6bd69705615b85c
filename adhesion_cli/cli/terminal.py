"""Text for people: tables on stdout, progress and findings on stderr."""

import re
import shutil
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING

from ..core.finding import Finding, Severity, catalogue
from ..core.model import Score
from ..core.summary import AxleSummary, FailedLog, ResultSummary
from ..core.text import printable
from ..results.result_rows import OF_BUDGETS, budget_row, combined, newtons, score_row
from ..results.text_tables import NARROW as NARROW
from ..results.text_tables import describe_times, shortened
from ..results.text_tables import folded as folded
from ..results.text_tables import non_empty as non_empty
from ..results.text_tables import number as number
from ..results.text_tables import records as records
from ..results.text_tables import table as table
from ..results.vehicle_text import describe_motors

if TYPE_CHECKING:
    from ..fleet.run import FleetProgress

_WIDEST = 120  # columns of a line on a finding
_CHANNEL = 28  # of these for names of channels
_HEADINGS: dict[Severity, str] = {"error": "errors", "warning": "warnings", "info": "notes"}
_EXPLAINS = "`adhesion explain CODE` shows cause, effect and remedy."
_FEW_LOGS = 2  # logs that a line on a finding names
_ZERO = re.compile(r"(?<=\.zero=)-?\d+(?:\.\d+)?")  # as an option states it
_ALIKE_ZEROS = 0.3  # of their mean: zeros that differ by less are one
_MOST_OPTIONS = 16  # that one finding shows
_LISTED_ALIKE = 3  # messages of one code that are shown one by one


def scores(rows: Sequence[tuple[str, Score]], log: str = "") -> str:
    """The scores of the estimators, by what they are measured against, headed by the log's name."""
    by_target: dict[str, list[dict[str, str]]] = {}
    for axle, s in rows:
        by_target.setdefault(s.against, []).append({"axle": axle} | score_row(s))
    log_name = f"{printable(log)}, " if log else ""
    tables = [
        f"{log_name}against {target}:\n{records(non_empty(score_rows), text_columns=2)}"
        for target, score_rows in by_target.items()
    ]
    marked = ["≈: the noise of the reference explains the difference from the best (95 %)."]
    any_relative = any(s.alike and s.relative != 1.0 for _, s in rows)
    return "\n".join([*tables, *(marked * any_relative), *_bands([s for _, s in rows])])


def _bands(scores: Sequence[Score]) -> list[str]:
    by_algo: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for s in scores:
        if s.band_n is not None and s.within is not None:
            by_algo.setdefault((s.algo, s.against), []).append((s.band_n, 100.0 * s.within))
    lines = []
    for (algo, target), bands in by_algo.items():
        width, share = (_range([x[i] for x in bands]) for i in (0, 1))
        lines.append(
            f"{algo}: own 95 % band ± {width} N, holds the {target} in {share} % of the samples"
        )
    return lines


def _range(values: Sequence[float]) -> str:
    lowest, highest = f"{min(values):.0f}", f"{max(values):.0f}"
    return lowest if lowest == highest else f"{lowest} to {highest}"


def budgets(axles: Sequence[AxleSummary]) -> str:
    """The uncertainty budget of each brake application's mean force."""
    lines = []
    for axle in axles:
        for a in axle.applications:
            if a.budget:
                lines += [f"Axle {axle.axle}, brake application at {a.start_s:.1f} s:"]
                lines += [records([budget_row(c) for c in a.budget], text_columns=3)]
                lines += [folded(combined(a)), ""]
    return "\n".join([*lines, folded(OF_BUDGETS), ""]) if lines else ""


def findings(findings_shown: Sequence[Finding], width: int | None = None) -> str:
    """A line per finding, folded at `width`, grouped by severity; then how to ask for more.

    Findings with one code and one message share a line. So do more than three with one code: the
    line then says the title of the code, because their messages differ.
    """
    rows: dict[Severity, list[_Row]] = {}
    for group, text in _grouped(findings_shown):
        location = ", ".join(filter(None, (_channels(group), describe_times(group))))
        rows.setdefault(group[0].severity, []).append(
            (_options(group), group[0].code, location, text)
        )
    return _listing(rows, width)


_Row = tuple[str, ...]  # options that its remedy states; code, places and text of a line


def _listing(rows: Mapping[Severity, Sequence[_Row]], width: int | None = None) -> str:
    """A line per row, the codes as wide as the longest, under the heading of its severity."""
    columns = min(_WIDEST, width or shutil.get_terminal_size((_WIDEST, 24)).columns)
    lines: list[str] = []
    for severity in (x for x in _HEADINGS if x in rows):
        lines.append(f"{_HEADINGS[severity]}:")
        codes = max(len(code) for _, code, *_ in rows[severity])
        for options, code, *places, text in rows[severity]:
            cells = filter(None, (code.ljust(codes), *places, printable(text)))
            line = shortened("  " + "  ".join(cells), 2 * _WIDEST)
            lines += [folded(line, " " * 6, columns), *options.splitlines()]
    return "\n".join([*lines, _EXPLAINS] if lines else lines)


def show(findings_shown: Sequence[Finding], quiet: bool, heading: str = "") -> None:
    """The findings on stderr, if there are any; of a quiet run those that set exit code 3."""
    selection = [f for f in findings_shown if f.lossy or not quiet]
    message(heading + findings(selection), quiet=not selection)


def show_commands(findings_shown: Sequence[Finding], quiet: bool) -> None:
    """The commands of a remedy on stderr, one a line, to paste."""
    for hint in dict.fromkeys(f.hint for f in findings_shown if f.names.get("commands")):
        message(f"{hint}\n", quiet)


def show_of_logs(
    logs: Sequence[tuple[str, Sequence[Finding]]], quiet: bool, series: Sequence[Finding] = ()
) -> None:
    """The findings of logs and of their series on stderr, each code once; see `show`."""
    by_code: dict[tuple[Severity, str], dict[str, list[Finding]]] = {}
    for name, findings_of_log in (("the series", series), *logs):
        for f in (f for f in findings_of_log if f.lossy or not quiet):
            by_code.setdefault((f.severity, f.code), {}).setdefault(name, []).append(f)
    rows: dict[Severity, list[_Row]] = {}
    for (severity, code), by_log in sorted(by_code.items(), key=lambda item: -len(item[1])):
        group = [f for findings_of_log in by_log.values() for f in findings_of_log]
        messages = dict.fromkeys(f.message for f in group)
        text = group[0].message if len(messages) == 1 else f"{catalogue()[code].title}."
        names = ", ".join(map(printable, by_log))
        place = names if len(by_log) <= _FEW_LOGS else f"{len(by_log)} logs"
        place = f"all {len(logs)} logs" if len(by_log) == len(logs) else place
        rows.setdefault(severity, []).append((_options(group), code, place, _channels(group), text))
    message(_listing(rows), quiet=not rows)


def show_failed(logs: Iterable[FailedLog], quiet: bool = False) -> None:
    """The failed logs on stderr, each with error and hint."""
    for log in logs:
        message(f"not analysed: {log.path}\n  error: {log.error}\n  hint: {log.hint}", quiet)


def _grouped(findings_shown: Sequence[Finding]) -> list[tuple[list[Finding], str]]:
    """The findings that share a line, each with what the line says."""
    by_code: dict[tuple[Severity, str], dict[str, list[Finding]]] = {}
    for f in findings_shown:
        by_code.setdefault((f.severity, f.code), {}).setdefault(f.message, []).append(f)
    groups: list[tuple[list[Finding], str]] = []
    for (_, code), by_message in by_code.items():
        if len(by_message) <= _LISTED_ALIKE:
            groups += [(group, message) for message, group in by_message.items()]
        else:
            all_of_code = [f for group in by_message.values() for f in group]
            groups.append((all_of_code, catalogue()[code].title))
    return groups


def _options(group: Sequence[Finding]) -> str:
    """What the remedy of warnings would have pasted: an option a line, never cut."""
    options = merge_zeros(x for f in group if f.severity != "info" and (x := f.option))
    lines = [f"      {printable(x)}" for x in options[:_MOST_OPTIONS]]
    missing = len(options) - len(lines)
    return "\n".join([*lines, f"      and {missing} more: see --json"] if missing else lines)


def merge_zeros(options: Iterable[str]) -> list[str]:
    """Each option once; zeros of one sensor that several logs show, as their mean.

    Where they differ by more than noise, each is an option of its own.
    """
    by_setting: dict[str, list[str]] = {}
    for option in dict.fromkeys(options):
        by_setting.setdefault(_ZERO.sub("", option), []).append(option)
    merged = []
    for of_logs in by_setting.values():
        columns = [*zip(*(map(float, _ZERO.findall(x)) for x in of_logs), strict=True)]
        means = [fmean(column) for column in columns]
        spreads = (max(column) - min(column) for column in columns)
        if len(of_logs) > 1 and all(
            spread < _ALIKE_ZEROS * abs(mean) for spread, mean in zip(spreads, means, strict=True)
        ):
            setting, *rest = _ZERO.split(of_logs[0])
            zeros = (f"{mean:.3g}{text}" for mean, text in zip(means, rest, strict=True))
            merged.append(setting + "".join(zeros))
        else:
            merged += of_logs
    return merged


def _channels(group: Sequence[Finding]) -> str:
    """As many channels as have room, at least one, and how many more there are."""
    names = list(dict.fromkeys(_channel(printable(f.channel)) for f in group if f.channel))
    count = len(names)
    while count > 1 and len(", ".join(names[:count])) > _CHANNEL:
        count -= 1
    suffix = f" and {len(names) - count} more" if count < len(names) else ""
    return ", ".join(names[:count]) + suffix


def _channel(text: str) -> str:
    """A channel with the end of its name, where the axle's number stands; or several channels."""
    return shortened(text, _CHANNEL, 0 if ", " in text else _CHANNEL // 2)


def lossy(findings_seen: Sequence[Finding]) -> bool:
    """Whether data was dropped, repaired or refused, or may be wrong: exit code 3."""
    return any(f.lossy for f in findings_seen)


def describe_logs(summaries: Sequence[ResultSummary]) -> str:
    """The log's path, or how many logs, and what they have in common or range over."""
    logs = [x.log for x in summaries]
    name = f"{printable(logs[0].path)}:\n" if len(logs) == 1 else f"{len(logs)} logs, "
    formats = ", ".join(dict.fromkeys(log.format for log in logs))
    seconds = " to ".join(dict.fromkeys(f"{f(x.duration_s for x in logs):.1f}" for f in (min, max)))
    axles = dict.fromkeys(", ".join(str(a.axle) for a in x.axles) for x in summaries)
    axle_text = "different axles"
    if len(axles) == 1:
        (numbers,) = axles
        axle_text = f"axle{'s' * (', ' in numbers)} {numbers}"
    used, read = sum(log.rows_used for log in logs), sum(log.rows_read for log in logs)
    motors = describe_motors(summaries)
    text = f"{name}{formats}, {seconds} s, {used} of {read} rows used, {axle_text}"
    return f"{text}\n{motors}" if motors else text


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


def wrote_sets(sets: Sequence[Sequence[str]]) -> str:
    """Which files were written of several logs, a line for each log, and for all of them."""
    lines, common_files = [], list[str]()
    for record, *other_files in sets:
        own_files = [
            x for x in other_files if Path(x).with_suffix("") == Path(record).with_suffix("")
        ]
        common_files += [x for x in other_files if x not in own_files]  # a table of all logs
        suffixes = [Path(other).suffix for other in (*own_files, "x.sha256")]
        lines.append(f"wrote {printable(record)}, {', '.join(suffixes)}")
    return "\n".join([*lines, *(f"wrote {printable(x)}" for x in common_files)])


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

    def advance(text: str) -> None:
        console.control(clear)
        console.print(Text(f"{printable(text)} …"), end="\r", no_wrap=True, overflow="ellipsis")

    return advance


def campaign(quiet: bool, logs: int) -> "Callable[[FleetProgress], None]":
    """Shows how far a run over many logs is, as `progress`."""
    show_text, begin, skipped = progress(quiet), 0.0, 0

    def advance(state: "FleetProgress") -> None:
        nonlocal begin, skipped
        failed = len(state.failed)
        ended = state.completed + state.skipped + failed
        if state.read < logs:
            show_text(f"reading {state.read} of {logs}")
            return
        if not begin:
            begin, skipped = time.monotonic(), ended
        rate = (ended - skipped) / max(time.monotonic() - begin, 1e-9)
        remaining = f", {(logs - ended) / rate:.0f} s left" if rate else ""
        show_text(f"analysed {ended} of {logs}: {rate:.1f} logs/s, {failed} failed{remaining}")

    return advance


def message(text: str, quiet: bool) -> None:
    """Text on stderr."""
    if not quiet:
        print("\n".join(map(printable, text.split("\n"))), file=sys.stderr)
