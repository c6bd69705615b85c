"""Messages of a broker."""

import json
import threading
from pathlib import Path
from typing import Any

import pytest
from helpers.live_runs import free_port, running, taken


def test_messages_of_a_broker_are_taken(tmp_path: Path) -> None:
    """A real broker."""
    import asyncio

    broker_of = pytest.importorskip("amqtt.broker").Broker
    paho = pytest.importorskip("paho.mqtt.client")
    port = free_port()
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
        with running(tmp_path, source, "--json", "-a", "imm") as process:
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
            finally:
                stop.set()
                sending.join()
    finally:
        sender.loop_stop()
        asyncio.run_coroutine_threadsafe(broker.shutdown(), loop).result(20)
        loop.call_soon_threadsafe(loop.stop)
        turning.join()
