"""Frames of a CAN bus."""

import threading
from collections.abc import Sequence
from pathlib import Path

import pytest
from helpers.live_runs import Kept

from adhesion_cli.analysis.request import choose_estimators
from adhesion_cli.analysis.settings import load
from adhesion_cli.core.errors import UserError
from adhesion_cli.live.axle import LiveSample
from adhesion_cli.live.feed import Feed
from adhesion_cli.live.open import open_feed
from adhesion_cli.live.run import Tally, follow
from adhesion_cli.live.wheels import LiveWheels


class Frames(Kept):
    """Ends the feed soon after the 250th sample, so that one too many would be seen."""

    def __init__(self, feed: Feed) -> None:
        super().__init__()
        self._timer = threading.Timer(0.5, feed.close)

    def take(self, samples: Sequence[LiveSample]) -> None:
        super().take(samples)
        if len(self.of[1]) == 250:
            self._timer.start()


def test_frames_of_a_bus_are_decoded_by_the_dbc(tmp_path: Path) -> None:
    can = pytest.importorskip("can")
    cantools = pytest.importorskip("cantools")
    dbc = tmp_path / "train.dbc"
    dbc.write_text(
        'VERSION ""\nBS_:\nBU_: BCU\n'
        "BO_ 256 Brake: 4 BCU\n"
        ' SG_ bc_pressure_1 : 0|16@1+ (0.01,0) [0|10] "bar" BCU\n'
        ' SG_ wheel_speed_1 : 16|16@1+ (0.01,0) [0|300] "km/h" BCU\n'
    )
    message = cantools.database.load_file(dbc).get_message_by_name("Brake")
    settings = load(assignments=[f'can.dbc = ["{dbc}"]'])
    feed = open_feed("can:virtual:live", settings.read)
    with can.Bus(interface="virtual", channel="live") as sender:
        for k in range(250):
            said = {"bc_pressure_1": 2.0, "wheel_speed_1": 80.0 - 0.1 * k}
            frame = can.Message(
                arbitration_id=256, is_extended_id=False, data=message.encode(said),
                timestamp=1e9 + 0.01 * k,
            )  # fmt: skip
            sender.send(frame)
        sender.send(can.Message(arbitration_id=257, is_extended_id=False, data=b"\0"))
        kept, tally = Frames(feed), Tally(lambda _: None)
        algos = {e.name: (e, settings.params(e)) for e in choose_estimators(["imm"])}
        wheels = LiveWheels(feed.head(), settings.mappings, settings.vehicle, ())
        follow(feed, wheels, settings, algos, [kept], tally)
    assert len(kept.of[1]) == 250
    assert kept.of[1][100].speed == pytest.approx(70.0 / 3.6 / settings.vehicle.radius(1).value)
    assert kept.of[1][100].pressure == pytest.approx(2e5)


def test_a_bus_that_goes_down_is_no_internal_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    can = pytest.importorskip("can")
    pytest.importorskip("cantools")
    dbc = tmp_path / "train.dbc"
    dbc.write_text('VERSION ""\nBS_:\nBU_: BCU\n')

    def recv(*_: object, **__: object) -> None:
        raise can.CanOperationError("Network is down")

    monkeypatch.setattr("can.interfaces.virtual.VirtualBus.recv", recv)
    feed = open_feed("can:virtual:down", load(assignments=[f'can.dbc = ["{dbc}"]']).read)
    with pytest.raises(UserError, match=r"down: .*any more: Network is down"):
        feed.head()
    feed.close()
