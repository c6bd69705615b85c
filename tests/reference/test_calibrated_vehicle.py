"""What the logs of a train say of its vehicle, and how far they can be trusted."""

from adhesion_cli.core.model import Train
from adhesion_cli.reference.calibrated_vehicle import Evidence, train_by


def alike(*delays: float) -> float:
    return train_by([Evidence(None, (), delay) for delay in delays], Train(alike=0.03)).alike


def test_a_late_signal_may_be_a_filtered_one_which_shows_another_force() -> None:
    """Wheel speeds of a first-order filter of 0.3 s showed 7 % less, and a delay of 0.24 s."""
    assert alike(0.0) == 0.03
    assert 0.035 < alike(0.24) == alike(-0.24, 0.1) < 0.07
    assert alike(0.12) < alike(0.24) < alike(0.4)
    assert alike(3.0) == alike(0.45)  # a clock is late without a filter
    assert alike(-0.6) > 2.0 * alike(0.6)  # other cars brake later
