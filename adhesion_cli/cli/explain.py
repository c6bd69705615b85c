"""`adhesion explain`: what a finding means, from the catalogue."""

import re
from functools import cache
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from ..core.errors import unknown
from .options import Shared, completes, shared

if TYPE_CHECKING:
    from ..core.finding import CatalogueEntry

_SECTIONS = ("cause", "effect", "remedy", "limits")


def _codes() -> list[str]:
    from ..core.finding import catalogue

    return list(catalogue())


@shared("json")
def command(
    shared: Shared,
    code: Annotated[
        str | None,
        typer.Argument(
            metavar="CODE", help="Code of a finding; without it the list.", **completes(_codes)
        ),
    ] = None,
) -> int:
    """Explain a finding: cause, effect, remedy, limits.

    The limits are what the check cannot see. Without CODE: every finding by section.

    Example: adhesion explain pressure-delay
    """
    from ..core.finding import catalogue

    if code and code not in catalogue():
        raise unknown("code", code, list(catalogue()), "`adhesion explain` lists the codes")
    explained = [catalogue()[code]] if code else list(catalogue().values())
    if shared.json:
        import json

        entries = [entry(explained_code) for explained_code in explained]
        print(json.dumps({"schema": "adhesion.explain/1", "findings": entries}, indent=1))
    elif code:
        print(_text(explained[0]))
    else:
        print(_listed(explained))
    return 0


def entry(catalogued: "CatalogueEntry") -> dict[str, object]:
    """An entry as people read it, with "…" for what each finding states itself."""
    names = ("title", "message", *_SECTIONS)
    texts = {name: _without_markup(getattr(catalogued, name)) for name in names}
    head = {"code": catalogued.code, "section": catalogued.section}
    return {**head, **texts, "thresholds": _thresholds(catalogued.code)}


@cache
def _checks() -> dict[str, str]:
    """The source of every file that holds thresholds of a check, by its name."""
    package = Path(__file__).parents[1]
    files = [*package.glob("diagnostics/checks/[!_]*.py"), *package.glob("records/*.py")]
    sources = {path.stem: path.read_text(encoding="utf-8") for path in files}
    return {name: text for name, text in sources.items() if "\nclass Params(" in text}


def _thresholds(code: str) -> list[dict[str, object]]:
    """The thresholds of the checks whose file names this code, with their defaults."""
    check_names = [name for name, source in _checks().items() if f'"{code}"' in source]
    if not check_names:
        return []
    from ..core.methods import parameters
    from ..diagnostics.registry import tunable  # slow to import: only for what has thresholds

    return [
        {"name": f"{check.name}.{name}", "default": default, "unit": q.unit, "text": q.text}
        for stem in sorted(check_names)
        for check in [tunable()[stem]]
        for name, q, default in parameters(check)
    ]


def _without_markup(text: str) -> str:
    return re.sub(r"\{\w+(:[^{}]*)?\}", "…", text).replace("{{", "{").replace("}}", "}")


def _text(catalogued: "CatalogueEntry") -> str:
    from .terminal import folded

    names = {"limits": "Cannot see"}
    lines = [f"{catalogued.code}: {catalogued.title}"] + [
        folded(f"{names.get(section, section.capitalize())}: {text}", "  ")
        for section in _SECTIONS
        if (text := _without_markup(getattr(catalogued, section)))
    ]
    thresholds = _thresholds(catalogued.code)
    if any("…" in line for line in lines):
        lines.append(folded("…: a value of your log. `--json` shows it in the finding.", "  "))
    lines += ["Thresholds (change with --set NAME=VALUE):"] * bool(thresholds)
    for t in thresholds:
        unit = "" if t["unit"] == "-" else f" {t['unit']}"
        lines.append(folded(f"  {t['name']} = {t['default']:g}{unit}: {t['text']}", "    "))
    return "\n".join(lines)


def _listed(entries: "list[CatalogueEntry]") -> str:
    width = max(len(listed_entry.code) for listed_entry in entries)
    lines = [
        "\n".join([f"{section}:", *(f"  {w.code:{width}}  {w.title}" for w in section_entries)])
        for section, section_entries in groupby(entries, lambda w: w.section)
    ]
    return "\n\n".join([*lines, "`adhesion explain CODE` explains one."])
