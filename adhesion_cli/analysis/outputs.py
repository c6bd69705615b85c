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


def write_results(
    places: Sequence[Path],
    results: "Sequence[Result]",
    summaries: "Sequence[ResultSummary]",
    slip: str = "",
    notes: "Sequence[Note]" = (),
    every_sample: bool = False,
) -> None:
    """Writes record and recording of one analysed log, or of several together.

    Args:
        places: where to write the MCAP and the Rerun recording.
        results: the analysed logs.
        summaries: from `summarise`.
        slip: the document on the slip of one log, if that was asked for.
        notes: text on the slip of each of its axles, with its rail.
        every_sample: whether the files of a long log have every computed sample.
    """
    from ..results import mcap, rrd
    from .json_documents import embedded

    record, recording = places
    mcap.write_results(record, results, embedded(summaries), slip, every_sample)
    rrd.write_results(recording, results, notes, every_sample, summaries)


def write_report(place: Path, record: Path, name: str) -> None:
    """Writes the report of a record.

    Args:
        place: where to write the page.
        record: the MCAP that was written by `write_results`.
        name: that the record will have.
    """
    from ..results import verified
    from ..results.report import page, run

    verified.write(place, page.page([run.read(record, name)]))
