"""The output files of a run appear complete under their names, or not at all.

Until everything is written, checked and on the disk, a file lies in a hidden folder beside its
target. The end of the run removes that folder; if the run was killed, the next run does. No file is
open when it gets its name or is removed: Windows allows neither.

A run may write several sets, one for each log, and a file of a set may lie in another folder. The
manifest lies in the folder of the set's first file and names the others from there.

Several files cannot get their names at once. The first file of all is the record. To replace older
files, first their manifests go and all of them except the record. Then the record is replaced,
then the others appear, and the manifests last:

    old record, old others, manifest → old record → new record → new record, new others, manifest

A killed run, or a disk that refuses a name, leaves one of these states. New and old files are
never mixed, no file is incomplete, and a manifest (`<stem>.sha256`, for `sha256sum -c`) exists only
if the whole run is complete. A signal that ends a run waits meanwhile.
"""

import hashlib
import os
import re
import shutil
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from itertools import chain
from pathlib import Path

from filelock import FileLock

from ..core.cache_folder import cache_folder
from ..core.errors import UserError
from ..core.text import as_url, printable

_HIDDEN = ".adhesion-"
_LOCK = "lock"  # a file in the hidden folder, locked as long as its run lives
_ELSEWHERE = "write to another folder"
_UNLOCKED_AGE = 60.0  # age of a hidden folder that its run may not have locked yet [s]
_WINDOWS_REFUSES = re.compile(
    r'[<>:"|?*\x00-\x1f]|[. ]$|^(con|prn|aux|nul|com\d|lpt\d)(\.|$)', re.IGNORECASE
)
_PATIENCE = 2.0  # for another program that holds a result open [s]
_PAUSE = 0.05  # between two tries [s]
_MANIFEST_HEAD = "# adhesion: written last, when the files below were whole\n"  # a comment


def check(paths: Sequence[Path], force: bool, *, inputs: Sequence[Path] = ()) -> None:
    """Refuse before the long work what could not be written after it.

    `inputs` are what the run reads, which must survive.

    Raises:
        UserError: a target is a URL, its folder is missing or read-only, a result exists already,
            an output is an input (by whatever name), or two outputs have one name.
    """
    checked: set[str] = set()
    for path in paths:
        refuse_url(path)
        file_name, folder = printable(str(path)), printable(str(path.parent))
        place = str(path.parent.resolve() / path.name)
        if sys.platform != "linux":  # disks there do not tell capitals from small letters
            place = place.casefold()
        if place in checked:
            hint = "run several logs one by one, each with its own --out"
            raise UserError(f"{file_name}: two results of this run would have this name", hint)
        checked.add(place)
        if sys.platform == "win32" and _WINDOWS_REFUSES.search(path.name):
            text = f"{file_name}: Windows does not allow this name for a file"
            raise UserError(text, 'choose another name, without any of < > : " | ? *')
        if not path.parent.is_dir():
            raise UserError(f"{folder}: no such folder", "create it, or write elsewhere")
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise UserError(f"{folder}: the folder cannot be written to", _ELSEWHERE)
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "a pipe or a device, not a file"
            raise UserError(f"{file_name}: is {kind}", _ELSEWHERE)
        if any(path.exists() and x.exists() and path.samefile(x) for x in inputs):
            raise UserError(f"{file_name}: is the input itself", _ELSEWHERE)
    if not force:
        _refuse_existing(paths)


def refuse_url(path: Path) -> None:
    """Refuses, by a UserError, a URL, which would become a folder with the name `s3:`."""
    if url := as_url(path):
        hint = "write to a folder of this machine, and copy the results from there"
        raise UserError(f"{printable(url)}: results cannot be written to a URL", hint, code=2)


@contextmanager
def folder(target: Path) -> Iterator[None]:
    """Makes a folder for results, or raises a UserError; removes it again if it stays empty."""
    refuse_url(target)
    if target.exists() and not target.is_dir():
        hint = "name a folder with --out, a new one or one that exists"
        raise UserError(f"{printable(str(target))}: is a file, not a folder", hint)
    created = [p for p in (target, *target.parents) if not p.exists()]
    try:
        if created:
            target.mkdir(parents=True)
    except OSError as error:
        text = f"{printable(str(target))}: the folder cannot be made ({error.strerror})"
        raise UserError(text, "choose another with --out") from error
    try:
        yield
    finally:
        for directory in created:
            with suppress(OSError):  # it holds the results
                directory.rmdir()


@contextmanager
def outputs(
    paths: Sequence[Path], force: bool, *, inputs: Sequence[Path] = ()
) -> Iterator[list[Path]]:
    """Places to write to; on leaving without an exception they get their names, all or none.

    With several files a manifest of their SHA-256 is written to the same folder. The first path is
    the record that the others are made from. `inputs` are what the run reads, which must survive.
    The places have no suffix.

    Raises:
        UserError: as `check`, or the disk is full, fails or refuses.
    """
    with sets([paths], force, inputs=inputs) as (places,):
        yield places


