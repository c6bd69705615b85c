"""Samples for Foxglove."""

import json

import pytest
from helpers.live_runs import (
    samples_of,
)

from adhesion_cli.core.model import Vehicle


def test_foxglove_gets_the_topics_of_an_axle_that_comes_later() -> None:
    pytest.importorskip("foxglove")
    sync = pytest.importorskip("websockets.sync.client")
    from adhesion_cli.live.served import Served

    served, (sample,) = Served(0, Vehicle(), [1], ["td", "imm"]), samples_of(1)
    served.take([sample, sample._replace(axle=2)])
    try:
        with sync.connect(served.url, subprotocols=["foxglove.sdk.v1"]) as client:
            told = [json.loads(client.recv(timeout=20)) for _ in range(2)]
    finally:
        served.close()
    topics = {c["topic"] for one in told for c in one.get("channels", [])}
    of = ("input", "slip", "estimate/td", "estimate/imm")
    assert topics == {f"/axle/{n}/{t}" for n in (1, 2) for t in of}
