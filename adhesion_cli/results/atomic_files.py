"""The output files of a run appear complete under their names, or not at all.

A file has no name until everything is written, checked and on the disk. On Linux the files are
anonymous (O_TMPFILE), so that a killed run leaves nothing. Elsewhere, as on many network shares and
sticks, they are hidden files in the folder of the target. The end of the run removes them; if it
was killed, the next run does.

A run may write several sets, one for each log, and a file of a set may lie in another folder. The
manifest lies in the folder of the set's first file and names the others from there.

Several files cannot get their names at once. The first file of all is the record. To replace older
files, first their manifests go and all of them except the record. Then the record is replaced,
then the others appear, and the manifests last:

    old record, old others, manifest → old record → new record → new record, new others, manifest

A killed run leaves one of these states. New and old files are never mixed, no file is incomplete,
and a manifest (`<stem>.sha256`, for `sha256sum -c`) exists only if the whole run is complete. A
signal that ends a run waits meanwhile. If the disk refuses a name, the run removes those it gave.
"""

import hashlib
import os
import signal
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from ..core.errors import UserError
from ..core.text import printable
from .verified import verified

_HIDDEN = ".adhesion-"
_NEW = 60.0  # age of a hidden file that its run may not have locked yet [s]
_OURS = "# adhesion: written last, when the files below were whole\n"  # a comment to sha256sum

try:
    import fcntl
except ImportError:  # Windows: runs that share an output are not kept apart there
    fcntl = None  # type: ignore[assignment]


def check(paths: Sequence[Path], force: bool, *, inputs: Sequence[Path] = ()) -> None:
    """Refuse before the long work what could not be written after it.

    Args:
        paths: everything the run will write.
        force: whether existing results may be replaced.
        inputs: what it reads, which must survive.

    Raises:
        UserError: a target folder is missing or read-only, a result exists already, an output is
            an input (by whatever name), or two outputs have one name.
    """
    check_distinct(paths)
    for path in paths:
        if not path.parent.is_dir():
            raise UserError(
                f"{_shown(path.parent)}: no such folder", "create it, or write elsewhere"
            )
        if not os.access(path.parent, os.W_OK | os.X_OK):
            raise UserError(
                f"{_shown(path.parent)}: the folder cannot be written to",
                "write to another folder",
            )
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "a pipe or a device, not a file"
            raise UserError(f"{_shown(path)}: is {kind}", "write elsewhere")
        for source in inputs:
            if path.exists() and source.exists() and path.samefile(source):
                raise UserError(f"{_shown(path)}: is the input itself", "write to another folder")
    if not force:
        _refuse_existing(paths)


def check_distinct(paths: Sequence[Path]) -> None:
    """Refuse two outputs of one name.

    Raises:
        UserError: names the first that comes twice.
    """
    seen: set[Path] = set()
    for path in paths:
        place = path.parent.resolve() / path.name
        if place in seen:
            raise UserError(
                f"{_shown(path)}: two results of this run would have this name",
                "run several logs one by one, each with its own --out",
            )
        seen.add(place)


@contextmanager
def outputs(
    paths: Sequence[Path],
    force: bool,
    *,
    inputs: Sequence[Path] = (),
    record: Path | None = None,
) -> Iterator[list[Path]]:
    """Places to write to; on leaving without an exception they get their names, all or none.

    With several files a manifest of their SHA-256 is written to the same folder.

    Args:
        paths: final names; the first is the record the others are made from.
        force: whether existing results may be replaced.
        inputs: what the run reads, which must survive.
        record: the first of the set, where it is there already and `paths` is made from it anew.

    Yields:
        One path to write to for each final name. They may have no suffix.

    Raises:
        UserError: as `check`, or the disk is full, fails or refuses.
    """
    with sets([paths], force, inputs=inputs, record=record) as (places,):
        yield places


@contextmanager
def sets(
    of: Sequence[Sequence[Path]],
    force: bool,
    *,
    inputs: Sequence[Path] = (),
    record: Path | None = None,
) -> Iterator[list[list[Path]]]:
    """Several sets of `outputs`: none appears before all of them are written and on the disk.

    Args:
        of: the paths of each set.
        force: as of `outputs`, and so are the others.
        inputs: of all.
        record: of every set.

    Yields:
        The paths to write to, of each set.

    Raises:
        UserError: as `outputs`.
    """
    kept = [record] if record else []
    every = [path for paths in of for path in paths]
    check(every, force, inputs=[*inputs, *kept])
    folders = list(dict.fromkeys(path.parent for path in every))
    try:
        with ExitStack() as stack:

            def unnamed(folder: Path) -> _Unnamed:
                return stack.enter_context(_Unnamed(folder))

            written = [[unnamed(path.parent) for path in paths] for paths in of]
            yield [[file.path for file in files] for files in written]
            results = [file for files in written for file in files]
            manifests = {}
            for paths, files in zip(of, written, strict=True):
                if paths and len(paths) + len(kept) > 1:
                    file = manifests[manifest(paths[0])] = unnamed(paths[0].parent)
                    with verified(file.path) as told:
                        told.write(_manifest([*kept, *paths], [*kept, *(f.path for f in files)]))
            for file in (*results, *manifests.values()):
                os.fsync(file.descriptor)
            with _locked(folders) as locked, _uninterrupted():
                stale = [m for paths in of if paths and _ours(m := manifest(paths[0]))]
                if not force:  # another run was faster, or somebody else's manifest
                    _refuse_existing([*every, *(m for m in manifests if m not in stale)])
                _publish([*every, *manifests], [*results, *manifests.values()], stale)
                for folder in locked:
                    os.fsync(folder)
    except OSError as error:
        places = ", ".join(map(_shown, folders))
        raise UserError(
            f"{places}: cannot write the results ({error.strerror or error})",
            "free space there, or write to another folder",
        ) from error


