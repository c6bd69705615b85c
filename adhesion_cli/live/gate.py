"""The entrance of a WebSocket server of this computer: pages of other web sites stay outside.

A browser lets any page connect to a server of its own computer, and says in the header `Origin`
whose page it is. Programs send no such header, or one that is not of the web.
"""

import asyncio
import threading
from urllib.parse import urlsplit

_LOCAL = ("localhost", "127.0.0.1", "::1")
_FOXGLOVE = "foxglove.dev"  # its web application
_PATIENCE = 10.0  # for the head of a request [s]
_BLOCK = 1 << 16
_REFUSAL = b"HTTP/1.1 403 Forbidden\r\nContent-Length: 0\r\nConnection: close\r\n\r\n"


class Gate:
    """Takes connections, and passes on those that are allowed.

    It listens on `host` and `port`, or on a free port where that is 0: see the attribute `port`.
    Raises OSError where the port is taken.
    """

    def __init__(self, host: str, port: int, target: tuple[str, int]) -> None:
        self._target, self._loop = target, asyncio.new_event_loop()
        starting = asyncio.start_server(self._enter, host, port)
        try:
            self._server = self._loop.run_until_complete(starting)
        except OSError:
            self._loop.close()
            raise
        self.port: int = self._server.sockets[0].getsockname()[1]
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Ends all connections, and takes no more."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        tasks = asyncio.all_tasks() - {asyncio.current_task()}
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)

    async def _enter(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), _PATIENCE)
            if all(map(is_allowed, _origins(head))):
                there = await asyncio.open_connection(*self._target)
                there[1].write(head)
                await asyncio.gather(_pass_on(reader, there[1]), _pass_on(there[0], writer))
            else:
                writer.write(_REFUSAL)
                await writer.drain()
        except (OSError, EOFError, TimeoutError, asyncio.LimitOverrunError):
            pass  # whoever connected is gone, or sent no request
        finally:
            writer.close()


def is_allowed(origin: str) -> bool:
    """Whether it is no web site, or one of this computer or Foxglove."""
    try:
        scheme, host = urlsplit(origin).scheme, urlsplit(origin).hostname or ""
    except ValueError:
        return False
    if scheme not in ("http", "https"):
        return bool(scheme)  # "null" is any page that hides where it is from
    return host in _LOCAL or host == _FOXGLOVE or host.endswith(f".{_FOXGLOVE}")


def _origins(head: bytes) -> list[str]:
    fields = [line.partition(":") for line in head.decode("latin-1").splitlines()]
    return [value.strip() for name, _, value in fields if name.strip().lower() == "origin"]


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    """Bytes as fast as they are taken, to the end of either side."""
    try:
        while data := await reader.read(_BLOCK):
            writer.write(data)
            await writer.drain()
    except OSError:
        pass  # that side is gone
    finally:
        writer.close()
