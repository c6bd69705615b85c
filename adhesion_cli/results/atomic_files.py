"""The output files of a run appear complete under their names, or not at all.

A file is a hidden one in the folder of its target until everything is written, checked and on the
disk. The end of the run removes it; if the run was killed, the next run does.

A run may write several sets, one for each log, and a file of a set may lie in another folder. The
manifest lies in the folder of the set's first file and names the others from there.

Several files cannot get their names at once. The first file of all is the record. To replace older
files, first their manifests go and all of them except the record. Then the record is replaced,
then the others appear, and the manifests last:

    old record, old others, manifest → old record → new record → new record, new others, manifest

A killed run leaves one of these states. New and old files are never mixed, no file is incomplete,
and a manifest (`<stem>.sha256`, for `sha256sum -c`) exists only if the whole run is complete. A
signal that ends a run waits meanwhile. If the disk refuses a name, the run removes those it gave,
and the older files come back: until the end each has a second, hidden name.
"""

import fcntl
import hashlib
import os
import secrets
import shutil
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from ..core.errors import UserError
from ..core.text import as_url, printable
from .verified import verified

_HIDDEN = ".adhesion-"
_ELSEWHERE = "write to another folder"
_UNLOCKED_AGE = 60.0  # age of a hidden file that its run may not have locked yet [s]
_MANIFEST_HEAD = (
    "# adhesion: written last, when the files below were whole\n"  # a comment to sha256sum
)


def check(paths: Sequence[Path], force: bool, *, inputs: Sequence[Path] = ()) -> None:
    """Refuse before the long work what could not be written after it.

    Args:
        paths: everything the run will write.
        force: whether existing results may be replaced.
        inputs: what it reads, which must survive.

    Raises:
        UserError: a target is a URL, its folder is missing or read-only, a result exists already,
            an output is an input (by whatever name), or two outputs have one name.
    """
    checked: set[Path] = set()
    for path in paths:
        refuse_url(path)
        file_name, folder = _printable_path(path), _printable_path(path.parent)
        if (place := path.parent.resolve() / path.name) in checked:
            hint = "run several logs one by one, each with its own --out"
            raise UserError(f"{file_name}: two results of this run would have this name", hint)
        checked.add(place)
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
    """Refuse a target that is a URL, which would become a folder with the name `s3:`.

    Raises:
        UserError: as said.
    """
    if url := as_url(path):
        hint = "write to a folder of this machine, and copy the results from there"
        raise UserError(f"{printable(url)}: results cannot be written to a URL", hint, code=2)


