"""Pieces that wait for the loop."""

import threading
import time

from adhesion_cli.live import feed
from adhesion_cli.live.feed import Pump


def test_the_oldest_pieces_are_dropped_where_more_come_than_may_wait() -> None:
    pieces, sent = iter(range(1, 10_000)), threading.Event()
    pump = Pump(lambda: next(pieces, None) or sent.set(), patient=False)
    assert sent.wait(60)
    time.sleep(0.1)
    arrived = [piece for piece in pump if piece]
    assert arrived == list(range(10_000 - len(arrived), 10_000))
    assert feed.WAITING[0] - 1 <= len(arrived) <= feed.WAITING[0]
    assert pump.dropped_count() == 9_999 - len(arrived)


def test_a_sender_that_waits_loses_nothing() -> None:
    pieces = iter(range(1, 10_000))
    pump = Pump(lambda: next(pieces, None), patient=True)
    time.sleep(0.1)
    assert pump._waiting.qsize() <= feed.WAITING[1]
    assert [piece for piece in pump if piece] == list(range(1, 10_000))
    assert pump.dropped_count() == 0
