"""The one error a user sees: what is wrong, and what to do about it."""

from difflib import get_close_matches

# What libraries say where memory, or address space for their code, is missing.
_OUT_OF_MEMORY = (
    "Allocation error",
    "failed to map segment",
    "Cannot allocate memory",
    "Failed to spawn",
)


class UserError(Exception):
    """An error that only the user can correct.

    Args:
        text: one line that names the file and the place.
        hint: one line that names the remedy (a flag, a TOML key, a command).
        code: exit code, 1 for a failed run, 2 for wrong arguments.
    """

    def __init__(self, text: str, hint: str = "", code: int = 1) -> None:
        super().__init__(text)
        self.text, self.hint, self.code = text, hint, code
        if hint:
            self.add_note(f"hint: {hint}")  # a traceback shows it


def unknown(kind: str, name: str, names: list[str], listed_by: str = "") -> UserError:
    """The error for an unknown name, with the nearest known one as the hint.

    `kind` is what the name stands for, `listed_by` what shows the known names, where there are too
    many for a line.
    """
    nearest = get_close_matches(name, names, n=1, cutoff=0.5)
    hint = f"did you mean {nearest[0]!r}? " if nearest else ""
    listing = listed_by or f"known: {', '.join(names)}"
    return UserError(f"unknown {kind} {name!r}", hint + listing, code=2)


def installed_by(extra: str) -> str:
    """The hint that installs an optional part of the program."""
    return f'pip install "adhesion-cli[{extra}]", or in a clone: pip install ".[{extra}]"'


def as_user_error(error: BaseException) -> UserError:
    """An error as the user sees it: a `UserError` as it is, else the text of system or program."""
    if isinstance(error, UserError):
        return error
    if isinstance(error, MemoryError) or any(x in str(error) for x in _OUT_OF_MEMORY):
        hint = "free memory, or raise the limit with `ulimit -v unlimited`, and run again"
        return UserError("out of memory", hint)
    if isinstance(error, OSError):
        text = ": ".join(str(p) for p in (error.filename, error.strerror or error) if p)
    else:
        text = f"internal error: {type(error).__name__}: {error}".splitlines()[0]
        return UserError(text, "run again with --debug and report what it shows")
    return UserError(text, "free the resource and run again; --debug shows where")
