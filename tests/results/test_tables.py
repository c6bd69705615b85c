"""Tables of a result document: they hold what the document holds."""

from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from made_results import result
from pyarrow import parquet

from adhesion_cli.analysis.json_documents import entry
from adhesion_cli.results import tables


@pytest.fixture(scope="module")
def document() -> dict[str, Any]:
    return entry(result(), {})


def test_each_application_of_each_axle_is_a_row_with_the_numbers_of_the_document(
    document: dict[str, Any],
) -> None:
    rows = tables.applications([document]).to_pylist()
    given = [(a["axle"], x) for a in document["axles"] for x in a["applications"]]
    assert len(rows) == len(given) > 0
    for row, (axle, x) in zip(rows, given, strict=True):
        assert (row["log"], row["sha256"]) == (document["log"]["path"], document["log"]["sha256"])
        assert (row["axle"], row["start_s"]) == (axle, x["start_s"])
        assert row["force_n_mean_u95"] == x["force_n"]["mean_u95"]
        assert row["coefficient_max"] == x["coefficient"]["max"]
        ci = x["utilisation_ci"] or [None, None]
        assert [row["utilisation_ci_low"], row["utilisation_ci_high"]] == ci


def test_every_number_of_the_document_has_a_column(document: dict[str, Any]) -> None:
    """A key that is added to the document must be added to the schema."""
    axle = document["axles"][0]
    flat = tables._flat(axle["applications"][0])
    assert {"log", "sha256", "axle", *flat} == set(tables.APPLICATIONS.names)
    nis = {"mean": 0.8, "low": 0.9, "high": 1.1}
    score = dict(tables._joined({**axle["estimators"][0], "nis": nis}, ""))
    assert {"log", "sha256", "axle", *score} == set(tables.ESTIMATORS.names)
    nested = {"spans", "values", "names"}
    of_finding = document["findings"][0].keys() - nested
    assert {"log", "sha256", *of_finding} == set(tables.FINDINGS.names)
    assert document["log"].keys() - {"path"} < set(tables.LOGS.names)


def test_numbers_have_units() -> None:
    for schema in (tables.APPLICATIONS, tables.ESTIMATORS, tables.FINDINGS, tables.LOGS):
        numbers = [f for f in schema if pa.types.is_floating(f.type)]
        assert numbers
        assert all(f.metadata[b"unit"] for f in numbers)


def test_scores_and_findings_are_rows(document: dict[str, Any]) -> None:
    scores = tables.estimators([document, document])
    assert scores.num_rows == 2 * sum(len(a["estimators"]) for a in document["axles"]) > 0
    nis = {"mean": 0.8, "low": 0.9, "high": 1.1}
    axle = {"axle": 2, "estimators": [{"algo": "imm", "against": "truth", "nis": nis}]}
    (row,) = tables.estimators([{"log": {"path": "x"}, "axles": [axle]}]).to_pylist()
    assert (row["nis_mean"], row["nis_high"], row["axle"]) == (0.8, 1.1, 2)
    codes = tables.findings([document])["code"].to_pylist()
    assert codes == [f["code"] for f in document["findings"]]


def test_a_failed_log_is_a_row_without_results(document: dict[str, Any]) -> None:
    failed = {"log": {"path": "bad\udcff.csv"}, "error": "no pressure", "hint": "name it"}
    run = {"seconds": 1.5, "version": "1.0", "settings": "ab"}
    of = tables.logs(tables.log_row(x, **run) for x in (document, failed))
    good, bad = of.to_pylist()
    assert of.schema == tables.LOGS
    assert (good["status"], good["error"], good["start"].isoformat()) == (
        "damaged" if any(f["severity"] == "error" for f in document["findings"]) else "ok",
        None,
        document["log"]["start"].replace("Z", "+00:00"),
    )
    assert good["lossy"] == any(f["severity"] != "info" for f in document["findings"])
    (gap,) = tables.logs([tables.log_row({
        "log": {"path": "x"}, "findings": [{"code": "gap", "severity": "warning"}],
    })]).to_pylist()  # fmt: skip
    assert (gap["status"], gap["lossy"]) == ("ok", True)
    assert (bad["status"], bad["error"], bad["log"]) == ("error", "no pressure", "bad\\udcff.csv")
    assert tables.applications([failed]).num_rows == 0


def test_a_file_has_schema_units_and_equal_bytes(tmp_path: Path, document: dict[str, Any]) -> None:
    files = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    for file in files:
        tables.write(file, tables.applications([document]))
    assert files[0].read_bytes() == files[1].read_bytes()
    read = parquet.read_table(files[0])
    assert read.schema.equals(tables.APPLICATIONS, check_metadata=False)
    assert read.schema.field("force_n_mean").metadata[b"unit"] == b"N"
