"""What a page on many logs shows: tables, and bars above those that show a distribution."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple


class Bar(NamedTuple):
    """The distribution of the adhesion coefficient in a group of brake applications [-].

    Attributes:
        name: of the group.
        begin: where the bar begins: a speed [km/h], a time [ms since 1970], or a place.
        stop: where it ends.
        lower: 5 % of the values are below it.
        middle: the median.
        upper: 95 % are below it.
        slid: the median of those with slides, NaN without one.
        number: of brake applications.
    """

    name: str
    begin: float
    stop: float
    lower: float
    middle: float
    upper: float
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


class PageTable(NamedTuple):
    """A table and its figure.

    Attributes:
        title: above it.
        rows: with the same keys, which are the header.
        text_columns: how many columns are texts, from the left.
        figure: what is drawn above the table.
        note: what its columns mean.
        links: places on the page, by the text of a cell.
        marked: the column in colour.
    """

    title: str
    rows: list[dict[str, str]]
    text_columns: int = 1
    figure: Bars | None = None
    note: str = ""
    links: Mapping[str, str] = {}
    marked: str = ""


class Campaign(NamedTuple):
    """A page on many logs.

    Attributes:
        name: its heading.
        verdict: one line.
        lead: the sentence below it.
        tables: with their figures.
        codes: of the findings that are explained.
        about: how it was made, by the name of the fact.
    """

    name: str
    verdict: str
    lead: str
    tables: Sequence[PageTable]
    codes: Sequence[str] = ()
    about: Mapping[str, str] = {}
