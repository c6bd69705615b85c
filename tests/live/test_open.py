"""What is no source, and options that do not fit one."""

from pathlib import Path

import pytest
from helpers.live_runs import lines_of, running

from adhesion_cli.analysis.settings import load
from adhesion_cli.core.errors import UserError
from adhesion_cli.live.open import open_feed


@pytest.mark.parametrize(
    "arguments",
    [
        ["-", "--connect", "foo"],
        ["-", "--connect", "rerun+http://127.0.0.1:99999/proxy"],
        ["-", "--dbc", "no.dbc"],
        ["-", "-o", "file.txt"],
        ["."],
        ["udp://127.0.0.1:99999"],
    ],
)
def test_wrong_arguments_are_refused_with_a_remedy(tmp_path: Path, arguments: list[str]) -> None:
    (tmp_path / "file.txt").touch()
    with running(tmp_path, *arguments, "--json") as process:
        out, _ = process.communicate("", timeout=60)
    (error,) = lines_of(out)
    code = 1 if "-o" in arguments else 2  # as every command says of -o
    assert (process.returncode, error["schema"]) == (code, "adhesion.error/1")
    assert "internal error" not in str(error["error"])
    assert error["hint"]


@pytest.mark.parametrize(
    ("source", "says"),
    [
        ("no.csv", "no such file"),
        ("tcp://127.0.0.1:1", "no source of this kind"),
        ("udp://127.0.0.1:0", "no port"),
        ("udp://127.0.0.1:x", "no port"),
        ("udp://192.0.2.1:5005", "cannot listen"),
        ("log.parquet", "--replay"),
    ],
)
def test_what_is_no_source_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, says: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("log.parquet").write_bytes(b"PAR1 and more")
    with pytest.raises(UserError) as told:
        open_feed(source, load().read)
    assert says in f"{told.value.text} {told.value.hint}"
