"""The JSON documents that other programs read; their keys are a contract."""

from collections.abc import Sequence
from pathlib import Path

from ..core.annotated import Json, as_json
from ..core.document import dumps, tagged
from ..core.summary import FailedLog, ResultSummary


def result_document(results: Sequence[ResultSummary | FailedLog]) -> Json:
    """The `adhesion.result/1` document."""
    return tagged("result", results=[_entry(one) for one in results])


def _entry(one: ResultSummary | FailedLog) -> Json:
    if isinstance(one, FailedLog):
        return {"log": {"path": one.path}, "error": one.error, "hint": one.hint}
    entry: Json = as_json(one)
    return entry


def embedded(results: Sequence[ResultSummary]) -> str:
    """The document as a result file carries it: by file names, wherever the files lie."""
    entries = [_entry(one) for one in results]
    for entry in entries:
        del entry["outputs"]
        entry["log"] |= {"path": Path(entry["log"]["path"]).name}
    return dumps(tagged("result", results=entries))