@contextmanager
def folder(target: Path) -> Iterator[None]:
    """Makes a folder for results; removes it again if it stays empty.

    Raises:
        UserError: where it cannot be made.
    """
    refuse_url(target)
    if target.exists() and not target.is_dir():
        hint = "name a folder with --out, a new one or one that exists"
        raise UserError(f"{_printable_path(target)}: is a file, not a folder", hint)
    created = [p for p in (target, *target.parents) if not p.exists()]
    try:
        if created:
            target.mkdir(parents=True)
    except OSError as error:
        text = f"{_printable_path(target)}: the folder cannot be made ({error.strerror})"
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

    With several files a manifest of their SHA-256 is written to the same folder.

    Args:
        paths: final names; the first is the record the others are made from.
        force: whether existing results may be replaced.
        inputs: what the run reads, which must survive.

    Yields:
        One path to write to for each final name. They have no suffix.

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

    Args:
        path_sets: the final names of each set.
        force: whether existing results may be replaced.
        inputs: what the run reads, which must survive.
        sweeps: whether what killed runs left goes first; a folder with many files takes long.

    Yields:
        The paths to write to, of each set.
    """
    all_paths = [path for paths in path_sets for path in paths]
    check(all_paths, force, inputs=inputs)
    folders = list(dict.fromkeys(path.parent for path in all_paths))
    try:
        if sweeps:
            sweep(folders)
        with ExitStack() as stack:

            def hidden(folder: Path) -> Path:
                return stack.enter_context(_hidden(folder))

            written = [[hidden(path.parent) for path in paths] for paths in path_sets]
            yield [list(places) for places in written]
            files = dict(
                zip(all_paths, (place for places in written for place in places), strict=True)
            )
            for paths, places in zip(path_sets, written, strict=True):
                if len(paths) > 1:
                    place = files[manifest(paths[0])] = hidden(paths[0].parent)
                    with verified(place) as digests:
                        digests.write(_manifest(paths, places))
            for place in files.values():  # one by one: an interrupt would wait for threads
                with place.open("rb") as file:
                    os.fsync(file.fileno())
            with _locked(folders) as locked, _uninterrupted():
                stale = [
                    m for paths in path_sets if paths and _is_manifest(m := manifest(paths[0]))
                ]
                if not force:  # another run was faster, or somebody else's manifest
                    _refuse_existing([path for path in files if path not in stale])
                _publish(files, stale)
                for descriptor in locked:
                    os.fsync(descriptor)
    except OSError as error:
        text = f"cannot write the results ({error.strerror or error})"
        raise UserError(
            f"{', '.join(map(_printable_path, folders))}: {text}",
            f"free space there, or {_ELSEWHERE}",
        ) from error


def _publish(files: dict[Path, Path], stale: list[Path]) -> None:
    """Give files their names, in the order in which a run that is killed leaves no mixture.

    On an error, the old files get their names back.

    Args:
        files: what is written, by its name; the record first.
        stale: manifests that are about to be untrue.
    """
    replaced = [path for path in files if os.path.lexists(path) and path not in stale]
    replaces = replaced[:1] == list(files)[:1]
    published: list[Path] = []
    with ExitStack() as stack:
        backups = {path: stack.enter_context(_backup(path)) for path in [*replaced, *stale]}
        try:
            for path in reversed([*replaced[replaces:], *stale]):
                path.unlink()
            for path, place in files.items():
                place.replace(path)
                published.append(path)
        except BaseException:
            for path in reversed(published[replaces:]):
                path.unlink()
            for path, place in backups.items():
                place.replace(path)
            raise


@contextmanager
def _backup(path: Path) -> Iterator[Path]:
    """A second, hidden name of a file, until this is done; a copy where the disk has no links."""
    place = _hidden_name(path.parent)
    with ExitStack() as stack:
        try:
            try:
                os.link(path, place, follow_symlinks=False)
            except OSError:
                shutil.copyfile(path, place)
            with suppress(OSError):  # a link to nothing
                _lock(stack.enter_context(place.open("rb")))
            yield place
        finally:
            with suppress(OSError):  # the next run removes it
                place.unlink()


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
    """Remove the hidden files of killed runs: no process holds them, and they are not new."""
    with _locked(folders):  # else a sweep could take what another run keeps of older files
        for folder in folders:
            _sweep(folder)


def _sweep(folder: Path) -> None:
    for path in folder.glob(f"{_HIDDEN}*.part"):
        with suppress(OSError), path.open("rb") as file:
            if time.time() - path.stat().st_mtime > _UNLOCKED_AGE:
                _lock(file)
                path.unlink()


def _hidden_name(folder: Path) -> Path:
    return folder / f"{_HIDDEN}{secrets.token_hex(8)}.part"


def _lock(file: BinaryIO) -> None:
    """Keep the sweep of other runs from a hidden file.

    Raises:
        OSError: another run keeps it.
    """
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)


@contextmanager
def _hidden(folder: Path) -> Iterator[Path]:
    """An empty file that vanishes unless it is renamed."""
    path = _hidden_name(folder)
    with path.open("xb") as file:
        try:
            with suppress(OSError):  # a file system without locks
                _lock(file)
            yield path
        finally:
            with suppress(OSError):  # it has its name; else the next run removes it
                path.unlink()


@contextmanager
def _locked(folders: Sequence[Path]) -> Iterator[list[int]]:
    """Keep other runs from publishing into the folders meanwhile; yields their descriptors.

    Every run locks them in the same order, each once: none waits for one that waits for it.
    """
    with ExitStack() as stack:
        descriptors: list[int] = []
        for folder in sorted({x.resolve() for x in folders}):
            descriptors.append(os.open(folder, os.O_RDONLY | os.O_CLOEXEC))
            stack.callback(os.close, descriptors[-1])
            with suppress(OSError):  # a file system without locks
                fcntl.flock(descriptors[-1], fcntl.LOCK_EX)
        yield descriptors


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


def _manifest(paths: Sequence[Path], written: Sequence[Path]) -> bytes:
    directory = paths[0].parent.resolve()
    names = (os.path.relpath(p.parent.resolve() / p.name, directory) for p in paths)
    return os.fsencode(_MANIFEST_HEAD + "".join(map(_line, names, written)))


def _line(name: str, place: Path) -> str:
    escaped = name.replace("\\", r"\\").replace("\n", r"\n").replace("\r", r"\r")
    with place.open("rb") as content:
        digest = hashlib.file_digest(content, "sha256").hexdigest()
    return (
        "\\" if escaped != name else ""
    ) + f"{digest}  {escaped}\n"  # as sha256sum marks such a name


def _is_manifest(path: Path) -> bool:
    """Whether this is a manifest that we wrote."""
    try:
        return path.read_bytes().startswith(os.fsencode(_MANIFEST_HEAD))
    except OSError:  # none, as a rule
        return False


def _refuse_existing(paths: Sequence[Path]) -> None:
    for path in paths:
        if os.path.lexists(path):
            raise UserError(
                f"{_printable_path(path)}: exists already",
                "add --force to replace it, or write elsewhere",
            )


def _printable_path(path: Path) -> str:
    return printable(str(path))
