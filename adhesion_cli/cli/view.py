"""`adhesion view`: a result in the Rerun viewer."""

import os
import re
import shutil
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any
from zlib import crc32

import typer

from ..core.errors import UserError
from ..core.text import shell_word
from .options import Shared, check_display, no_window_error, option, shared

if TYPE_CHECKING:
    import subprocess

_PORTS = 9090, 9876  # of page and data, as Rerun has them
# The viewer's program in its package, on macOS, Windows and Linux.
_PROGRAMS = "Rerun.app/Contents/MacOS/Rerun", "rerun.exe", "rerun"
_STARTS = 2.0  # after which a viewer that runs has opened its window [s]
_WRITES = "`adhesion analyze LOG` writes one"
_ESTIMATE = re.compile(r"/axle/\d+/estimate/")  # of a result; a comparison's begin with the log


@shared()
def command(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Result: .mcap or .rrd.")],
    shared: Shared,
    serve: Annotated[
        bool, option("--serve", None, "Show it in a browser: serve on this computer until Ctrl-C.")
    ] = False,
) -> int:
    """Open a result in the Rerun viewer, in its saved layout.

    The .rrd of an analysis is written again if it is missing or belongs to another result.

    Example: adhesion view service-brake.adhesion.mcap
    """
    from ..results import atomic_files
    from . import terminal

    recording, kind = result.with_suffix(".rrd"), result.suffix.lower()
    if kind not in (".mcap", ".rrd"):
        hint = _view(recording) if recording.is_file() else _WRITES
        raise UserError(f"{result}: not a result, which is an .mcap or .rrd file", hint, code=2)
    if not result.is_file():
        raise UserError(f"{result}: no such file", _WRITES)
    if not serve:
        check_display(f"{_view(result)} --serve")
    if kind == ".mcap" and not atomic_files.belong_together([result, recording]):
        _remake(result, recording, terminal.progress(shared.quiet))
    (serve_recording if serve else show_recording)(recording)
    return 0


def _remake(result: Path, recording: Path, progress: Callable[[str], None]) -> None:
    """Writes the recording of one analysed log again, with the settings that the result holds."""
    from ..analysis import analyze, settings
    from ..analysis.summarise import summarise
    from ..core.estimator import registry
    from ..formats.open import open_source
    from ..formats.source import ReadOptions
    from ..results import atomic_files, names, rrd

    source = open_source(result, ReadOptions())
    carried = settings.nested(source.metadata.get(names.SETTINGS, {}))
    ran = {f.channel.rpartition("/")[2] for f in source.fields if _ESTIMATE.match(f.channel)}
    if not carried or not ran:
        hint = f"write both again by the command that wrote it, with --force; or view {recording}"
        raise UserError(f"{result}: {recording.name} is missing, or was not made from it", hint)
    algos = [name for name in registry() if name in ran]
    analysed = analyze.analyze(
        result, settings.load(folder=False), algos, progress=progress, train_speed=True
    )
    with atomic_files.outputs([result, recording], force=True) as (record, picture):
        shutil.copyfile(result, record)
        rrd.write_results(picture, [analysed], summaries=[summarise(analysed, {})])


def show_recording(recording: Path) -> None:
    """Starts the viewer on a recording and returns; a UserError where the viewer ends at once."""
    _started(_rerun(str(_with_drawable_name(recording))), f"{_view(recording)} --serve")


def _with_drawable_name(recording: Path) -> Path:
    """The recording, by another name where the viewer would end, as it cannot draw the name."""
    from ..core.cache_folder import cache_folder
    from ..results.rrd.glyphs import drawable

    if drawable(recording.name) == recording.name:
        return recording
    folder = cache_folder() / "viewer"
    folder.mkdir(exist_ok=True)
    other_name = folder / f"log-{crc32(str(recording.resolve()).encode()):08x}.rrd"
    other_name.unlink(missing_ok=True)
    try:
        os.link(recording, other_name)
    except OSError:  # another file system, or one without links
        shutil.copyfile(recording, other_name)
    return other_name


def start_viewer() -> str:
    """Starts an empty viewer, as `show_recording`; returns the address that it listens to."""
    port = _is_free(_PORTS[1])
    _started(_rerun("--port", str(port)), "adhesion live SOURCE -o DIR")
    return f"rerun+http://127.0.0.1:{port}/proxy"


def _started(command: list[str], serves: str) -> None:
    import subprocess

    viewer = _start_program(command, stderr=subprocess.DEVNULL)
    try:
        code = viewer.wait(_STARTS)
    except subprocess.TimeoutExpired:
        return
    if code:
        raise no_window_error(f"it ended with exit code {code}", serves)


def serve_recording(recording: Path) -> None:
    """Serves a recording to browsers of this computer; a UserError where the server ends."""
    from ..core.children import STEP

    page, data = map(_is_free, _PORTS)
    url = f"http://127.0.0.1:{page}?url=rerun%2Bhttp%3A%2F%2F127.0.0.1%3A{data}%2Fproxy"
    print(f"open {url}\nCtrl-C ends it", flush=True)
    ports = ["--serve-web", "--web-viewer-port", str(page), "--port", str(data)]
    server = _start_program(_rerun(str(recording), *ports), env={**os.environ, "RUST_LOG": "error"})
    try:
        while (code := server.poll()) is None:
            time.sleep(STEP)
    finally:
        server.terminate()
        server.wait()
    raise UserError(f"{recording}: the server ended with exit code {code}")


def _rerun(*arguments: str) -> list[str]:
    """The viewer's own program with these arguments: ending it leaves no process behind."""
    spec = find_spec("rerun_cli")
    assert spec is not None
    assert spec.origin is not None
    folder = Path(spec.origin).parent
    program = next(p for name in _PROGRAMS if (p := folder / name).is_file())
    return [str(program), "--bind", "127.0.0.1", *arguments]


def _view(result: Path) -> str:
    return f"adhesion view {shell_word(str(result))}"


def _is_free(port: int) -> int:
    """This port, or another one if it is in use."""
    import socket

    with socket.socket() as tried:
        try:
            tried.bind(("127.0.0.1", port))
        except OSError:
            tried.bind(("127.0.0.1", 0))
        return int(tried.getsockname()[1])


def _start_program(command: list[str], **options: Any) -> "subprocess.Popen[bytes]":
    """Starts a program that an interrupt of this one (Ctrl-C) does not reach."""
    import subprocess

    null = subprocess.DEVNULL
    if sys.platform == "win32":
        flags = subprocess.CREATE_NEW_PROCESS_GROUP | subprocess.CREATE_NO_WINDOW
        return subprocess.Popen(command, stdin=null, stdout=null, creationflags=flags, **options)
    return subprocess.Popen(command, stdin=null, stdout=null, start_new_session=True, **options)
