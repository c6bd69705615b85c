"""What a page on many logs shows: tables, and bars above those that show a distribution."""

from collections.abc import Sequence
from typing import NamedTuple


class Bar(NamedTuple):
    """The distribution of the adhesion coefficient in a group of brake applications [-].

    Attributes:
        name: of the group.
        begin: where the bar begins: a speed [km/h], a time [ms since 1970], or a place.
        end: where it ends.
        low: 5 % of the values are below it.
        middle: the median.
        high: 95 % are below it.
        slid: the median of those with slides, NaN without one.
        number: of brake applications.
    """

    name: str
    begin: float
    end: float
    low: float
    middle: float
    high: float
    slid: float
    number: int


class Bars(NamedTuple):
    """A figure of groups.

    Attributes:
        label: what is along the figure, with its unit.
        bars: the groups.
        dated: whether they are along a calendar.
        named: whether the axis has their names in place of numbers.
    """

    label: str
    bars: Sequence[Bar]
    dated: bool = False
    named: bool = False


class Table(NamedTuple):
    """A table and its figure.

    Attributes:
        title: above it.
        rows: with the same keys, which are the header.
        left: how many columns are texts, from the left.
        figure: what is drawn above the table.
    """

    title: str
    rows: list[dict[str, str]]
    left: int = 1
    figure: Bars | None = None
