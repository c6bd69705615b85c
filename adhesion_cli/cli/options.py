"""The options every command shares, declared once."""

import functools
import inspect
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

if TYPE_CHECKING:
    from ..model import Log

Logs = Annotated[list[Path], typer.Argument(metavar="LOG", help="Logs: CSV, MCAP or results.")]


def _option(*flags: str, text: str, metavar: str | None = None, low: int | None = None) -> Any:
    return typer.Option(*flags, help=text, metavar=metavar, min=low, show_default=False)


@dataclass(frozen=True, slots=True)
class Shared:
    """What the shared options say."""

    config: Annotated[Path | None, _option("-c", "--config", metavar="FILE.toml", text="Vehicle, channels, estimator settings.")] = None  # fmt: skip  # noqa: E501
    set_: Annotated[list[str], _option("--set", metavar="NAME=VALUE", text="One setting, as neso.beta1=100 or vehicle.phi=0.28; repeatable.")] = ()  # type: ignore[assignment]  # fmt: skip  # noqa: E501
    out: Annotated[Path | None, _option("-o", "--out", metavar="DIR", text="Folder for the results; the current one if not given.")] = None  # fmt: skip  # noqa: E501
    algo: Annotated[list[str], _option("-a", "--algo", metavar="NAME", text="Only this estimator; repeatable.")] = ()  # type: ignore[assignment]  # fmt: skip  # noqa: E501
    reference: Annotated[str | None, _option("--reference", metavar="NAME", text="Offline reference: smoother (default) or butterworth.")] = None  # fmt: skip  # noqa: E501
    axle: Annotated[list[int], _option("--axle", metavar="N", text="Only this axle; repeatable.", low=1)] = ()  # type: ignore[assignment]  # fmt: skip  # noqa: E501
    from_: Annotated[float | None, _option("--from", metavar="S", text="Begin S seconds after the log's start.")] = None  # fmt: skip  # noqa: E501
    to: Annotated[float | None, _option("--to", metavar="S", text="End S seconds after the log's start.")] = None  # fmt: skip  # noqa: E501
    json: Annotated[bool, _option("--json", text="One JSON document on stdout, nothing else.")] = False  # fmt: skip  # noqa: E501
    force: Annotated[bool, _option("--force", text="Replace existing results.")] = False
    strict: Annotated[bool, _option("--strict", text="Damaged data is an error, not a finding.")] = False  # fmt: skip  # noqa: E501
    rejects: Annotated[Path | None, _option("--rejects", metavar="FILE.csv", text="Write each row and cell left out of CSV logs here.")] = None  # fmt: skip  # noqa: E501
    quiet: Annotated[bool, _option("-q", "--quiet", text="No messages but errors.")] = False
    debug: Annotated[bool, _option("--debug", text="Show the traceback of an error.")] = False
    view: Annotated[bool, _option("--view", text="Open the result in the Rerun viewer.")] = False


ALWAYS = ("quiet", "debug")  # every command has these; `app` honours --debug
EVERY = tuple(f.name for f in fields(Shared) if f.name not in ALWAYS)  # what an analysis takes


def shared(*names: str) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Gives a command these of the shared options, and no others: what it ignored would mislead.

    The command receives them as one `Shared` named `shared`; those it does not have are unset.

    Args:
        names: fields of `Shared`.
    """
    hints = get_type_hints(Shared, include_extras=True)
    options = {f.name: f for f in fields(Shared) if f.name in (*names, *ALWAYS)}
    extra = [
        inspect.Parameter(
            name,
            inspect.Parameter.KEYWORD_ONLY,
            default=[] if f.default == () else f.default,
            annotation=hints[name],
        )
        for name, f in options.items()
    ]

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        own = [p for n, p in inspect.signature(command).parameters.items() if n != "shared"]

        @functools.wraps(command)
        def run(**given: Any) -> int:
            values = {name: given.pop(name) for name in options}
            return command(shared=Shared(**values), **given)

        run.__signature__ = inspect.Signature([*own, *extra])  # type: ignore[attr-defined]
        own_hints = get_type_hints(command, include_extras=True)
        run.__annotations__ = {p.name: own_hints.get(p.name, p.annotation) for p in (*own, *extra)}
        return run

    return decorate


def loader(shared: Shared) -> Callable[..., Any]:
    """Reads the settings these options state; called again with a result file's own as `base`."""
    from ..settings import load

    flags = [f'analysis.reference="{shared.reference}"'] if shared.reference else []
    return functools.partial(
        load, shared.config, [*shared.set_, *flags], strict=shared.strict,
        rejects=shared.rejects is not None,
    )  # fmt: skip


def targets(shared: Shared, paths: Sequence[Path] = ()) -> list[Path]:
    """Everything a run will write: its results and, if asked for, what was left out."""
    return [*paths, shared.rejects] if shared.rejects else [*paths]


@contextmanager
def rejects(shared: Shared, logs: "Iterable[Log]", inputs: Sequence[Path]) -> Iterator[None]:
    """Writes what was left out of the logs, if asked for; it appears after what is written within.

    Raises:
        UserError: where it cannot be written.
    """
    if shared.rejects is None:
        yield
        return
    from ..write import files
    from ..write.csv import write_rejects
    from . import show

    with files.outputs([shared.rejects], shared.force, inputs=inputs) as (place,):
        count = write_rejects(place, logs)
        yield
    show.message(f"wrote {shared.rejects}: {count} rows and cells left out", shared.quiet)


def checked(shared: Shared, logs: Sequence[Path]) -> Callable[..., Any]:
    """The `loader`, after what needs no work was checked: options, settings, that logs open.

    Raises:
        UserError: for an unknown name, a value out of range, a log that is none.
    """
    from .. import analysis
    from ..errors import UserError
    from ..read.log import open_source

    analysis.chosen(shared.algo)
    first, last = shared.from_, shared.to
    if last is not None and last <= (first or 0.0):
        text = f"--to {last:g} is not after --from {first or 0.0:g}"
        raise UserError(text, "both are seconds after the log's start", code=2)
    load = loader(shared)
    settings = analysis.checked(load())
    if len(logs) > 1:  # of several, none is worked on if one cannot be
        for log in logs:
            open_source(log, settings.read)
    return load
