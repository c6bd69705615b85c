"""`adhesion view`: what it refuses, and the server for a browser."""

import re
import signal
import subprocess
import time
import urllib.request
from contextlib import suppress
from pathlib import Path
from urllib.error import URLError

import pytest
from helpers.forked import Forked
from helpers.made_results import result

from adhesion_cli.cli import view
from adhesion_cli.cli.app import app
from adhesion_cli.core.errors import UserError
from adhesion_cli.results import rrd


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording and what lies beside it, on a computer without a display."""
    for name in ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.chdir(tmp_path)
    rrd.write_results(tmp_path / "a b.rrd", [result(1, 50)])
    (tmp_path / "a b.sha256").touch()
    (tmp_path / "log.csv").touch()
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "code", "text", "hint"),
    [
        (["view", "a b.sha256"], 2, "a b.sha256", 'adhesion view "a b.rrd"'),
        (["view", "log.csv"], 2, "log.csv", "`adhesion analyze LOG` writes one"),
        (["view", "no.mcap"], 1, "no.mcap: no such file", "`adhesion analyze LOG` writes one"),
        (["view", "a b.rrd"], 1, "no display", '`adhesion view "a b.rrd" --serve`'),
        (["analyze", "log.csv", "--view"], 1, "no display", "`adhesion view RESULT --serve`"),
    ],
)
def test_what_cannot_be_shown_is_an_error_with_the_command_that_works(
    folder: Path, arguments: list[str], code: int, text: str, hint: str
) -> None:
    with pytest.raises(UserError) as raised:
        app(arguments, standalone_mode=False)
    assert raised.value.code == code
    assert text in raised.value.text
    assert hint in raised.value.hint


def test_a_display_that_does_not_work_is_an_error(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":7777")
    monkeypatch.setattr("adhesion_cli.cli.view._STARTS", 30.0)
    # At the usual port another test may have a server, which would take the recording.
    port = ["--port", str(view._is_free(0))]
    command = view._rerun(*port)
    monkeypatch.setattr("adhesion_cli.cli.view._rerun", lambda *arguments: [*command, *arguments])
    with pytest.raises(UserError, match="exit code 1") as raised:
        app(["view", "a b.rrd"], standalone_mode=False)
    assert "--serve" in raised.value.hint


def test_a_browser_is_served_until_the_run_ends(folder: Path) -> None:
    served = Forked(folder, ["view", "a b.rrd", "--serve"], stdout=subprocess.PIPE)
    assert served.stdout is not None
    try:
        page = re.findall(r"http://127\.0\.0\.1:\d+", served.stdout.readline())[0]
        for _ in range(100):
            with suppress(OSError):
                assert b"Rerun" in urllib.request.urlopen(page).read(300)
                break
            time.sleep(0.1)
        else:
            pytest.fail("no server")
    finally:
        served.send_signal(signal.SIGINT)
        try:
            served.communicate(timeout=20)
        finally:
            served.kill()
    assert served.returncode == 130
    with pytest.raises(URLError):
        urllib.request.urlopen(page)


def test_a_name_that_the_viewer_cannot_draw_is_replaced(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("adhesion_cli.core.cache_folder.cache_folder", lambda: folder)
    assert view._with_drawable_name(folder / "a b.rrd") == folder / "a b.rrd"
    named = (folder / "a b.rrd").rename(folder / "制动.rrd")
    for _ in range(2):  # the older link is replaced
        shown = view._with_drawable_name(named)
        assert shown.name.isascii()
        assert shown.read_bytes() == named.read_bytes()
