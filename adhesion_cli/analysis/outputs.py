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
) -> None:
    """Writes record and recording of one analysed log, or of several together.

    `places` are those of the MCAP and of the Rerun recording. `slip` is the document on the slip of
    one log, `notes` the texts on that of its axles, each with its rail.
    """
    from ..core.document import embedded
    from ..results import mcap, rrd

    record, recording = places
    mcap.write_results(record, results, embedded(summaries), slip)
    rrd.write_results(recording, results, notes, summaries)


def write_report(place: Path, record: Path, name: str) -> None:
    """Writes the report of a record.

    The record is the MCAP that `write_results` wrote; it will have this name.
    """
    from ..results.report import page, run

    place.write_bytes(page.page([run.read(record, name)]).encode())
