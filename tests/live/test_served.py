"""Samples for Foxglove."""

import json
import socket
from collections.abc import Iterator
from contextlib import nullcontext
from typing import Any

import pytest
from helpers.live_runs import (
    samples_of,
)

from adhesion_cli.core.errors import UserError
from adhesion_cli.core.model import Vehicle
from adhesion_cli.live.gate import Gate


def test_foxglove_gets_the_topics_of_an_axle_that_comes_later() -> None:
    pytest.importorskip("foxglove")
    sync = pytest.importorskip("websockets.sync.client")
    from adhesion_cli.live.served import LiveServer

    served, (sample,) = LiveServer(0, Vehicle(), [1], ["td", "imm"]), samples_of(1)
    served.take([sample, sample._replace(axle=2)])
    try:
        with sync.connect(served.url, subprotocols=["foxglove.sdk.v1"]) as client:
            told = [json.loads(client.recv(timeout=20)) for _ in range(2)]
    finally:
        served.close()
    topics = {c["topic"] for one in told for c in one.get("channels", [])}
    of = ("input", "slip", "estimate/td", "estimate/imm")
    assert topics == {f"/axle/{n}/{t}" for n in (1, 2) for t in of}


@pytest.fixture
def served() -> Iterator[Any]:
    pytest.importorskip("foxglove")
    from adhesion_cli.live.served import LiveServer

    server = LiveServer(0, Vehicle(), [1], ["td"])
    yield server
    server.close()


@pytest.mark.parametrize(
    ("origin", "is_let_in"),
    [
        (None, True),  # a program
        ("file://", True),
        ("https://app.foxglove.dev", True),
        ("http://localhost:8080", True),
        ("http://[::1]:8080", True),
        ("https://evil.example", False),
        ("http://127.0.0.1.evil.example", False),
        ("https://app.foxglove.dev.evil.example", False),
        ("https://notfoxglove.dev", False),
        ("null", False),
        ("http://[", False),
    ],
)
def test_pages_of_other_web_sites_stay_outside(
    served: Any, origin: str | None, is_let_in: bool
) -> None:
    websockets = pytest.importorskip("websockets")
    sync = pytest.importorskip("websockets.sync.client")
    more = {"origin": origin, "subprotocols": ["foxglove.sdk.v1"]}
    refused = nullcontext() if is_let_in else pytest.raises(websockets.InvalidStatus, match="403")
    with refused, sync.connect(served.url, **more) as client:
        assert client.recv(timeout=20)


def test_after_its_end_nothing_is_connected() -> None:
    with socket.create_server(("127.0.0.1", 0)) as target:
        gate = Gate("127.0.0.1", 0, target.getsockname()[:2])
        with socket.create_connection(("127.0.0.1", gate.port), 10.0) as client:
            client.sendall(b"GET / HTTP/1.1\r\n\r\n")
            target.settimeout(10.0)
            there, _ = target.accept()
            with there:
                assert there.recv(99).startswith(b"GET")
                gate.close()
                assert client.recv(1) == b""
        with pytest.raises(OSError, match="refused"):
            socket.create_connection(("127.0.0.1", gate.port), 10.0)


def test_a_taken_port_is_an_error(served: Any) -> None:
    from adhesion_cli.live.served import LiveServer

    with pytest.raises(UserError, match="cannot listen"):
        LiveServer(int(served.url.rpartition(":")[2]), Vehicle(), [1], ["td"])
