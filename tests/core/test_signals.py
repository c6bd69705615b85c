"""What signals say by themselves."""

import pytest
from scipy.special import stdtrit

from adhesion_cli.core.signals import coverage_factor


@pytest.mark.parametrize(
    ("freedom", "share"), [(1, 0.4), (2, 0.05), (3, 0.012), (5, 0.003), (10, 1e-3), (1e6, 1e-5)]
)
def test_coverage_factor_is_students(freedom: float, share: float) -> None:
    exact = stdtrit(freedom, 0.975)
    assert exact * (1 - 1e-6) < coverage_factor(freedom) < exact * (1 + share)
