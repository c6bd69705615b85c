"""What channels and logs are called in a written file, and the unit of what is written."""

import json
import re
from collections.abc import Sequence
from pathlib import PurePath

from ..core import units
from ..core.model import Channel, Log, Meaning, Result
from ..core.text import distinct, printable
from ..core.toml import Table

SETTINGS = "adhesion.settings"  # metadata record with every parameter used
PROVENANCE = "adhesion.provenance"  # version, name and hash of the log, sources
METRICS = "adhesion.metrics"  # the JSON document of the run

_OF_DIMENSION: dict[units.Dimension, str] = {
    "time": "s",
    "pressure": "Pa",
    "speed": "m/s",
    "force": "N",
    "ratio": "-",
    "length": "m",
    "temperature": "K",
}
SI: dict[Meaning, str] = {x: _OF_DIMENSION[kinds[0]] for x, kinds in units.EXPECTED.items()}
SI |= {"wheel_speed": "rad/s", "latitude": "deg", "longitude": "deg"}  # of others: as logged


# Where a formula may begin: at the start of a cell, and, as programs differ in what parts cells,
# behind any separator, but for a number with its sign.
_FORMULA = re.compile(
    r"""^(?=[=+\-@＝＋－＠])|(?<=[;,\t|"])(?=[=@＝＠]|[-+－＋](?![\d.eE+-]+([;,\t|"]|$)))"""
)


def channels(log: Log) -> list[tuple[str, str]]:
    """Name and unit of each channel's values, both printable; SI where a channel has a meaning."""
    units = [
        SI.get(c.meaning, "") + "/s" * c.is_rate if c.meaning else c.unit for c in log.channels
    ]
    names = [_name(c, unit) for c, unit in zip(log.channels, units, strict=True)]
    return list(zip(distinct(names), map(printable, units), strict=True))


def logs(results: Sequence[Result]) -> list[str]:
    """A short name for each log: its file's stem; printable and distinct."""
    return distinct([printable(PurePath(r.log.path).stem) for r in results])


def flat(settings: Table, prefix: str = "") -> dict[str, str]:
    """Nested settings as dotted keys with JSON values, sorted."""
    dotted: dict[str, str] = {}
    for key, value in sorted(settings.items()):
        if isinstance(value, dict):
            dotted |= flat(value, f"{prefix}{key}.")
        else:
            dotted[prefix + key] = json.dumps(value, ensure_ascii=False)
    return dotted


def _name(channel: Channel, unit: str) -> str:
    name = channel.name if channel.field in ("", "value") else f"{channel.name}.{channel.field}"
    if channel.unit and channel.unit != unit:  # "p [kPa]" must not stay the name of pascals
        for bracketed in (f"[{channel.unit}]", f"({channel.unit})"):
            name = name.removesuffix(bracketed).rstrip()
    if channel.label:  # whose axle an element of a list is, only its label may say
        name = f"{name} {channel.label}"
    return printable(name)


def cell(text: str) -> str:
    """A cell that no spreadsheet takes for a formula, or for several cells with one."""
    return _FORMULA.sub("'", text)
