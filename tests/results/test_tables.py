"""Tables of a result document: they hold what the document holds."""

from dataclasses import replace
from pathlib import Path

import pyarrow as pa
import pytest
from helpers.made_results import result
from pyarrow import parquet

from adhesion_cli.analysis.summarise import summarise
from adhesion_cli.core.annotated import as_json, from_json
from adhesion_cli.core.model import Nis
from adhesion_cli.core.summary import FailedLog, ResultSummary
from adhesion_cli.results import tables


@pytest.fixture(scope="module")
def summary() -> ResultSummary:
    return summarise(result(), {})


def findings(of: ResultSummary) -> pa.Table:
    return tables.of_results("findings", [of])


def test_each_application_of_each_axle_is_a_row_with_the_numbers_of_the_document(
    summary: ResultSummary,
) -> None:
    rows = tables.of_results("applications", [summary]).to_pylist()
    document = as_json(summary)
    given = [(a["axle"], x) for a in document["axles"] for x in a["applications"]]
    assert len(rows) == len(given) > 0
    for row, (axle, x) in zip(rows, given, strict=True):
        assert (row["log"], row["sha256"]) == (document["log"]["path"], document["log"]["sha256"])
        assert (row["axle"], row["start_s"]) == (axle, x["start_s"])
        assert row["force_n_mean_u95"] == x["force_n"]["mean_u95"]
        assert row["coefficient_max"] == x["coefficient"]["max"]
        ci = x["utilisation_ci"] or [None, None]
        assert [row["utilisation_ci_low"], row["utilisation_ci_high"]] == ci


def test_a_summary_is_read_back_from_its_json(summary: ResultSummary) -> None:
    again = from_json(ResultSummary, as_json(summary))
    assert as_json(again) == as_json(summary)
    assert again.log == summary.log
    assert again.axles[0].applications[0].force_n == summary.axles[0].applications[0].force_n
    lacking = as_json(summary)
    del lacking["axles"][0]["applications"][0]["force_n"]
    with pytest.raises(KeyError, match="force_n"):
        from_json(ResultSummary, lacking)


def test_numbers_have_units() -> None:
    for schema in (tables.APPLICATIONS, tables.ESTIMATORS, tables.FINDINGS, tables.LOGS):
        numbers = [f for f in schema if pa.types.is_floating(f.type)]
        assert numbers
        assert all(f.metadata[b"unit"] for f in numbers)


def test_scores_and_findings_are_rows(summary: ResultSummary) -> None:
    scores = tables.of_results("estimators", [summary, summary])
    assert scores.num_rows == 2 * sum(len(a.estimators) for a in summary.axles) > 0
    first = summary.axles[0]
    score = replace(first.estimators[0], nis=Nis(0.8, 0.9, 1.1))
    axle = first._replace(axle=2, estimators=(score,))
    (row,) = tables.of_results("estimators", [replace(summary, axles=(axle,))]).to_pylist()
    assert (row["nis_mean"], row["nis_high"], row["axle"]) == (0.8, 1.1, 2)
    codes = findings(summary)["code"].to_pylist()
    assert codes == [f.code for f in summary.findings]


def test_a_failed_log_is_a_row_without_results(summary: ResultSummary) -> None:
    failed = FailedLog("bad\udcff.csv", "no pressure", "name it")
    rows = [
        replace(tables.log_row(x), seconds=1.5, version="1.0", settings="ab")
        for x in (summary, failed)
    ]
    of = tables.table(rows, tables.LOGS)
    good, bad = of.to_pylist()
    assert of.schema == tables.LOGS
    assert summary.log.start is not None
    assert (good["status"], good["error"], good["start"].isoformat()) == (
        "damaged" if any(f.severity == "error" for f in summary.findings) else "ok",
        None,
        summary.log.start.replace("Z", "+00:00"),
    )
    assert good["lossy"] == any(f.severity != "info" for f in summary.findings)
    warned = replace(
        summary, findings=(replace(summary.findings[0], code="gap", severity="warning"),)
    )
    (gap,) = tables.table([tables.log_row(warned)], tables.LOGS).to_pylist()
    assert (gap["status"], gap["lossy"]) == ("ok", True)
    assert (bad["status"], bad["error"], bad["log"]) == ("error", "no pressure", "bad\\udcff.csv")


def test_a_file_has_schema_units_and_equal_bytes(tmp_path: Path, summary: ResultSummary) -> None:
    files = [tmp_path / "a.parquet", tmp_path / "b.parquet"]
    for file in files:
        file.write_bytes(tables.packed(tables.of_results("applications", [summary])))
    assert files[0].read_bytes() == files[1].read_bytes()
    read = parquet.read_table(files[0])
    assert read.schema.equals(tables.APPLICATIONS, check_metadata=False)
    assert read.schema.field("force_n_mean").metadata[b"unit"] == b"N"
