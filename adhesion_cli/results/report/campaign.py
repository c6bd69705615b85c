"""What a page on many logs shows: tables, and bars above those that show a distribution."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from ..text_tables import TitledTable


class Bar(NamedTuple):
    """The distribution of the adhesion coefficient in a group of brake applications [-]."""

    name: str
    begin: float  # where the bar begins: a speed [km/h], a time [ms since 1970], or a place
    stop: float  # where it ends
    lower: float  # 5 % of the values are below it
    middle: float  # the median
    upper: float  # 95 % are below it
    slid: float  # the median of those with slides, NaN without one
    number: int  # of brake applications


class Bars(NamedTuple):
    """A figure of groups."""

    label: str  # what is along the figure, with its unit
    bars: Sequence[Bar]
    dated: bool = False  # whether they are along a calendar
    named: bool = False  # whether the axis has their names in place of numbers


class Campaign(NamedTuple):
    """A page on many logs."""

    name: str  # its heading
    verdict: str  # one line
    lead: str  # the sentence below it
    tables: Sequence[TitledTable]
    codes: Sequence[str] = ()  # of the findings that are explained
    about: Mapping[str, str] = {}  # how it was made, by the name of the fact
