"""Errors as the user sees them."""

import pytest

from adhesion_cli.core.errors import as_user_error


@pytest.mark.parametrize(
    "error",
    [MemoryError(), ImportError("x.so: failed to map segment from shared object"),
     RuntimeError("cannot compress: Allocation error : not enough memory"),
     RuntimeError("Failed to spawn background thread 'a': Resource temporarily unavailable")],
)  # fmt: skip
def test_a_library_without_memory_is_no_internal_error(error: Exception) -> None:
    told = as_user_error(error)
    assert told.text == "out of memory"
    assert "ulimit -v unlimited" in told.hint
    assert as_user_error(ValueError("x")).text.startswith("internal error")
