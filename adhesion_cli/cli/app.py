"""The `adhesion` command: the only place that exits.

Commands import what they need when they run, so that help and completion are instant.
"""

import gc
import os
import signal
import sys
import traceback
from types import FrameType
from typing import Any, NoReturn

import typer

from ..errors import UserError
from . import (
    analyze,
    antiskid,
    compare,
    convert,
    estimators,
    inspect,
    recover,
    reproduce,
    simulate,
    slip,
    view,
)

app = typer.Typer(
    name="adhesion",
    help="Wheel-rail adhesion from brake-cylinder pressure and wheel speed.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for module in (
    inspect,
    analyze,
    compare,
    slip,
    antiskid,
    simulate,
    reproduce,
    convert,
    recover,
    view,
    estimators,
):
    app.command(module.__name__.rpartition(".")[2])(module.command)

# typer carries click inside, or uses the installed one, by version: reach its classes either way
_ClickError: Any = typer.BadParameter.__mro__[2]


def _version(value: bool) -> None:
    if value:
        from .. import __version__

        print(f"adhesion {__version__}")
        raise typer.Exit


@app.callback()
def _root(
    version: bool = typer.Option(
        False, "--version", callback=_version, is_eager=True, help="Show the version."
    ),
) -> None:
    pass


def main() -> NoReturn:
    """Runs the command line and exits: 0 done, 1 failed, 2 wrong arguments, 3 data lost."""
    signal.signal(signal.SIGTERM, _terminated)
    # What is imported stays: looking through it for garbage again and again is a tenth of a run.
    gc.set_threshold(100_000)
    try:
        code = app(standalone_mode=False) or 0
        sys.stdout.flush()
    except UserError as error:
        code = _failed(error.text, error.hint, error.code)
    except _ClickError as error:
        command = error.ctx.command_path if getattr(error, "ctx", None) else "adhesion"
        code = _failed(error.format_message(), f"`{command} --help` shows the options", 2)
    except (KeyboardInterrupt, typer.Abort):
        code = _failed("interrupted", "nothing was left half-written", 130)
    except BrokenPipeError:
        # whoever read our output is gone; keep the interpreter from failing again at exit
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = 1
    except (OSError, MemoryError) as error:
        code = _failed(_of_system(error), "free the resource and run again; --debug shows where", 1)
    except Exception as error:
        text = f"internal error: {type(error).__name__}: {error}".splitlines()[0]
        code = _failed(text, "run again with --debug and report what it shows", 1)
    sys.exit(code)


def _terminated(number: int, frame: FrameType | None) -> NoReturn:
    raise SystemExit(128 + number)  # unwinds, so that temporary files are removed


def _of_system(error: OSError | MemoryError) -> str:
    if isinstance(error, OSError):
        return ": ".join(str(p) for p in (error.filename, error.strerror or error) if p)
    return "out of memory"


def _failed(text: str, hint: str, code: int) -> int:
    """Says what went wrong: two lines on stderr, or with --json a document on stdout.

    With --debug the traceback goes before it, to stderr; nothing else changes.
    """
    from ..text import printable

    if "--debug" in sys.argv:
        traceback.print_exc()

    if "--json" in sys.argv:
        import json

        print(json.dumps({"schema": "adhesion.error/1", "error": text, "hint": hint}))
    else:
        print(f"error: {printable(text)}", file=sys.stderr)
        if hint:
            print(f"hint: {printable(hint)}", file=sys.stderr)
    return code
