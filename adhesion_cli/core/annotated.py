"""Classes whose fields state unit and meaning: JSON, tables and pages follow from the annotations.

A field is `Annotated[type, Quantity(unit, text)]`. Where it is a class itself, as the mean and the
highest value of a force, its numbers have the unit of the field, unless they state their own. A
field with `model.NOT_IN_JSON` as metadata is for programs only.
"""

import typing
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, Field, fields, is_dataclass
from functools import cache
from types import UnionType
from typing import Annotated, Any, get_args, get_origin

from .model import Quantity

Json = dict[str, Any]  # what `json.dumps` takes
Progress = Callable[[str], None]  # receives a line at each step
T = typing.TypeVar("T")


class FieldColumn(typing.NamedTuple):
    """One number, text or truth value of a class, also deep inside of it."""

    name: str  # names of all fields on the way, joined with `_`
    type: Any  # float, int, str, bool or datetime
    unit: str
    text: str
    path: tuple[str, ...]


def as_json(value: Any) -> Any:
    """A value as JSON has it: classes as tables, tuples as lists."""
    if is_dataclass(value) and not isinstance(value, type):
        return {f.name: as_json(getattr(value, f.name)) for f in _fields(type(value))}
    if hasattr(value, "_asdict"):
        return {name: as_json(x) for name, x in value._asdict().items()}
    if isinstance(value, Mapping):
        return {name: as_json(x) for name, x in value.items()}
    return [as_json(x) for x in value] if isinstance(value, tuple | list) else value


def from_json(cls: type[T], document: Mapping[str, Any]) -> T:
    """The object that `as_json` made a table of; a KeyError for what must be there."""
    return typing.cast("T", _read(cls, document))


@cache
def columns(cls: Any) -> tuple[FieldColumn, ...]:
    """The columns of a table of such objects without lists; a pair gives `_low` and `_high`."""
    return tuple(_columns(cls, "", ()))


def flat(value: Any) -> dict[str, Any]:
    """An object as a row of such a table; None where a part of it is not there."""
    return {
        column.name: _follow(value, column.path)
        for column in columns(typing.cast("Any", type(value)))
    }


def _fields(cls: Any) -> "tuple[Field[Any], ...]":
    return tuple(f for f in fields(cls) if f.metadata.get("in_json", True))


def names(cls: type) -> dict[str, bool]:
    """The fields that are in JSON, and whether each must be there."""
    if is_dataclass(cls):
        return {f.name: f.default is MISSING and f.default_factory is MISSING for f in _fields(cls)}
    defaults = cls._field_defaults  # type: ignore[attr-defined]
    return {name: name not in defaults for name in cls._fields}  # type: ignore[attr-defined]


@cache
def hints(cls: Any) -> dict[str, Any]:
    """The types of its fields, with their annotations."""
    return typing.get_type_hints(cls, include_extras=True)


def plain(hint: Any) -> tuple[Any, Quantity | None]:
    """A type without None and without its annotation, and that annotation."""
    quantity = None
    if get_origin(hint) is Annotated:
        hint, *extras = get_args(hint)
        quantity = next((x for x in extras if isinstance(x, Quantity)), None)
    if get_origin(hint) in (typing.Union, UnionType):
        hint = next(x for x in get_args(hint) if x is not type(None))
    return hint, quantity


def is_class(hint: Any) -> bool:
    """Whether a type is a class with fields."""
    return isinstance(hint, type) and (is_dataclass(hint) or hasattr(hint, "_fields"))


def _read(hint: Any, value: Any) -> Any:
    kind, _ = plain(hint)
    if value is None:
        return None
    if is_class(kind):
        return kind(**{
            name: _read(hints(kind)[name], value[name])
            for name, needed in names(kind).items()
            if needed or name in value
        })  # fmt: skip
    if get_origin(kind) is tuple:
        item, *rest = get_args(kind)
        return tuple(_read(item, x) for x in value) if rest == [...] else tuple(value)
    return value


def _columns(cls: type, unit: str, path: tuple[str, ...]) -> Iterator[FieldColumn]:
    for name in names(cls):
        kind, quantity = plain(hints(cls)[name])
        unit_here, text = (quantity.unit or unit, quantity.text) if quantity else (unit, "")
        field_path = (*path, name)
        if is_class(kind):
            yield from _columns(kind, unit_here, field_path)
        elif get_origin(kind) is tuple and len(get_args(kind)) == 2 and get_args(kind)[1] is float:
            for place, bound_name in enumerate(("low", "high")):
                bound_path = (*field_path, str(place))
                yield FieldColumn(
                    "_".join((*field_path, bound_name)), float, unit_here, text, bound_path
                )
        elif isinstance(kind, type) and get_origin(kind) is None:
            yield FieldColumn(
                "_".join(field_path), kind, unit_here if kind is float else "", text, field_path
            )
        elif get_origin(kind) not in (tuple, dict, Mapping):  # a Literal
            yield FieldColumn("_".join(field_path), str, "", text, field_path)


def _follow(value: Any, path: tuple[str, ...]) -> Any:
    for name in path:
        if value is None:
            return None
        value = value[int(name)] if name.isdecimal() else getattr(value, name)
    return value
