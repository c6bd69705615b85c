"""The `adhesion` command: its subcommands under one name; `__main__` makes errors exit codes.

Commands import what they need when they run, so that help and completion are instant.
"""

import re
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

import typer
from typer.core import TyperCommand

from ..core.errors import UserError
from ..core.text import shell_word
from .options import Ended

_COMMANDS = (
    "inspect analyze compare stops fleet slip antiskid calibrate tune live simulate reproduce "
    "explain convert report view estimators vehicle export-c"
).split()
app = typer.Typer(
    name="adhesion",
    help="Wheel-rail adhesion from brake-cylinder pressure and wheel speed.",
    invoke_without_command=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


class _Command(TyperCommand):
    def get_help(self, ctx: Any) -> str:
        """The help without typer's marks on arguments: braces, and the type in Python."""
        text = re.sub(r"\{([A-Z]+)\}", r"\1", super().get_help(ctx))
        return re.sub(r"(?m)^(  [A-Z]+) <\S+>  ", r"\1  ", text)


for name in _COMMANDS:
    app.command(name, cls=_Command)(
        import_module(f".{name.replace('-', '_')}", __package__).command
    )

# typer carries click inside, or uses the installed one, by version: reach its classes either way
_ClickError: Any = typer.BadParameter.__mro__[2]


@app.callback()
def _root(
    context: typer.Context,
    version: bool = typer.Option(False, "--version", help="Show the version."),
) -> None:
    if version:
        from .. import __version__

        print(f"adhesion {__version__}")
        raise typer.Exit
    if context.invoked_subcommand is None:
        print(context.get_help(), file=sys.stderr)
        raise typer.Exit(2)


def _named_log(arguments: Sequence[str]) -> str:
    """The command for somebody who names a log in place of a command; empty otherwise."""
    path = Path(arguments[0]) if arguments else Path()
    if path.is_file():
        return f"`adhesion analyze {shell_word(str(path))}` analyses this log"
    if arguments and path.is_dir():
        return f"`adhesion fleet {shell_word(str(path))} -o DIR` analyses the logs of this folder"
    return ""


def run() -> int:
    """Runs the command that the arguments name; returns the exit code.

    Raises:
        UserError: wrong arguments, or what the command raises.
        KeyboardInterrupt: typer makes an exit code of it.
    """
    try:
        code = app(standalone_mode=False) or 0
    except _ClickError as error:
        names = [name for name in sys.argv[1:2] if name in _COMMANDS]
        context = getattr(error, "ctx", None)  # a value of an option that takes none has none
        command = context.command_path if context else " ".join(["adhesion", *names])
        hint = _named_log(sys.argv[1:]) or f"`{command} --help` shows the options"
        raise UserError(error.format_message(), hint, code=2) from error
    except typer.Abort:
        code = 130
    if code == 130 and not isinstance(code, Ended):
        raise KeyboardInterrupt
    return int(code)
