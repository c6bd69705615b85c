"""An ED force that is spread over axles whose cylinders show that they have no ED brake."""

import numpy as np

from adhesion_cli.analysis.prepare import prepare
from adhesion_cli.analysis.settings import load
from adhesion_cli.channels.log import read
from adhesion_cli.core.finding import Finding
from adhesion_cli.formats.memory import MemorySource, Signals

T = np.arange(0.0, 60.0, 0.1)
ED = np.interp(T, [10.0, 11.0, 30.0, 32.0], [0.0, 40.0, 40.0, 0.0])  # of all motors [kN]


def findings(blended: tuple[int, ...], *settings: str, track_brake: bool = False) -> list[Finding]:
    """On a stop of four axles of 12 t, some of which lose their pressure to the ED brake."""
    demand = np.interp(T, [10.0, 11.0], [0.0, 2.0])
    signals = {}
    for axle in (1, 2, 3, 4):
        share = ED / 40.0 if axle in blended else 0.0
        signals[f"BCP {axle} [bar]"] = demand * (1.0 - share)
        signals[f"axle {axle} [km/h]"] = 3.6 * np.maximum(22.0 - 0.08 * np.cumsum(demand / 2.0), 0)
    signals["ED brake force [kN]"] = ED
    if track_brake:
        signals["magnetic track brake on [-]"] = 1.0 * (T > 10.0)
    loaded = load(assignments=["vehicle.axle_mass=12000", *settings], folder=False)
    log = read(MemorySource(Signals(T, signals)), loaded.mappings, loaded.vehicle)
    return [f for f in prepare(log, loaded.vehicle).findings if f.code == "ed-force-axles"]


def test_axles_that_keep_their_pressure_have_no_part_in_the_ed_force() -> None:
    (finding,) = findings((1, 2))
    assert finding.names == {"blended": "1, 2", "others": "3, 4"}
    entry = '{channel = "ED brake force [kN]", axles = [1, 2]}'
    assert findings((1, 2), track_brake=True) == [finding]
    assert not findings((1, 2), f"channels.ed_force.vehicle={entry}")
    assert not findings((1, 2, 3, 4))  # all axles have motors
    assert not findings(())  # the driver takes the pressure off, or none
