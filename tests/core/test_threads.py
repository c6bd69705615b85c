"""Work on several processors gives what one after the other gives."""

import threading

import pytest

from adhesion_cli.core import threads


@pytest.mark.parametrize("most", [1, 2, 8])
def test_results_are_in_order(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "max_threads", most)
    assert threads.run_each(lambda x: x * x, range(20)) == [x * x for x in range(20)]
    assert threads.run_each(str, []) == []


def test_two_are_in_work_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "max_threads", 2)
    both = threading.Barrier(2, timeout=60.0)
    assert sorted(threads.run_each(lambda _: both.wait(), [0, 1])) == [0, 1]


@pytest.mark.parametrize("most", [1, 2])
def test_the_first_error_in_order_is_raised(most: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(threads, "max_threads", most)

    def fails(x: int) -> int:
        if x > 2:
            raise ValueError(str(x))
        return x

    with pytest.raises(ValueError, match=r"^3$"):
        threads.run_each(fails, range(9))
