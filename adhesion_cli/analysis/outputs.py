"""The files that a run writes: their names, and what is in them."""

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.text import stem as stem

if TYPE_CHECKING:
    from ..core.model import Result
    from ..core.summary import ResultSummary
    from ..results.rrd.results import Note

Pair = tuple[Path, Path]


def pair(folder: Path, log: str | Path, kind: str) -> Pair:
    """The two files of a log in a folder: `<stem>.<kind>.mcap` and `.rrd`."""
    return folder / f"{stem(log)}.{kind}.mcap", folder / f"{stem(log)}.{kind}.rrd"


def named(files: Sequence[Path]) -> dict[str, str]:
    """The outputs as the JSON names them: by format."""
    return {file.suffix.removeprefix(".").lower(): str(file) for file in files}


def write_result(
    places: Sequence[Path],
    result: "Result",
    summary: "ResultSummary",
    slip: str = "",
    notes: "Sequence[Note]" = (),
    every_sample: bool = False,
) -> None:
    """Writes record and recording of one analysed log.

    Args:
        places: where to write the MCAP and the Rerun recording.
        result: the analysed log.
        summary: from `summarise`.
        slip: the document on its slip, if that was asked for.
        notes: text on the slip of each axle, with its rail.
        every_sample: whether the files of a long log have every computed sample.
    """
    from ..results import mcap, rrd
    from .json_documents import embedded

    record, recording = places
    mcap.write_result(record, result, embedded([summary]), slip, every_sample)
    rrd.write_result(recording, result, notes, every_sample, summary)


def write_comparison(
    places: Sequence[Path],
    results: "Sequence[Result]",
    summaries: "Sequence[ResultSummary]",
    every_sample: bool = False,
) -> None:
    """Writes record and recording of several analysed logs, see `write_result`."""
    from ..results import mcap, rrd
    from .json_documents import embedded

    record, recording = places
    mcap.write_comparison(record, results, embedded(summaries), every_sample)
    rrd.write_comparison(recording, results, every_sample)


def write_report(place: Path, record: Path, name: str) -> None:
    """Writes the report of a record.

    Args:
        place: where to write the page.
        record: the MCAP that was written by `write_result`.
        name: that the record will have.
    """
    from ..results import verified
    from ..results.report import page, run

    verified.write(place, page.page([run.read(record, name)]))
