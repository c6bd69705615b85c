"""The options every command shares, declared once."""

import copy
import functools
import inspect
import os
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_args, get_type_hints

import typer

from ..core import cache_folder
from ..core.errors import UserError

if TYPE_CHECKING:
    from ..analysis.settings import Settings

_PACKAGE = Path(__file__).parents[1]
_DISPLAYS = ("DISPLAY", "WAYLAND_DISPLAY", "WAYLAND_SOCKET")


def scenarios() -> list[str]:
    """The bundled scenarios, for completion."""
    return sorted(path.stem for path in _PACKAGE.glob("wsp/scenarios/*.toml"))


def estimators() -> list[str]:
    """The estimators, for completion."""
    return sorted(path.stem for path in _PACKAGE.glob("estimators/[!_]*.py"))


def controllers() -> list[str]:
    """The control laws of `antiskid`, for completion."""
    stems = (path.stem for path in _PACKAGE.glob("wsp/controllers/[!_]*.py"))
    return sorted(name for name in stems if name != "none")


def completes(names: Callable[[], list[str]]) -> dict[str, Any]:
    """What lets typer complete one of these names."""
    return {"autocompletion": lambda incomplete: [n for n in names() if n.startswith(incomplete)]}


def option(flags: str, metavar: str | None, text: str, **more: Any) -> Any:
    """An option of these flags; its default is not shown."""
    return typer.Option(*flags.split(), metavar=metavar, help=text, show_default=False, **more)


class Ended(int):
    """Exit code of a command whose normal end is Ctrl-C: no error is shown."""


LOG_KINDS = "CSV, Excel, MCAP, Parquet, MDF (MF4), TDMS, CAN"
Logs = Annotated[list[Path], typer.Argument(metavar="LOG", help=f"{LOG_KINDS}, or results.")]
GeoJson = Annotated[
    Path | None,
    option("--geojson", "FILE", "Also write a map of way, stops and slides: FILE.geojson."),
]
Seed = Annotated[int | None, option("--seed", "N", "Noise seed, instead of the scenario's.", min=0)]
ScenarioName = typer.Argument(
    metavar="SCENARIO", help="Bundled scenario, or a scenario TOML.", **completes(scenarios)
)


# fmt: off
@dataclass(frozen=True, slots=True)
class Shared:
    """What the shared options say."""

    config: Annotated[list[Path], option(
        "-c --config", "FILE.toml", "Vehicle, channels, estimator settings; repeatable.",
        )] = field(default_factory=list)
    set_: Annotated[list[str], option(
        "--set", "NAME=VALUE", "One setting, as neso.beta1=100 or vehicle.phi=0.28; repeatable.",
        )] = field(default_factory=list)
    dbc: Annotated[list[Path], option(
        "--dbc", "FILE", "Signals of the frames in CAN logs (BLF, ASC, TRC); repeatable.",
        )] = field(default_factory=list)
    out: Annotated[Path | None, option(
        "-o --out", "DIR", "Folder for the results, made if missing; else the current one.",
        )] = None
    algo: Annotated[list[str], option(
        "-a --algo", "NAME", "Only this estimator; repeatable.", **completes(estimators),
        )] = field(default_factory=list)
    reference: Annotated[str | None, option(
        "--reference", "NAME", "Offline reference: smoother (default) or butterworth.",
        **completes(lambda: ["butterworth", "smoother"]))] = None
    axle: Annotated[list[int], option(
        "--axle", "N", "Only this axle; repeatable.", min=1)] = field(default_factory=list)
    from_: Annotated[float | None, option(
        "--from", "S", "Begin S seconds after the log's start.")] = None
    to: Annotated[float | None, option("--to", "S", "End S seconds after the log's start.")] = None
    json: Annotated[bool, option(
        "--json", None, "One JSON document on stdout, nothing else.")] = False
    force: Annotated[bool, option("--force", None, "Replace existing results.")] = False
    strict: Annotated[bool, option(
        "--strict", None, "Damaged data is an error, not a finding.")] = False
    quiet: Annotated[bool, option(
        "-q --quiet", None, "No progress, notes, warnings on stderr; errors and lost data stay.",
        )] = False
    debug: Annotated[bool, option("--debug", None, "Show the traceback of an error.")] = False
    view: Annotated[bool, option("--view", None, "Open the result in the Rerun viewer.")] = False
# fmt: on


_HINTS = get_type_hints(Shared, include_extras=True)
ALWAYS = ("quiet", "debug")  # every command has these; `__main__` honours --debug
ALL_NAMES = tuple(f.name for f in fields(Shared) if f.name not in ALWAYS)
"""What an analysis takes."""


