"""Pieces that wait for the loop."""

import threading
import time

from adhesion_cli.live import feed
from adhesion_cli.live.feed import Pump


def test_the_oldest_pieces_are_dropped_where_more_bytes_come_than_may_wait() -> None:
    pieces, sent = iter(range(200)), threading.Event()

    def take() -> bytes | None:
        n = next(pieces, None)
        if n is None:
            sent.set()
        return None if n is None else n.to_bytes(1, "big") * (1 << 20)

    pump = Pump(take, patient=False)
    assert sent.wait(60)
    assert sum(map(len, pump._waiting)) <= feed.WAITING[1]
    arrived = [piece[0] for piece in pump if piece]
    assert arrived == list(range(200 - len(arrived), 200))
    assert len(arrived) >= 60
    assert pump.dropped_count() == 200 - len(arrived)


def test_so_they_are_where_more_pieces_come() -> None:
    pieces = iter(range(1, 10_000))
    pump = Pump(lambda: next(pieces, None), patient=False)
    while not pump._has_ended:
        time.sleep(0.01)
    arrived = [piece for piece in pump if piece]
    assert arrived == list(range(10_000 - feed.WAITING[0], 10_000))


def test_a_sender_that_waits_loses_nothing() -> None:
    pieces = iter(range(1, 10_000))
    pump = Pump(lambda: next(pieces, None), patient=True)
    time.sleep(0.1)
    assert len(pump._waiting) <= feed.WAITING[0]
    assert [piece for piece in pump if piece] == list(range(1, 10_000))
    assert pump.dropped_count() == 0
