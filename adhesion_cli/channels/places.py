"""Which axles a channel serves, by the car, the control unit, the bogie and the axle in its name.

One channel may be a bogie's or a car's. Where each car counts its axles from 1, they are counted on
over the cars. Where the names do not say which axles a pressure serves, the user is asked.
"""

import re
from collections.abc import Iterable, Mapping
from itertools import accumulate
from typing import NamedTuple

from ..core.model import INPUTS, OTHER_BRAKES, Meaning
from .rules import Place

_OF_AXLES = INPUTS - {"train_speed", *OTHER_BRAKES}
UNCLEAR = "its name does not say which axles it serves"


class Served(NamedTuple):
    """The axles of a channel; none for every axle, None where its name does not say which."""

    axles: tuple[int, ...] | None
    counted_on: bool = False  # over the cars, so it is not the number in its name


def bogie_axles(bogie: int, count: int = 2) -> tuple[int, ...]:
    """The axles of a bogie with so many."""
    return tuple(range(count * (bogie - 1) + 1, count * bogie + 1))


def served(channels: Mapping[int, tuple[Meaning, Place]]) -> dict[int, Served]:
    """The axles that each channel serves, of its meaning and place; no other meanings'."""
    places = {i: place for i, (meaning, place) in channels.items() if meaning in _OF_AXLES}
    places = _counted_in_bogies(places)
    speeds = {i: p for i, p in places.items() if channels[i][0] == "wheel_speed"}
    pressures = {i: p for i, p in places.items() if channels[i][0] == "pressure"}
    numbers = _axles_of_parts(speeds.values())
    repeats = sum(map(len, numbers.values())) > len(set().union(*numbers.values()))
    counts = [max(axles) * repeats for axles in numbers.values()]
    offsets = dict(zip(numbers, accumulate(counts, initial=0), strict=False))
    bogies = {(p.part, p.bogie) for p in pressures.values() if p.bogie and p.axle is None}
    repeated_bogies = len({b for _, b in bogies}) < len(bogies)
    # parts with six axles in bogies 1 and 2: a Co'Co'
    of_three = {x for x in numbers if {b for y, b in bogies if x == y} == {1, 2}}
    of_three = {x for x in of_three if len(numbers[x]) == 6}
    axles: dict[int, Served] = {}
    for i, p in places.items():
        offset = offsets.get(p.part, 0)
        word_place = [n + offset for n in sorted(numbers.get(p.part, ()))]
        if p.axle is not None:
            own_number: tuple[int, ...] = (p.axle + offset,)
        elif p.bogie:
            numbers_in_car = bogie_axles(p.bogie, 3 if p.part in of_three else 2)
            bogie = tuple(n + offset for n in numbers_in_car)
            own_number = tuple(n for n in bogie if n in word_place) or bogie
            if repeated_bogies:
                own_number = tuple(word_place[numbers_in_car[0] - 1 : numbers_in_car[-1]])
        else:
            own_number = tuple(word_place) if len(numbers) > 1 else ()
        axles[i] = Served(own_number, offset > 0)
    if _are_unclear(pressures, numbers, axles):
        axles |= dict.fromkeys(pressures, Served(None))
    return axles


def _counted_in_bogies(places: Mapping[int, Place]) -> dict[int, Place]:
    """The places; where each bogie counts its axles from 1, they are counted on over the bogies."""
    pairs = {(p.part, p.bogie, p.axle) for p in places.values() if p.bogie and p.axle is not None}
    if len({(word, axle) for word, _, axle in pairs}) == len(pairs):
        return dict(places)
    in_bogies = {i: (p.bogie, p.axle) for i, p in places.items() if p.bogie and p.axle}
    axles = {i: 2 * (bogie - 1) + axle for i, (bogie, axle) in in_bogies.items()}
    return {**places, **{i: places[i]._replace(axle=x, bogie=None) for i, x in axles.items()}}


def _axles_of_parts(speeds: Iterable[Place]) -> dict[str, set[int]]:
    """The axles of each car, or of what a control unit serves, by its wheel speeds."""
    numbers: dict[str, set[int]] = {}
    for p in speeds:
        of_bogie = bogie_axles(p.bogie) if p.bogie else (1,)
        numbers.setdefault(p.part, set()).update(of_bogie if p.axle is None else (p.axle,))
    names = {re.sub(r"\d+$", "", word) for word in numbers}
    if len(names) == 1:
        by_number = sorted(numbers, key=lambda word: int((re.search(r"\d+$", word) or "0")[0]))
        return {word: numbers[word] for word in by_number}
    return numbers  # in the order of the log


def _are_unclear(
    pressures: Mapping[int, Place], numbers: Mapping[str, set[int]], axles: Mapping[int, Served]
) -> bool:
    """Whether the names do not say which axles the pressures serve."""
    if len(pressures) < 2:
        return False
    words = {p.part for p in pressures.values()}
    own_places = {(p.axle, p.bogie) for p in pressures.values()}
    counted = sum(map(len, numbers.values()))
    if len(numbers) > 1:
        served_axles = {n for i in pressures for n in axles[i].axles or ()}
        if not words <= numbers.keys() and len(served_axles) != counted:
            return True
    elif len(words) > 1 and (len(own_places) < len(pressures) or (None, None) in own_places):
        return True
    # As in "BCP M1/1": the last number may be that of a bogie or of an axle.
    return all(p.part and p.is_loose for p in pressures.values()) and counted == 2 * len(pressures)
