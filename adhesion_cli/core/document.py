"""The JSON documents that other programs read: schema, numbers that JSON knows, ASCII.

Their keys are a contract.
"""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .annotated import Json, as_json
from .finding import Finding
from .summary import FailedLog, ResultSummary, summarise_finding
from .text import utf8


def tagged(kind: str, **body: Any) -> Json:
    """A document of this kind; what the run wrote stands in its `outputs`, by format."""
    return {"schema": f"adhesion.{kind}/1", **body}


def findings_document(findings: Sequence[Finding]) -> list[Json]:
    """Findings as the JSON names them."""
    return [as_json(summarise_finding(f)) for f in findings]


def finite(value: float) -> float | None:
    """The number, None where JSON has none for it."""
    return value if math.isfinite(value) else None


def dumps(document: Json) -> str:
    """A document as JSON in ASCII, for any terminal; a NaN in it is an error and raises.

    A file name that is not UTF-8 has codes for the bytes that are none, as no JSON holds them.
    """
    text = json.dumps(_utf8(document), indent=1, allow_nan=False)
    return text.replace("\x7f", "\\u007f")  # the one control character that JSON leaves


def _utf8(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: _utf8(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_utf8(v) for v in value]
    return utf8(value) if isinstance(value, str) else value


def result_document(results: Sequence[ResultSummary | FailedLog]) -> Json:
    """The `adhesion.result/1` document."""
    return tagged("result", results=[_entry(result) for result in results])


def _entry(result: ResultSummary | FailedLog) -> Json:
    if isinstance(result, FailedLog):
        return {"log": {"path": result.path}, "error": result.error, "hint": result.hint}
    entry: Json = as_json(result)
    return entry


def embedded(results: Sequence[ResultSummary]) -> str:
    """The document as a result file carries it: by file names, wherever the files lie."""
    entries = [_entry(result) for result in results]
    for entry in entries:
        del entry["outputs"]
        entry["log"] |= {"path": Path(entry["log"]["path"]).name}
    return dumps(tagged("result", results=entries))
