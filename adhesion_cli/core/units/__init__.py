"""Units as logs write them, and the unit in the name of a channel."""

from .names import contradicting, in_name, unknown_in, without_other_units
from .spelling import (
    ATMOSPHERE,
    EXPECTED,
    UNITS,
    Dimension,
    Unit,
    alternative_units,
    is_acceleration,
    known_units,
    rare_unit,
    stated_unit,
    unit,
    unit_for,
)

__all__ = [
    "ATMOSPHERE",
    "EXPECTED",
    "UNITS",
    "Dimension",
    "Unit",
    "alternative_units",
    "contradicting",
    "in_name",
    "is_acceleration",
    "known_units",
    "rare_unit",
    "stated_unit",
    "unit",
    "unit_for",
    "unknown_in",
    "without_other_units",
]
