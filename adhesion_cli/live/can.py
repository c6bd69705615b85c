"""Samples as frames on a CAN bus; the DBC of the vehicle says what they hold."""

from typing import Any

from ..core.errors import UserError, installed_by
from ..formats.can import FrameDecoder, bus, next_frame
from ..formats.source import ReadOptions
from .feed import Pump
from .messages import Messages, Values

_INSTALL = installed_by("can")


class Can(Messages):
    """A CAN bus, only listened to; a UserError for no such bus, no DBC or no library.

    `place` is INTERFACE:CHANNEL as python-can has them; a channel alone is one of socketcan.
    """

    _form = "not a frame of the DBC"

    def __init__(self, place: str, options: ReadOptions) -> None:
        name = f"can:{place}"
        if not options.dbc:
            text = f"{name}: a bus has frames; which signals they are, a DBC file says"
            raise UserError(text, "state it with --dbc FILE.dbc", code=2)
        try:
            self._decoder, self._bus = FrameDecoder(options.dbc), bus(place)
        except ImportError as error:
            raise UserError(f"{name}: {error.name} is not installed", _INSTALL) from error
        self._closed, self._place = False, place
        pump = Pump(self._frame, patient=False)
        super().__init__(name, iter(pump), options, pump.dropped_count)

    def parsed(self, message: Any) -> Values | None:
        """See `Messages`."""
        if message.is_error_frame or message.is_remote_frame:
            return None
        values = self._decoder.values(
            message.arbitration_id, message.is_extended_id, bytes(message.data)
        )
        return (round(message.timestamp * 1e6) * 1000, values) if values else None

    def _frame(self) -> Any:
        while not self._closed:
            if frame := next_frame(self._bus, self._place):
                return frame
        return None

    def close(self) -> None:
        """See `Feed`."""
        self._closed = True
        self._bus.shutdown()
