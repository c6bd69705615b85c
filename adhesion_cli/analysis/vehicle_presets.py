"""Vehicles as a TOML to start from: typical values, each key with unit and place on a data sheet.

The values are typical of their kind and of no train: whoever takes one replaces them by those of
the data sheets. Friction: see `stated_friction`. `paper` is the default vehicle, by parameters of
(15).
"""

from pathlib import Path

from ..core.errors import unknown

_BUNDLED = Path(__file__).parent / "vehicles"
_NAMES = ("disc", "tread", "metro", "tram", "coach", "wagon", "paper")


def names() -> dict[str, str]:
    """What each preset is, by its name: the first sentence of its TOML."""
    heads = {name: preset_toml(name).partition(". ")[0] for name in _NAMES}
    return {name: head.removeprefix("# Vehicle: ") for name, head in heads.items()}


def preset_toml(name: str) -> str:
    """A commented TOML of a vehicle.

    Raises:
        UserError: for an unknown name.
    """
    if name not in _NAMES:
        raise unknown("vehicle", name, list(_NAMES))
    return (_BUNDLED / f"{name}.toml").read_text(encoding="utf-8")
