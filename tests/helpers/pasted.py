"""What a user pastes from a hint."""

import re

_OPTION = re.compile(r'--set (?:"([^"]+)"|([^\s"`]+))')
_LINES = re.compile(r"(`[^`]+`(?: and `[^`]+`)*) in adhesion\.toml")


def pasted(hint: str) -> list[str]:
    """The settings that a hint states: what follows each `--set`, and the lines of a file."""
    lines = [line for group in _LINES.findall(hint) for line in re.findall(r"`([^`]+)`", group)]
    return [a or b for a, b in _OPTION.findall(hint)] + lines
