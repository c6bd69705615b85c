"""The vehicle that a result file carries, from its dotted settings."""

import json
import re
from collections.abc import Mapping

from ..core.model import Parameter

_AXLES = ".axles"


def parameter(settings: Mapping[str, str], name: str, axle: int) -> Parameter:
    """A vehicle parameter of an axle, from dotted keys with JSON values."""
    section, place = _place(settings, axle)
    key = f"{section}.{name}"
    if several := settings.get(key):
        entries = json.loads(several)
        entry = entries[place if len(entries) > 1 else 0]
        return Parameter(float(entry["value"]), float(entry["tolerance"]))
    return Parameter(*(float(json.loads(settings[f"{key}.{x}"])) for x in Parameter._fields))


def correlation(settings: Mapping[str, str], axle: int) -> tuple[tuple[str, str, float], ...]:
    """Of the errors of two parameters of an axle."""
    head = f"{_place(settings, axle)[0]}.correlation."
    pairs = {k.removeprefix(head): v for k, v in settings.items() if k.startswith(head)}
    return tuple((*pair.split("."), float(v)) for pair, v in pairs.items())  # type: ignore[misc]


def parameter_title(name: str) -> str:
    """A parameter's name for people: `discs` counts clamping forces, of discs times their pads."""
    return re.sub(r"\bdiscs\b", "clamping forces", name).replace("_", " ")


def is_of_vehicle(key: str) -> bool:
    """Whether a dotted key states the vehicle."""
    return key.startswith(("vehicle.", "car."))


def _place(settings: Mapping[str, str], axle: int) -> tuple[str, int]:
    """The section that states an axle, and the axle's place in its lists."""
    for key, value in settings.items():
        if key.startswith("car.") and key.endswith(_AXLES):
            numbers = json.loads(value)
            if axle in numbers:
                return key.removesuffix(_AXLES), numbers.index(axle)
    return "vehicle", axle - 1
