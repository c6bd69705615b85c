"""Whether this computer can show a window."""

import os
import sys

_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")


def check_display(serves: str) -> None:
    """Refuses where the viewer cannot open a window; `serves` is the command for a browser.

    Raises:
        UserError: on Linux without a display.
    """
    if sys.platform == "linux" and not any(map(os.environ.get, _DISPLAYS)):
        raise no_window_error("there is no display", serves)


def no_window_error(reason: str, serves: str) -> Exception:
    """The error where the viewer has no window, with what to do instead."""
    from ..core.errors import UserError

    hint = f"in a browser: `{serves}`; or copy the .rrd to a computer with a display"
    return UserError(f"the viewer cannot open a window: {reason}", hint)