def _annotation(name: str, text: str | None) -> Any:
    if text is None:
        return _HINTS[name]
    kind, usual = get_args(_HINTS[name])
    annotation = copy.copy(usual)
    annotation.help = text
    return Annotated[kind, annotation]


def _parameters(names: Sequence[str], texts: Mapping[str, str]) -> list[inspect.Parameter]:
    unset = Shared()
    return [
        inspect.Parameter(
            f.name,
            inspect.Parameter.KEYWORD_ONLY,
            default=getattr(unset, f.name),
            annotation=_annotation(f.name, texts.get(f.name)),
        )
        for f in fields(Shared)
        if f.name in names
    ]


def shared(
    *names: str, texts: Mapping[str, str] | None = None
) -> Callable[[Callable[..., int]], Callable[..., int]]:
    """Gives a command these shared options, as one `Shared`; `texts` are other help of some."""
    extra = _parameters((*names, *ALWAYS), texts or {})

    def decorate(command: Callable[..., int]) -> Callable[..., int]:
        parameters = [p for n, p in inspect.signature(command).parameters.items() if n != "shared"]

        @functools.wraps(command)
        def run(**given: Any) -> int:
            values = Shared(**{p.name: given.pop(p.name) for p in extra})
            cache_folder.report = functools.partial(_report, values.quiet)
            if not values.out:
                return command(shared=values, **given)
            from ..results import atomic_files

            with atomic_files.folder(values.out):
                return command(shared=values, **given)

        run.__signature__ = inspect.Signature([*parameters, *extra])  # type: ignore[attr-defined]
        hints = get_type_hints(command, include_extras=True)
        all_parameters = (*parameters, *extra)
        run.__annotations__ = {p.name: hints.get(p.name, p.annotation) for p in all_parameters}
        return run

    return decorate


def _report(quiet: bool, text: str) -> None:
    from .terminal import message  # with numpy, and seldom needed

    message(text, quiet)


def load_settings(shared: Shared, several_loggers: bool = False) -> "Settings":
    """The settings that these options state, for logs of one logger or several."""
    from ..analysis.settings import load

    stated = shared.config, assignments(shared)
    return load(*stated, strict=shared.strict, several_loggers=several_loggers)


def assignments(shared: Shared) -> list[str]:
    """What `--set` and the flags of settings state."""
    from ..core import toml

    flags = [f'analysis.reference="{shared.reference}"'] if shared.reference else []
    flags += [f"can.dbc = {toml.value([str(file) for file in shared.dbc])}"] if shared.dbc else []
    return [*shared.set_, *flags]


def check(shared: Shared, paths: Sequence[Path], *logs: Path) -> None:
    """Refuses, by a UserError, what could not be written or shown after the work."""
    from ..results import atomic_files

    if shared.view:
        check_display("adhesion view RESULT --serve")
    atomic_files.check(paths, shared.force, inputs=inputs(shared, *logs))


def refuse_page_name(logs: Sequence[Path]) -> None:
    """Refuses the name of a page among the logs, as of somebody who gave --report a name."""
    for log in logs if len(logs) > 1 else ():
        is_missing_name = not log.suffix and not log.exists()
        if is_missing_name or log.suffix.lower() in (".html", ".htm"):
            text = f"--report takes no file name: {log} stands where a LOG does"
            raise UserError(text, f"leave out {log}; -o DIR states the folder of the page", code=2)


def inputs(shared: Shared, *logs: Path) -> list[Path]:
    """Everything a run reads, which must survive it."""
    return [*logs, *shared.config, *shared.dbc]


def settings_file(out: Path | None) -> list[Path]:
    """The TOML that a command writes, if asked for; a UserError for another suffix."""
    from ..core import toml

    return [toml.target(out)] if out else []


def check_settings(shared: Shared) -> "Settings":
    """The settings that these options state, after a check of all options; raises UserError."""
    from ..analysis.request import check_request

    return check_request(load_settings(shared), shared.algo, (shared.from_, shared.to))


def check_display(serves: str) -> None:
    """Refuses where the viewer cannot open a window; `serves` is the command for a browser."""
    if sys.platform == "linux" and not any(map(os.environ.get, _DISPLAYS)):
        raise no_window_error("there is no display", serves)


def no_window_error(reason: str, serves: str) -> UserError:
    """The error where the viewer has no window, with what to do instead."""
    hint = f"in a browser: `{serves}`; or copy the .rrd to a computer with a display"
    return UserError(f"the viewer cannot open a window: {reason}", hint)
