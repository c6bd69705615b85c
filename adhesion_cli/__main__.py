"""`python -m adhesion_cli` and the `adhesion` command: the only place that exits."""

import gc
import io
import os
import signal
import sys
import threading
import traceback
from types import FrameType
from typing import TYPE_CHECKING, NoReturn

from .core.errors import UserError, as_user_error
from .core.imports import refuse_pandas
from .core.text import drop_output, printable, utf8

if TYPE_CHECKING:
    from sys import UnraisableHookArgs

_HINT = "nothing was left half-written"
_SOON = 0.05  # after which an interrupt that got lost is raised again [s]


class _Terminated(BaseException):
    """The system asks the run to end."""


_ENDS: dict[type[BaseException], tuple[signal.Signals, str]] = {
    KeyboardInterrupt: (signal.SIGINT, "interrupted"),
    _Terminated: (signal.SIGTERM, "terminated"),
}


def main() -> NoReturn:
    """Runs the command line and exits: 0 done, 1 failed, 2 wrong arguments, 3 data lost.

    130 by SIGINT, 143 by SIGTERM; 1 as well where whoever read the output is gone.
    """
    # What is imported stays: looking through it for garbage again and again is a tenth of a run.
    gc.set_threshold(100_000)
    # OpenBLAS adds in an order that depends on the number of its threads, and these wait busily.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    refuse_pandas()
    _fit_memory()
    try:
        signal.signal(signal.SIGTERM, _terminated)
        sys.unraisablehook = _not_lost
        _prepare_streams()
        from .cli.app import run  # slow enough to be interrupted

        code = run()
        sys.stdout.flush()
    except (Exception, KeyboardInterrupt, _Terminated) as error:
        code = _report_end(error)
        _flush_output()
    sys.exit(code)


def _flush_output() -> None:
    """Prints what waits; on a full disk it goes nowhere, else Python fails on it again at exit."""
    try:
        if sys.stdout:
            sys.stdout.flush()
    except OSError:
        drop_output()


def _fit_memory() -> None:
    """Where address space is limited (`ulimit -v`), pyarrow's own allocator reserves 1 GB of it."""
    if sys.platform == "win32":
        return
    import resource

    if resource.getrlimit(resource.RLIMIT_AS)[0] != resource.RLIM_INFINITY:
        os.environ.setdefault("ARROW_DEFAULT_MEMORY_POOL", "system")


def _report_end(error: BaseException) -> int:
    """Says what ended the run; returns the exit code."""
    cause: BaseException | None = error
    while cause:  # what a signal raises, Python may put into an error of its own
        if type(cause) in _ENDS:
            number, text = _ENDS[type(cause)]
            return _failed(text, _HINT, 128 + number)
        cause = cause.__cause__ or cause.__context__
    if isinstance(error, BrokenPipeError):  # whoever read our output is gone
        drop_output()
        return 1
    user_error = as_user_error(error)
    return _failed(user_error.text, user_error.hint, user_error.code)


def _prepare_streams() -> None:
    """What goes to a pipe or a file is UTF-8 on every system, with the line ends of POSIX.

    A character that a stream cannot hold becomes its code, not an error after the work.
    """
    if sys.stderr is None:
        sys.stderr = open(os.devnull, "w", encoding="utf-8")  # noqa: SIM115  (else print means stdout)
    if sys.stdout is None:
        raise UserError("standard output is closed", "redirect it to a file")
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            if not stream.isatty():
                stream.reconfigure(encoding="utf-8", newline="\n")
            stream.reconfigure(errors="backslashreplace")


def _terminated(number: int, frame: FrameType | None) -> NoReturn:
    raise _Terminated  # unwinds, so that temporary files are removed


def _not_lost(raised: "UnraisableHookArgs") -> None:
    """An interrupt in a callback of the compiler, which drops what is raised there, comes again."""
    if raised.exc_type not in _ENDS:
        sys.__unraisablehook__(raised)
        return
    timer = threading.Timer(_SOON, _signal_main_thread, [_ENDS[raised.exc_type][0]])
    timer.daemon = True
    timer.start()


def _signal_main_thread(number: signal.Signals) -> None:
    """Raises a signal where the main thread gets it, though it waits in a call of the system."""
    if sys.platform == "win32":
        signal.raise_signal(number)
    else:
        signal.pthread_kill(threading.main_thread().ident or 0, number)


def _failed(text: str, hint: str, code: int) -> int:
    """Says what went wrong: two lines on stderr, or with --json a document on stdout.

    With --debug the traceback goes before it, to stderr; nothing else changes.
    """
    if "--debug" in sys.argv:
        traceback.print_exc()
    if "--json" in sys.argv and sys.stdout:
        import json

        document = {"schema": "adhesion.error/1", "error": utf8(text), "hint": utf8(hint)}
        try:
            print(json.dumps(document), flush=True)
            return code
        except OSError:  # a full disk may be what went wrong: say so where it can be read
            drop_output()
    print(f"error: {printable(text)}", file=sys.stderr)
    if hint:
        print(f"hint: {printable(hint)}", file=sys.stderr)
    return code


if __name__ == "__main__":
    main()
