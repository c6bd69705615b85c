"""`export-c`: what a folder holds already, and names that cannot be exported."""

from pathlib import Path

from helpers.commands import Run


def test_a_second_export_does_not_replace_the_first(run: Run, tmp_path: Path) -> None:
    folder = tmp_path / "bcu"
    folder.mkdir()
    assert run("export-c", "td", "-o", folder, "-q").returncode == 0
    before = {path: path.read_bytes() for path in folder.iterdir()}
    refused = run("export-c", "leso", "-o", folder)
    assert refused.returncode == 1
    assert "Makefile: exists already" in refused.stderr
    assert {path: path.read_bytes() for path in folder.iterdir()} == before
    assert run("export-c", "td", "-o", folder, "--force", "-q").returncode == 0


def test_a_control_law_without_parameters_is_not_taken_for_another(run: Run) -> None:
    refused = run("export-c", "none")
    assert refused.returncode == 2
    assert "neso'" not in refused.stderr
    assert "kalman" in refused.stderr
