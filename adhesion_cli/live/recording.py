"""Samples as a file that can be read while it grows, and after a kill; or in a viewer."""

import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock, Timeout

from ..analysis.settings import Settings, tree
from ..core.errors import UserError
from ..core.estimator import Estimator
from ..core.finding import Finding
from ..core.model import Samples
from ..core.text import printable
from ..results import atomic_files
from ..results.mcap import GrowingResult
from ..results.rrd.live import LiveRecording
from .axle import LiveEstimate, LiveSample, Sink

_WAITING_SAMPLES = 20_000  # samples that wait for a file before the sender has to
_PATIENCE = 5.0  # for a viewer, at the end [s]
_NOTHING = LiveEstimate(float("nan"), float("nan"))


@contextmanager
def new_file(path: Path, force: bool, inputs: Sequence[Path]) -> Iterator[None]:
    """An empty file of this name, which no other run writes meanwhile; raises UserError.

    It has its name while it grows, so that it can be read. What had the name before is removed, and
    not written to: another program may hold it, or it may be a link.
    """
    atomic_files.check([path], force, inputs=inputs)
    with _locked(path):
        atomic_files.check_closed([path])
        with _written(path):
            if force:
                path.unlink(missing_ok=True)
            path.open("xb").close()
        yield


@contextmanager
def _locked(path: Path) -> Iterator[None]:
    """Keeps other runs from a file."""
    lock = FileLock(path.with_name(f".{path.name}.lock"), blocking=False)
    with _written(path), suppress(NotImplementedError):  # a file system without locks
        try:
            lock.acquire()
        except Timeout as error:
            text = f"{printable(str(path))}: another run of `live` is writing this file"
            raise UserError(text, "end that run, or name another folder with -o") from error
    try:
        yield
    finally:
        lock.release()
        with suppress(OSError):
            Path(lock.lock_file).unlink()


class Batches(Sink):
    """Samples every `interval` [s], in a thread of its own: writing holds up no sample.

    Samples wait for a target without `report`. For another one, this is called once, with the text
    that samples are dropped; `name` says for whom.
    """

    def __init__(
        self,
        target: Sink,
        interval: float,
        report: Callable[[str], None] | None = None,
        name: str = "the viewer",
    ) -> None:
        self._report, self._name, self._drops = report, name, False
        self._target, self._interval = target, interval
        self._waiting: list[LiveSample] = []
        self._change = threading.Condition()
        self._is_ending = False
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        with self._change:
            while len(self._waiting) > _WAITING_SAMPLES and not self._error:  # a slow disk
                if self._report:
                    self._drop()
                else:
                    self._change.wait()
            self._check()
            self._waiting += samples

    def idle(self) -> None:
        """See `Sink`."""
        self._check()

    def close(self) -> None:
        """See `Sink`."""
        with self._change:
            self._is_ending = True
            self._change.notify()
        self._thread.join(_PATIENCE if self._report else None)
        if self._thread.is_alive():
            self._drop()
        else:
            self._target.close()
        self._check()

    def _drop(self) -> None:
        self._waiting.clear()
        if self._report and not self._drops:
            self._report(f"{self._name} is slower than the samples: it gets only some of them")
        self._drops = True

    def _check(self) -> None:
        if self._error:
            raise self._error

    def _run(self) -> None:
        try:
            is_ending = False
            while not is_ending:
                with self._change:
                    is_ending = self._change.wait_for(lambda: self._is_ending, self._interval)
                    waiting, self._waiting = self._waiting, []
                    self._change.notify()
                if waiting:
                    self._target.take(waiting)
        except BaseException as error:  # raised again where the samples come from
            with self._change:
                self._error = error
                self._change.notify()


class Mcap(Sink):
    """A file of all samples, as `GrowingResult`, or a UserError; `report` gets what is left out."""

    def __init__(
        self,
        path: Path,
        log: str,
        settings: Settings,
        algos: Mapping[str, tuple[Estimator, Any]],
        axles: Sequence[int],
        report: Callable[[Sequence[Finding]], None],
    ) -> None:
        self._path, self._report, self._algos = path, report, sorted(algos)
        settings_tree = tree(settings, [est for est, _ in algos.values()], axles)
        nothing = {axle: columns([], self._algos) for axle in axles}
        with _written(path):
            self._file = path.open("wb")
            self._result = GrowingResult(self._file, log, settings_tree, settings.vehicle, nothing)

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        with _written(self._path):
            self._result.add(by_axle(samples, self._algos))
        if dropped := self._result.lost:
            self._result.lost = 0
            self._report([Finding("not-recorded", "warning", count=dropped)])

    def close(self) -> None:
        """See `Sink`."""
        with _written(self._path), self._file:
            self._result.finish()


@contextmanager
def _written(path: Path) -> Iterator[None]:
    """An error of the system about a file, as the user sees it."""
    try:
        yield
    except OSError as error:
        text = f"{printable(str(path))}: cannot be written: {error.strerror}"
        hint = "what is in the file so far can be read; free space, or name another folder with -o"
        raise UserError(text, hint) from error


class LiveView(Sink):
    """A recording in a viewer; what goes wrong is reported once; samples go on."""

    def __init__(self, recording: LiveRecording, algos: Sequence[str], report: Any) -> None:
        self._recording: LiveRecording | None = recording
        self._algos, self._tell = algos, report

    def take(self, samples: Sequence[LiveSample]) -> None:
        """See `Sink`."""
        self._try(lambda recording: recording.add(by_axle(samples, self._algos)))

    def close(self) -> None:
        """See `Sink`."""
        self._try(lambda recording: recording.finish())

    def _try(self, action: Any) -> None:
        if self._recording is None:
            return
        try:
            action(self._recording)
        except Exception as error:  # the binding has errors of many kinds
            self._recording = None
            self._tell(getattr(error, "strerror", None) or str(error))


def by_axle(samples: Sequence[LiveSample], algos: Sequence[str]) -> dict[int, Samples]:
    """The samples of each axle that has some, in the order of the axles."""
    axles = sorted({s.axle for s in samples})
    return {n: columns([s for s in samples if s.axle == n], algos) for n in axles}


def columns(samples: Sequence[LiveSample], algos: Sequence[str]) -> Samples:
    """The samples of one axle as columns."""
    pressure, clamping, speed, train, slip = (
        np.array([getattr(s, name) for s in samples], np.float64)
        for name in ("pressure", "clamping", "speed", "train", "slip")
    )
    estimates = {}
    for algo in algos:
        said = [s.estimates.get(algo, _NOTHING) for s in samples]
        force, sigma, masses = (np.array([x[i] for x in said], np.float64) for i in (0, 1, 2))
        estimates[algo] = force, sigma, masses
    t = np.array([s.t for s in samples], np.int64)
    return Samples(t, pressure, clamping, speed, train, slip, estimates)