@contextmanager
def sets(
    path_sets: Sequence[Sequence[Path]],
    force: bool,
    *,
    inputs: Sequence[Path] = (),
    sweeps: bool = True,
) -> Iterator[list[list[Path]]]:
    """Several sets of `outputs`, as there: none appears before all are written and on the disk.

    Without `sweeps`, what killed runs left stays: a folder with many files takes long.
    """
    targets = [path for paths in path_sets for path in paths]
    check(targets, force, inputs=inputs)
    folders = list(dict.fromkeys(path.parent for path in targets))
    try:
        if sweeps:
            sweep(folders)
        with ExitStack() as stack:
            hidden = {folder: stack.enter_context(_hidden_folder(folder)) for folder in folders}
            place_sets = [[hidden[p.parent] / p.name for p in paths] for paths in path_sets]
            yield [list(places) for places in place_sets]  # theirs to change
            files = dict(zip(targets, chain(*place_sets), strict=True))
            for paths, places in zip(path_sets, place_sets, strict=True):
                if len(paths) > 1:
                    target = manifest(paths[0])
                    place = files[target] = hidden[target.parent] / target.name
                    directory = target.parent.resolve()
                    relative_paths = (
                        os.path.relpath(p.parent.resolve() / p.name, directory) for p in paths
                    )
                    text = _MANIFEST_HEAD + "".join(map(_line, relative_paths, places))
                    place.write_bytes(os.fsencode(text))
            for place in files.values():  # one by one: an interrupt would wait for threads
                with place.open("r+b") as file:  # Windows wants a file that is open for writing
                    os.fsync(file.fileno())
            with _publishing(), _uninterrupted():
                manifests = [manifest(paths[0]) for paths in path_sets if paths]
                stale = [path for path in manifests if _is_manifest(path)]
                if not force:  # another run was faster, or somebody else's manifest
                    _refuse_existing([path for path in files if path not in stale])
                check_closed([*stale, *files])
                for path in [*stale, *reversed([*files][1:])]:  # all but the record
                    path.unlink(missing_ok=True)
                for path, place in files.items():
                    _patiently(path, partial(place.replace, path))
    except OSError as error:
        names = printable(", ".join(map(str, folders)))
        text = f"{names}: cannot write the results ({error.strerror or error})"
        raise UserError(text, f"free space there, or {_ELSEWHERE}") from error


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Signals that end a run come when this is done."""
    signals: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():
        for number in (signal.SIGINT, signal.SIGTERM):
            if callable(signal.getsignal(number)):
                handlers[number] = signal.signal(number, lambda number, _: signals.append(number))
    try:
        yield
    finally:
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if signals:
        signal.raise_signal(signals[0])


def sweep(folders: Sequence[Path]) -> None:
    """Remove the hidden folders of killed runs: no process locks them, and they are not new."""
    for path in (path for folder in folders for path in folder.glob(f"{_HIDDEN}*")):
        with suppress(OSError):
            if time.time() - path.stat().st_mtime > _UNLOCKED_AGE:
                with FileLock(path / _LOCK, blocking=False):
                    pass
                shutil.rmtree(path)


@contextmanager
def _hidden_folder(folder: Path) -> Iterator[Path]:
    """A folder in this one that vanishes at the end, with what is still in it."""
    path = Path(tempfile.mkdtemp(prefix=_HIDDEN, dir=folder))
    lock = FileLock(path / _LOCK, thread_local=False)
    try:
        with suppress(OSError, NotImplementedError):  # a file system without locks
            lock.acquire(blocking=False)
        yield path
    finally:
        with _uninterrupted():
            lock.release()
            shutil.rmtree(path, ignore_errors=True)  # what stays, the next run removes


@contextmanager
def _publishing() -> Iterator[None]:
    """Keeps the other runs of this user from publishing meanwhile."""
    with ExitStack() as stack:
        with suppress(OSError, NotImplementedError):  # a file system without locks
            stack.enter_context(FileLock(cache_folder() / "publishing.lock"))
        yield


def check_closed(paths: Iterable[Path]) -> None:
    """Refuses, by a UserError, to replace files of which another program holds one open."""
    for path in filter(os.path.lexists, paths):
        _patiently(path, partial(os.rename, path, path))


def _patiently(path: Path, action: Callable[[], object]) -> None:
    """Does something to a result that another program may hold open, as Windows lets it."""
    end = time.monotonic() + _PATIENCE
    while True:
        try:
            action()
        except PermissionError as error:
            if sys.platform != "win32":
                raise
            if time.monotonic() > end:
                text = f"{printable(str(path))}: another program has this file open"
                hint = "close it there (viewer, Excel, virus scanner), then run again"
                raise UserError(text, hint) from error
            time.sleep(_PAUSE)
        else:
            return


def belong_together(paths: Sequence[Path]) -> bool:
    """Whether a manifest lists these files of one set with the content they have now."""
    try:
        manifest_text = os.fsdecode(manifest(paths[0]).read_bytes())
        listed = set(manifest_text.removeprefix(_MANIFEST_HEAD).splitlines(keepends=True))
        return manifest_text.startswith(_MANIFEST_HEAD) and all(
            _line(p.name, p) in listed for p in paths
        )
    except FileNotFoundError:
        return False


def manifest(path: Path) -> Path:
    """The manifest of the set whose first file this is."""
    return path.with_suffix(".sha256")


def _line(name: str, place: Path) -> str:
    with place.open("rb") as content:
        return f"{hashlib.file_digest(content, 'sha256').hexdigest()}  {name}\n"


def _is_manifest(path: Path) -> bool:
    """Whether this is a manifest that we wrote."""
    try:
        return path.read_bytes().startswith(os.fsencode(_MANIFEST_HEAD))
    except OSError:  # none, as a rule
        return False


def _refuse_existing(paths: Sequence[Path]) -> None:
    for path in paths:
        if os.path.lexists(path):
            hint = "add --force to replace it, or write elsewhere"
            raise UserError(f"{printable(str(path))}: exists already", hint)
