"""Numbers without digits that say nothing."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from adhesion_cli.core import rounding

NUMBERS = st.floats(-1e12, 1e12)
SIGMAS = st.floats(1e-9, 1e9)


@given(NUMBERS, SIGMAS)
def test_a_number_changes_by_less_than_its_uncertainty_shows(x: float, sigma: float) -> None:
    (kept,) = rounding.rounded(np.array([x]), sigma)
    assert abs(kept - x) <= sigma / 32.0
    step = 2.0 ** np.floor(np.log2(sigma / 16.0))  # the next one down is less than half as coarse
    assert kept == 0.0 or kept % (step / 2.0) == 0.0
    assert rounding.rounded(np.array([kept]), sigma) == kept


@given(st.lists(st.tuples(NUMBERS, SIGMAS), min_size=1, max_size=20))
def test_each_number_has_its_own_step(rows: list[tuple[float, float]]) -> None:
    x, sigma = np.array(rows).T
    each = [rounding.rounded(x[i : i + 1], sigma[i : i + 1])[0] for i in range(len(x))]
    np.testing.assert_array_equal(rounding.rounded(x, sigma), each)


@given(NUMBERS, st.sampled_from([0.0, -1.0, np.nan, np.inf]))
def test_without_an_uncertainty_a_number_stays(x: float, sigma: float) -> None:
    assert rounding.rounded(np.array([x]), np.array([sigma])) == x


@given(NUMBERS)
def test_digits_are_of_a_numbers_own_size(x: float) -> None:
    assert abs(rounding.digits(np.array([x]))[0] - x) <= abs(x) / 512.0


def test_what_is_not_known_stays_unknown() -> None:
    assert np.isnan(rounding.rounded(np.array([np.nan]), 1.0)).all()
    assert np.isinf(rounding.digits(np.array([np.inf, -np.inf]))).all()
