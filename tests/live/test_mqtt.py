"""Messages of a broker."""

import json
import threading
from pathlib import Path
from typing import Any

import pytest
from helpers.live_runs import free_port, running, taken


def test_messages_of_a_broker_are_taken_and_served_to_foxglove(tmp_path: Path) -> None:
    """A real broker, a real client of Foxglove's protocol."""
    import asyncio

    pytest.importorskip("foxglove")
    broker_of = pytest.importorskip("amqtt.broker").Broker
    sync = pytest.importorskip("websockets.sync.client")
    paho = pytest.importorskip("paho.mqtt.client")
    port, served = free_port(), free_port()
    stated = {
        "listeners": {"default": {"type": "tcp", "bind": f"127.0.0.1:{port}"}},
        "plugins": {"amqtt.plugins.authentication.AnonymousAuthPlugin": {"allow_anonymous": True}},
    }
    loop = asyncio.new_event_loop()

    async def started() -> Any:
        broker = broker_of(stated)
        await broker.start()
        return broker

    broker = loop.run_until_complete(started())
    turning = threading.Thread(target=loop.run_forever, daemon=True)
    turning.start()
    sender = paho.Client(paho.CallbackAPIVersion.VERSION2)
    sender.connect("127.0.0.1", port)
    sender.loop_start()
    source = f"mqtt://127.0.0.1:{port}/train/#"
    try:
        with running(tmp_path, source, "--json", "--serve", str(served), "-a", "imm") as process:
            stop = threading.Event()

            def send() -> None:
                k = 0
                while not stop.wait(0.02):
                    said = {"t": 0.02 * k, "speed 1 [km/h]": 80 - 0.02 * k, "bc pressure [bar]": 1}
                    sender.publish("train/brake", json.dumps(said))
                    k += 1

            sending = threading.Thread(target=send)
            sending.start()
            try:
                assert taken(process, 20)[-1]["status"] == "ok"
                with sync.connect(
                    f"ws://127.0.0.1:{served}", subprotocols=["foxglove.sdk.v1"]
                ) as client:
                    told = [json.loads(client.recv(timeout=20)) for _ in range(2)]
            finally:
                stop.set()
                sending.join()
        topics = {c["topic"] for one in told for c in one.get("channels", [])}
        assert topics == {"/axle/1/input", "/axle/1/slip", "/axle/1/estimate/imm"}
    finally:
        sender.loop_stop()
        asyncio.run_coroutine_threadsafe(broker.shutdown(), loop).result(20)
        loop.call_soon_threadsafe(loop.stop)
        turning.join()
