"""Samples as datagrams or MQTT messages: an object in JSON each, or several on lines."""

import queue
import socket
import threading
from typing import Any

from ..core.errors import UserError, installed_by
from ..formats.source import ReadOptions
from .feed import Pump
from .messages import MOST_BYTES, Messages, in_datagrams

_LARGEST = 1 << 16  # bytes of a datagram
_INSTALL = installed_by("live")
_PORT = 1883
_WAIT = 10.0  # for the broker's answer [s]
_KEEPALIVE = 30  # [s]


class Udp(Messages):
    """A port on which datagrams arrive; it listens where HOST says, and nowhere else.

    `place` is HOST:PORT, an address of this machine; a UserError for none, or a port in use.
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


class Mqtt(Messages):
    """A topic of a broker, also after a lost connection; a UserError for no broker or library.

    `place` is HOST/TOPIC or HOST:PORT/TOPIC; the topic may have the wildcards + and #.
    """

    def __init__(self, place: str, options: ReadOptions) -> None:
        name = f"mqtt://{place}"
        server, _, self._topic = place.partition("/")
        host, colon, port = server.partition(":")
        if not (host and self._topic) or (colon and not port.isdigit()):
            hint = "name both, as mqtt://192.168.0.2/train/brake"
            raise UserError(f"{name}: no host or no topic", hint, code=2)
        try:
            from paho.mqtt import client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError:
            raise UserError(f"{name}: paho-mqtt is not installed", _INSTALL) from None
        self._arrived: queue.Queue[bytes | None] = queue.Queue(1)  # the pump keeps the others
        self._answered, self._refused = threading.Event(), ""
        self._client: Any = client.Client(CallbackAPIVersion.VERSION2)
        self._client.on_connect, self._client.on_message = self._connected, self._message
        try:
            self._client.connect(host, int(port or _PORT), _KEEPALIVE)
        except (OSError, ValueError) as error:
            text = f"{name}: no broker answers: {getattr(error, 'strerror', None) or error}"
            raise UserError(text, "check host and port; the usual port is 1883") from None
        pump = Pump(self._arrived.get, patient=False)
        self._client.loop_start()
        if not self._answered.wait(_WAIT) or self._refused:
            self.close()
            text = f"{name}: the broker refuses: {self._refused or 'no answer'}"
            raise UserError(text, "check that it lets this computer read the topic")
        super().__init__(name, in_datagrams(pump), options, pump.dropped_count)

    def _connected(self, client: Any, _: Any, __: Any, reason: Any, ___: Any) -> None:
        self._refused = str(reason) if reason.is_failure else ""
        if not self._refused:
            client.subscribe(self._topic)
        self._answered.set()

    def _message(self, _: Any, __: Any, message: Any) -> None:
        self._arrived.put(message.payload[: MOST_BYTES + 1])

    def close(self) -> None:
        """See `Feed`."""
        self._client.disconnect()
        self._client.loop_stop()
        self._arrived.put(None)
