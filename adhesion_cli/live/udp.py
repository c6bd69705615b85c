"""Samples as datagrams: an object in JSON each, or several on lines."""

import socket

from ..core.errors import UserError
from ..formats.source import ReadOptions
from .feed import Pump
from .messages import Messages, in_datagrams

_LARGEST = 1 << 16  # bytes of a datagram


class Udp(Messages):
    """A port on which datagrams arrive; it listens where HOST says, and nowhere else.

    `place` is HOST:PORT; the host is an address of this machine.

    Raises:
        UserError: where that is no address, or the port is taken.
    """

    def __init__(self, place: str, options: ReadOptions) -> None:
        host, _, port = place.rpartition(":")
        name = f"udp://{place}"
        if not port.isdigit():
            raise UserError(f"{name}: no port", "name one, as udp://127.0.0.1:5005", code=2)
        if not 0 < int(port) < 1 << 16:
            hint = "ports are 1 to 65535, as in udp://127.0.0.1:5005"
            raise UserError(f"{name}: there is no port {port}", hint, code=2)
        try:
            (family, _, _, _, address), *_ = socket.getaddrinfo(
                host.strip("[]") or "127.0.0.1", int(port), type=socket.SOCK_DGRAM
            )
            self._socket = socket.socket(family, socket.SOCK_DGRAM)
            self._socket.bind(address)
        except OSError as error:
            hint = "name an address of this machine and a free port"
            raise UserError(f"{name}: cannot listen there: {error.strerror}", hint) from None
        pump = Pump(self._datagram, patient=False)
        super().__init__(name, in_datagrams(pump), options, pump.dropped_count)

    def _datagram(self) -> bytes | None:
        try:
            return self._socket.recv(_LARGEST)
        except OSError:
            return None  # closed

    def close(self) -> None:
        """See `Feed`."""
        self._socket.close()