def _publish(targets: list[Path], files: "list[_Unnamed]", stale: list[Path]) -> None:
    """Give files their names, in the order in which a run that is killed leaves no mixture.

    Args:
        targets: the names, that of the record first.
        files: as many.
        stale: manifests that are about to be untrue.
    """
    old = [path for path in targets if os.path.lexists(path) and path not in stale]
    replaces = old[:1] == targets[:1]
    for path in reversed([*old[replaces:], *stale]):
        path.unlink()
    given: list[Path] = []
    try:
        for path, file in zip(targets, files, strict=True):
            file.publish(path)
            given.append(path)
    except BaseException:
        for path in reversed(given[replaces:]):
            path.unlink()
        raise


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Signals that end a run come when this is done."""
    came: list[int] = []
    before = {}
    if threading.current_thread() is threading.main_thread():
        before = {n: signal.getsignal(n) for n in (signal.SIGINT, signal.SIGTERM)}
    before = {number: handler for number, handler in before.items() if callable(handler)}
    try:
        for number in before:
            signal.signal(number, lambda number, _: came.append(number))
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    if came:
        signal.raise_signal(came[0])


class _Unnamed:
    """An open file that vanishes unless it is published."""

    def __init__(self, folder: Path) -> None:
        self.named: Path | None = None
        try:
            self.descriptor = os.open(folder, os.O_TMPFILE | os.O_RDWR | os.O_CLOEXEC, 0o666)
            self.path = Path(f"/proc/self/fd/{self.descriptor}")
            if not self.path.exists():
                os.close(self.descriptor)
                raise OSError
        except (AttributeError, OSError):  # not Linux, or a file system that has no such files
            _sweep(folder)
            self.descriptor, name = tempfile.mkstemp(".part", _HIDDEN, folder)
            _lock(self.descriptor)
            self.path = self.named = Path(name)

    def __enter__(self) -> "_Unnamed":
        return self

    def __exit__(self, *_: object) -> None:
        try:
            self._close()
        finally:
            if self.named:
                self.named.unlink(missing_ok=True)

    def publish(self, target: Path) -> None:
        """Give the file its name in one stroke, whatever has that name now."""
        if self.named is None and os.path.lexists(target):
            # A link cannot replace: it takes a name beside it first, of the 255 bytes there may be.
            name = os.fsdecode(os.fsencode(target.name)[:240])
            beside = target.with_name(f".{name}.part")
            beside.unlink(missing_ok=True)  # of a run killed right here
            self._link(beside)
            self.named = beside
        if self.named:
            self.named.chmod(0o666 & ~_umask())
            if fcntl is None:
                self._close()  # Windows renames no open file
            self.named.replace(target)
            self.named = None
        else:
            self._link(target)

    def _close(self) -> None:
        descriptor, self.descriptor = self.descriptor, -1
        if descriptor >= 0:
            os.close(descriptor)

    def _link(self, target: Path) -> None:
        # A directory descriptor makes Python follow the link that /proc shows.
        os.link(self.path, target, src_dir_fd=self.descriptor, follow_symlinks=True)


def _sweep(folder: Path) -> None:
    """Remove the hidden files of killed runs: no process holds them, and they are not new."""
    for path in folder.glob(f"{_HIDDEN}*.part"):
        with suppress(OSError), path.open("r+b") as file:
            if time.time() - path.stat().st_mtime > _NEW and _lock(file.fileno()):
                path.unlink()


def _lock(descriptor: int) -> bool:
    """Whether no other process held the file; then this one holds it until it is closed."""
    if fcntl is None:
        return False
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:  # or a file system without locks
        return False
    return True


@contextmanager
def _locked(folders: Sequence[Path]) -> Iterator[list[int]]:
    """Keep other runs from publishing into the folders meanwhile; yields their descriptors.

    Every run locks them in the same order, each once: none waits for one that waits for it.
    """
    if fcntl is None:
        yield []
        return
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
        told = os.fsdecode(manifest(paths[0]).read_bytes())
        listed = set(told.removeprefix(_OURS).splitlines(keepends=True))
        return told.startswith(_OURS) and all(_line(p.name, p) in listed for p in paths)
    except FileNotFoundError:
        return False


def manifest(path: Path) -> Path:
    """The manifest of the set whose first file this is."""
    return path.with_suffix(".sha256")


def _manifest(paths: Sequence[Path], written: Sequence[Path]) -> bytes:
    here = paths[0].parent.resolve()
    names = (os.path.relpath(p.parent.resolve() / p.name, here) for p in paths)
    return os.fsencode(_OURS + "".join(map(_line, names, written)))


def _line(name: str, place: Path) -> str:
    told = name.replace("\\", r"\\").replace("\n", r"\n").replace("\r", r"\r")
    with place.open("rb") as content:
        digest = hashlib.file_digest(content, "sha256").hexdigest()
    return ("\\" if told != name else "") + f"{digest}  {told}\n"  # as sha256sum marks such a name


def _ours(path: Path) -> bool:
    """Whether this is a manifest that we wrote."""
    try:
        return path.read_bytes().startswith(os.fsencode(_OURS))
    except OSError:  # none, as a rule
        return False


def _umask() -> int:
    mask = os.umask(0o077)
    os.umask(mask)
    return mask


def _refuse_existing(paths: Sequence[Path]) -> None:
    for path in paths:
        if os.path.lexists(path):
            raise UserError(
                f"{_shown(path)}: exists already", "add --force to replace it, or write elsewhere"
            )


def _shown(path: Path) -> str:
    return printable(str(path))
