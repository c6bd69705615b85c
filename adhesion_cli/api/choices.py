"""Keywords of a call: the settings and options of the command line, in the words of Python."""

import functools
import os
import re
import shlex
from collections.abc import Callable, Iterable, Mapping, Sequence
from numbers import Real
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar

import numpy as np

from ..analysis import request, settings
from ..core import toml
from ..core.errors import UserError, unknown
from ..core.toml import Table
from ..formats.memory import Signals

Source = str | os.PathLike[str] | Signals | Any
"""A log: the path of a file, `Signals`, or a table of pandas, pyarrow or polars."""
File = str | os.PathLike[str]
SettingsSources = File | Mapping[str, Any] | Sequence[File | Mapping[str, Any]] | None
"""Settings: a TOML file or its tables, or several, of which the later ones count."""

_P = ParamSpec("_P")
_T = TypeVar("_T")
_OPTIONS = re.compile(r"`?(?:--set (?:\"[^\"]*\"|[^\s;,`)\"]+) ?)+(?<! )`?")
_VALUE = re.compile(r"--(from|to|axle|dt|seed) (\d[\d.]*)")
_KEYWORD_OF_OPTION = {
    "--from": "from_s",
    "--to": "to_s",
    "--axle": "axles",
    "--algo": "algos",
    "--strict": "strict=True",
    "--force": "force=True",
    "--out": "folder",
    "-c FILE.toml": "settings='FILE.toml'",
}


class Choices(NamedTuple):
    """What a run is asked for, checked."""

    settings: settings.Settings
    algos: list[str]
    axles: list[int]
    window: tuple[float | None, float | None]


def choices(  # noqa: PLR0913 (the keywords of a call)
    sources: SettingsSources,
    sections: Table,
    keywords: Sequence[str],
    strict: bool = False,
    span: tuple[float | None, float | None] = (None, None),
    reference: str | None = None,
    axles: int | Iterable[int] = (),
    algos: str | Iterable[str] = (),
) -> Choices:
    """Settings and options from the keywords of a call.

    `sections` are further keywords: each a section of the settings, or a vehicle parameter. An
    unknown one may have meant one of `keywords`. `span` is seconds after the log's start, from and
    to.

    Raises:
        UserError: for an unknown name, a value out of range.
    """
    section_names = settings.sections()
    vehicle = settings.vehicle_keys()
    for name in sections:
        if name not in section_names and name not in vehicle:
            raise unknown("keyword", name, [*keywords, *section_names])
        if name in section_names and not isinstance(sections[name], Mapping | None):
            hint = f"give its keys, as {name}={{'KEY': value}}"
            raise UserError(f"{name}={sections[name]!r} is no table", hint, code=2)
    tables = [_table(name, {name: table}) for name, table in sections.items() if table is not None]
    if reference is not None:
        tables.append({"analysis": {"reference": reference}})
    is_single = isinstance(sources, str | os.PathLike | Mapping)
    source_list: list[Any] = [sources] if is_single else list(sources or ())  # type: ignore[arg-type]
    files = [_table("settings", x) if isinstance(x, Mapping) else Path(x) for x in source_list]
    checked = settings.load(files, tables, strict=strict)
    names = [algos] if isinstance(algos, str) else list(algos)
    chosen = Choices(checked, names, axles_of(axles), _span(span))
    request.check_request(checked, chosen.algos, chosen.window)
    return chosen


def log_of(source: Source) -> Path | Signals:
    """What a call was given as a log.

    Raises:
        UserError: where it is neither a path nor a table.
    """
    if isinstance(source, Signals):
        return source
    if isinstance(source, str | os.PathLike):
        return Path(source)
    if isinstance(source, list | tuple):
        hint = "call it for each log; `compare` and `calibrate` take several"
        raise UserError(f"one log is expected, not a {type(source).__name__}", hint, code=2)
    return Signals.from_table(source)


def logs_of(sources: Any) -> list[Path | Signals]:
    """The logs of a call that takes several: one, or a list or tuple of them.

    Raises:
        UserError: as `log_of`, and where there is none.
    """
    source_list = list(sources) if isinstance(sources, list | tuple) else [sources]
    if not source_list:
        raise UserError("no log given", "give the path of a log, or a list of paths", code=2)
    return [log_of(source) for source in source_list]


def in_python(function: Callable[_P, _T]) -> Callable[_P, _T]:
    """The same function, whose errors name keywords in place of options of the command line."""

    @functools.wraps(function)
    def run(*args: _P.args, **kwargs: _P.kwargs) -> _T:
        try:
            return function(*args, **kwargs)
        except UserError as error:
            raise UserError(as_keywords(error.text), as_keywords(error.hint), error.code) from None

    return run


def as_keywords(text: str) -> str:
    """A message of the command line with its options as keywords.

    >>> as_keywords("state it, as `--set csv.decimal=comma`, or leave out --strict")
    "state it, as csv={'decimal': 'comma'}, or leave out strict=True"
    """
    text = _OPTIONS.sub(_keywords, text)
    text = _VALUE.sub(lambda m: f"{_KEYWORD_OF_OPTION.get(f'--{m[1]}', m[1])}={m[2]}", text)
    for option, word in _KEYWORD_OF_OPTION.items():
        text = text.replace(option, word)
    return text


def _keywords(options: re.Match[str]) -> str:
    """Some `--set` as keywords; what states nothing stays."""
    try:
        arguments = shlex.split(options[0].strip("`"))
        tables = settings.merged(word for word in arguments if word != "--set")
    except (UserError, ValueError):
        return options[0]
    return ", ".join(f"{name}={value!r}" for name, value in tables.items())


def _table(origin: str, tables: Mapping[str, Any]) -> Table:
    return toml.bounded(_as_toml(tables), origin)


def _as_toml(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {str(key): _as_toml(item) for key, item in value.items()}
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    return [_as_toml(item) for item in value] if isinstance(value, list | tuple) else value


def axles_of(axles: Any) -> list[int]:
    """Numbers of axles, of which a call names one or several.

    Raises:
        UserError: for what is no number from 1.
    """
    numbers: list[Any] = [axles] if isinstance(axles, Real) else list(axles)
    if not all(isinstance(number, int | np.integer) and number >= 1 for number in numbers):
        raise UserError(f"axles={axles!r} are no axles", "axles count from 1, as [1, 3]", code=2)
    return [int(number) for number in numbers]


def _span(span: tuple[Any, Any]) -> tuple[float | None, float | None]:
    for name, value in zip(("from_s", "to_s"), span, strict=True):
        if value is not None and not isinstance(value, Real):
            hint = "seconds after the log's start, as 12.5"
            raise UserError(f"{name}={value!r} is no number", hint, code=2)
    from_s, to_s = (None if x is None else float(x) for x in span)
    return from_s, to_s
