"""Write settings.md, cli.md, findings.md and reference/json.md: python docs/generate.py.

Each fact has one source: the annotated types, the registry, each command's --help, and the
catalogue of findings. A test compares the pages with what this program writes.
"""

import dataclasses
from collections.abc import Iterator, Mapping
from itertools import groupby
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin

import typer.main

from adhesion_cli.analysis import settings, stated_brake, stated_friction
from adhesion_cli.channels import meaning
from adhesion_cli.cli.app import app
from adhesion_cli.cli.explain import entry
from adhesion_cli.core import annotated, estimator, methods, physics, units
from adhesion_cli.core.finding import catalogue
from adhesion_cli.core.model import Parameter, Quantity, Train, Vehicle, quantities
from adhesion_cli.core.summary import InspectedLog, ResultSummary, SlipSummary
from adhesion_cli.diagnostics.registry import tunable
from adhesion_cli.formats.source import ReadOptions
from adhesion_cli.rail.slope import Bands, Params
from adhesion_cli.stops.settings import StopSettings
from adhesion_cli.wsp import controller
from adhesion_cli.wsp.wsp_controller import SLOPE_IN_LOOP

DOCS = Path(__file__).parent
_DOCUMENTS = (  # schema, key, class of what stands there
    ("adhesion.result/1", "results[]", ResultSummary),
    ("adhesion.slip/1", "axles[]", SlipSummary),
    ("adhesion.inspect/1", "logs[]", InspectedLog),
)
_WORDS = {float: "number", int: "whole number", str: "text", bool: "true or false"}
_HEAD = "<!-- written by docs/generate.py -->\n"
_TEXTS = {
    "key of a force of motors": {
        "channel": "topic, column header or `column 3`",
        "field": "place inside a message",
        "unit": "of a force, of a torque at the wheelset, or % of `full_force`",
        "group": "of a long table, the device",
        "axles": "over which the force is spread",
        "arm": "lever of a torque [m]; 0: the wheel radius",
        "full_force": "force of 100 % [N]",
        "tolerance": "1 sigma, as a share",
    },
    "key of a channel": {
        "channel": "topic, column header or `column 3`",
        "field": "place inside a message, as `velocity[0]`; `velocity` is all of a list",
        "unit": "one of those below; where the log states none, or a wrong one",
        "group": "device of a long table",
        "teeth": "pulses per turn, for Hz, kHz and count",
        "wrap": "where a counter starts anew; if not given, by its values",
        "zero": "what the channel shows while the brake is released, in its unit; it is taken off",
        "delay": "how late a train speed is [s], ± 0.1 s (1 sigma) if not stated; not for `live`",
        "axles": "of a bogie: the axles that it serves, as `[3, 4, 5]`; if not given, two",
    },
    "key of `time`": {
        "channel": "column that holds the time",
        "unit": "`s`, `ms`, `us`, `ns`, `min`, `h`, `d`, `excel`, `datenum`, `julian`, `1904`, "
        "`filetime`, `ticks`, `gps`, `gps_ms`; of dates `iso`, `ymd`, `dmy` or `mdy`",
        "source": "clock of MCAP messages: `log`, `publish` or `header`",
    },
    "key of `group`": {
        "channel": "column that tells the devices of a long table apart",
        "equals": "only its rows with this",
    },
    "key of `csv`": {
        "header": "whether there is a header row",
        "delimiter": "between two cells",
        "decimal": "mark of decimals",
        "encoding": "of the text, as `gb18030`",
    },
    "key of `xlsx`": {"sheet": "that is read; else the first with columns of numbers"},
    "key of `can`": {"dbc": 'files that say which signals the frames hold, as `["brake.dbc"]`'},
}
_STOPS = (
    "Of `stops`, and of the stops in every result. Locks and the largest slip have one definition "
    "in logged and in simulated stops. The largest slip is that above 10 km/h.\n\n"
)
_IN_LOOP = (
    "In the loop of `antiskid` the defaults are "
    + ", ".join(f"`{name}` {value:g}" for name, value in SLOPE_IN_LOOP.items())
    + ": quicker than what suits a log.\n\n"
)
_COLUMNS = "| key | default | unit | range | what |\n|---|---|---|---|---|"


def settings_page() -> str:
    """Every section and key a TOML or `--set` may state."""
    parts = [
        _HEAD + "# Settings\n",
        "A flag counts more than `--set name=value`, that more than the file of `-c`, that more "
        "than `./adhesion.toml`, that more than the default; key by key. Units are SI. An unknown "
        "key is an error that names the nearest known one.\n",
        '```toml\n[vehicle]\nwheel_diameter = 0.86\nfriction = {value = 0.35, tolerance = 0.03}\n'
        '\n[channels]\npressure."axle 1" = {channel = "BCP 1", unit = "bar"}\n\n'
        "[neso]\nbeta1 = 150\n```\n",
        "## [vehicle]\n",
        "Also without the section's name, at the top of a file. Each is a number or `{value, "
        "tolerance}`, the tolerance 1 sigma, in the parameter's unit; without one the default's "
        "share of the value. Each may be a list, one value per axle.\n",
        _table(_of_vehicle()),
        "The brake as engineers state it, in place of `discs`, `lever_ratio`, `radius_ratio` and "
        "`cylinder_diameter`, is one of the two tables below. `rotating_mass` (a share of "
        "`axle_mass`) may stand in place of `wheelset_inertia`. `adhesion vehicle PRESET` prints "
        "a file with all of them.\n",
        "### [vehicle.disc_brake]\n",
        "Needs `discs`, `piston_diameter` (or `piston_area`), `caliper_ratio`, `mean_radius`, and "
        "the wheel's diameter. Without a value: 2 pads per disc, 1 cylinder per disc.\n",
        _table(_of_brake(stated_brake.DiscBrake)),
        "### [vehicle.tread_brake]\n",
        "Needs `piston_diameter` (or `piston_area`) and `rigging_ratio`. Without a value: 1 "
        "cylinder per axle.\n",
        _table(_of_brake(stated_brake.TreadBrake)),
        "### Friction of pads and blocks\n",
        "`friction` is a number, `{value, tolerance}`, a table, or a material's name:\n",
        '```toml\n[vehicle]\nfriction = {speed = [0, 10, 30], block_force = [5e3, 20e3], '
        "value = [[0.40, 0.30, 0.20], [0.30, 0.25, 0.18]], tolerance = 0.1}\n\n"
        "[vehicle.tread_brake]\npiston_diameter = 0.406\nrigging_ratio = 5.5\nblocks = 4\n```\n",
        "A row for each force of one pad or block [N], in it a number for each speed [m/s]. The "
        "tolerance is 1 sigma, as a share. Leave out `block_force` where friction does not depend "
        "on it: `value` is one row then. `clamping_force`, of all blocks of one axle at the wheel "
        "rim, may stand in its place. Between the points friction is a straight line. Beyond "
        "them it stays as at the last one. `block_force` needs `blocks` of the tread brake, or "
        "the disc brake.\n",
        "| material | friction | 1 sigma | source |\n|---|---|---|---|",
        *(
            f"| `{name}` | {m.text}: {_friction(m)} | {m.tolerance:.0%} | {m.source} |"
            for name, m in stated_friction.MATERIALS.items()
        ),
        "",
        "### [vehicle.load]\n",
        "The axle mass over the load pressure of the log, by two points of a straight line. "
        "`axle_mass` is used where the log has no load pressure.\n",
        '```toml\n[vehicle.load]\npressure = [1.5, 3.8]\naxle_mass = [9500, 15000]\nunit = "bar"\n'
        "tolerance = 300  # kg, 1 sigma; 5 % if left out\n```\n",
        "## [car.NAME]\n",
        "A car of a train of several: `axles`, the numbers of its axles, and any key of [vehicle] "
        "with its tables. `[vehicle]` holds for what the car does not state. A list has one value "
        "for each axle of the car. [Several cars](howto/several-cars.md) shows a train.\n",
        '```toml\n[car.trailer]\naxles = [5, 6, 7, 8]\naxle_mass = 12000\n```\n',
        "## [track]\n",
        "`gradient` of the line in per mille, uphill positive. It slows the train and is no brake. "
        "Where it is not known, 5 per mille (1 sigma) are in the band. A train that gains speed "
        "until the brake begins is driven or rolls downhill: the band holds both, unless a channel "
        "of traction or gradient says which.\n",
        "| line | states |\n|---|---|",
        "| `gradient = 5.0` | one gradient; 1 sigma is 0.5 per mille |",
        "| `gradient = {value = 5.0, tolerance = 2.0}` | the same with its 1 sigma |",
        '| `gradient = {logs = {"*_out*.csv" = 8.0, "*_back*.csv" = -8.0}}` | one of each log: the '
        "first pattern that fits its file name. Nothing is stated for other logs |",
        '| `gradient = {profile = "line.csv", position = "km"}` | a CSV of two columns: the km '
        "from which a gradient holds (metres where its head says `[m]`), and the gradient along "
        "rising km. `position` names the "
        "log's channel of the km, else its meaning `position` or `distance` says it |\n",
        "A channel with the meaning `gradient` needs no line here.\n",
        "## [channels]\n",
        "What each channel of a log means; results of ours say it themselves.\n",
        "| line | states |\n|---|---|",
        '| `pressure = {unit = "bar"}` | the unit of every channel that is guessed a pressure |',
        '| `pressure = {channel = "p", unit = "bar"}` | the pressure of all axles |',
        '| `pressure."axle 2" = {channel = "p2", unit = "bar"}` | the pressure of one axle |',
        '| `pressure = {channel = "/bcu", field = "bc", unit = "bar"}` | the pressures of a list: '
        "element 0 is axle 1 |\n"
        '| `pressure."bogie 2" = {channel = "p2", unit = "bar"}` | that of axles 3 and 4 |\n'
        '| `pressure."axle 2" = {zero = 0.1}` | the zero of a pressure that its name assigns to an '
        "axle |\n",
        _kinds("key of a channel", settings.CHANNEL_KEYS),
        "\nThe force of motors brakes above zero as `ed_force`, and drives above zero as "
        "`traction_force`. `ed_force = {…}` is the force of each axle. `ed_force.vehicle = {…}` "
        'and `ed_force."bogie 1" = {…}` are spread over their axles.\n',
        _kinds(
            "key of a force of motors", settings.FORCE_KEYS, meaning.Mapping("ed_force", None, "")
        ),
        "\n| meaning | units |\n|---|---|",
        *(
            f"| `{key}` | {', '.join(units.known_units(of)) or 'any, or none'} |"
            for key, of in settings.MEANINGS.items()
        ),
        "",
        _kinds("key of `time`", settings.TIME_KEYS),
        "",
        _kinds("key of `group`", settings.GROUP_KEYS),
        "",
        *(
            f"## [{section}]\n\n{_kinds(f'key of `{section}`', keys, ReadOptions())}\n"
            for section, keys in settings.READ_KEYS.items()
        ),
        *(
            f"## [{section}]\n\n{text}{_table(_annotated(of))}"
            for section, of, text in (
                ("analysis", settings.AnalysisSettings, ""), ("slope", Params, _IN_LOOP),
                ("bands", Bands, "Of `slip`; those of `antiskid` stand in `[patent]`.\n\n"),
                ("train", Train, "The rest of the train, beside the axles of the log.\n\n"),
                ("stops", StopSettings, _STOPS),
            )
        ),
        *(
            f"## [{name}]\n\n{m.title}. {m.source}\n\n{_table(_of_method(m))}"
            for name, m in (*estimator.registry().items(), *controller.registry().items())
            if m.Params._fields
        ),
        *(
            f"## [{c.name}]\n\n{c.about.title}.\n\n{_table(_of_method(c))}"
            for c in tunable().values()
        ),
    ]  # fmt: skip
    return "\n".join(parts).rstrip() + "\n"


def _friction(m: stated_friction.Material) -> str:
    """φ of a material, as a number or at a usual speed and force."""
    at = ", at 50 km/h and 20 kN per block" if m.speeds else ""
    return f"{m.friction(50.0, 20.0 / physics.G):.2f}{at}"


def cli_page() -> str:
    """`--help` of every command."""
    group: Any = typer.main.get_command(app)
    with group.make_context("adhesion", [], resilient_parsing=True) as context:
        parts = [_HEAD + "# Commands\n"]
        for name in group.list_commands(context):
            command = group.get_command(context, name)
            with command.make_context(name, [], parent=context, resilient_parsing=True) as of:
                of.terminal_width = of.max_content_width = 100
                lines = (line.rstrip() for line in command.get_help(of).splitlines())
                text = "\n".join(lines).strip()
            parts.append(f"## adhesion {name}\n\n```\n{text}\n```\n")
    return "\n".join(parts)


_ON_FINDINGS = """
A finding tells you one thing about your log that can change a result.
`adhesion explain CODE` shows the same text as this page. `adhesion explain` lists all codes.

Each finding has a code, a severity, a channel, a count, time spans in seconds after the log's
start, a message and a remedy. You find them on the terminal, in the JSON (`findings`) and in the
result files (`/events`).

| severity | meaning | exit code |
|---|---|---|
| `info` | how the program read the log; no data is lost | 0 |
| `warning` | data is left out or repaired, or a result is less certain | 3 |
| `error` | data is damaged or lost | 3 |

With `--strict`, damage to the file refuses the log. Three rules hold for every log:

- The program does not sort rows. MCAP messages are read in the order of their log time.
- The program does not bridge gaps. A new segment begins there.
- The program does not change a unit or a value because it looks wrong. It reports it.
"""
_SECTIONS = {
    "file": "The file", "time": "Time stamps", "channels": "Channels and units",
    "sensors": "Sensors", "train": "Train and vehicle", "results": "Results",
    "live": "While samples arrive",
}  # fmt: skip
_PARTS = {
    "message": "Message", "cause": "Cause", "effect": "Effect", "remedy": "Remedy",
    "limits": "Cannot see", "thresholds": "Thresholds",
}  # fmt: skip


def findings_page() -> str:
    """Every entry of the catalogue."""
    parts = [_HEAD + "# Findings\n" + _ON_FINDINGS]
    for section, of in groupby(catalogue().values(), lambda words: words.section):
        parts.append(f"## {_SECTIONS[section]}\n")
        for words in of:
            shown: dict[str, Any] = entry(words)
            checks = dict.fromkeys(t["name"].rpartition(".")[0] for t in shown["thresholds"])
            shown["thresholds"] = ", ".join(f"[`{c}`]({_anchor(c)})" for c in checks)
            parts.append(f"### `{words.code}`\n\n{words.title}.\n")
            parts += [f"- {name}: {shown[part]}" for part, name in _PARTS.items() if shown[part]]
            parts.append("")
    return "\n".join(parts).rstrip() + "\n"


def json_page() -> str:
    """The keys of the documents whose classes are in `core/summary.py`."""
    parts = [
        _HEAD,
        "# Keys of the JSON documents",
        "A number that a log does not show is null, never NaN. `[]` stands for each entry of a"
        " list, `.NAME` for each name of a table. `…_u95` is an expanded uncertainty (95 %).",
    ]
    for schema, key, cls in _DOCUMENTS:
        parts.append(f"## `{schema}`: `{key}`")
        rows = [f"| `{k.path}` | {k.kind} | {k.unit} | {_cell(k.text)} |" for k in _json_keys(cls)]
        parts.append("\n".join(["| key | is | unit | what |", "|---|---|---|---|", *rows]))
    parts.append("[Result files](files.md) says which command prints which document.")
    return "\n\n".join(parts) + "\n"


class _JsonKey(NamedTuple):
    """A key of a JSON document."""

    path: str  # `axles[].reference.band_n`
    kind: str  # what stands there, in words
    unit: str
    text: str


def _json_keys(cls: Any, path: str = "", unit: str = "") -> Iterator[_JsonKey]:
    """The keys of the document of a class, each table after the key that leads to it."""
    hints = annotated.hints(cls)
    for name in annotated.names(cls):
        kind, quantity = annotated.plain(hints[name])
        inner, words, brackets = kind, _WORDS.get(kind, ""), ""
        if get_origin(kind) in (Mapping, dict):
            inner, words, brackets = get_args(kind)[1], "table", ".NAME"
        elif get_origin(kind) is tuple:
            inner, is_list = get_args(kind)[0], get_args(kind)[-1] is Ellipsis
            words, brackets = ("list", "[]") if is_list else ("[from, to]", "")
            words = "list of [from, to]" if get_origin(inner) is tuple else words
        elif get_origin(kind) is Literal:
            words = " or ".join(f"`{x}`" for x in get_args(kind))
        brackets = brackets if annotated.is_class(inner) else ""
        text = (
            quantity.text
            if quantity
            else (inner.__doc__ or "")
            if annotated.is_class(inner)
            else ""
        )
        unit_here = quantity.unit or unit if quantity else unit
        shown = "" if annotated.is_class(inner) else unit_here
        yield _JsonKey(f"{path}{name}{brackets}", words or "table", shown, text.partition("\n")[0])
        if annotated.is_class(inner):
            yield from _json_keys(inner, f"{path}{name}{brackets}.", unit_here)


def _anchor(section: str) -> str:
    """The place of a section in settings.md, as its heading makes it."""
    return "settings.md#" + section.replace(".", "")


def _of_vehicle() -> Iterator[tuple[str, str, Quantity]]:
    for name, q in quantities(Vehicle).items():
        default = getattr(Vehicle(), name)
        p: Parameter = default if isinstance(default, Parameter) else default[0]
        also = f" or `{q.symbol}`" if q.symbol else ""
        yield f"`{name}`{also}", f"{p.value:g} ± {p.tolerance:g}", q


def _of_brake(table: type[Any]) -> Iterator[tuple[str, str, Quantity]]:
    for name, q in quantities(table).items():
        yield f"`{name}`", "", q


def _annotated(of: type[Any]) -> Iterator[tuple[str, str, Quantity]]:
    defaults = of()
    for name, q in quantities(of).items():
        value = getattr(defaults, name)
        yield f"`{name}`", f"{value:g}" if isinstance(value, float) else str(value), q


def _of_method(m: methods.Tunable) -> Iterator[tuple[str, str, Quantity]]:
    for name, q, default in methods.parameters(m):
        yield f"`{name}`", f"{default:g}", q


def _table(rows: Iterator[tuple[str, str, Quantity]]) -> str:
    lines = [
        f"| {key} | {default} | {_cell(q.unit)} | {_range(q, default)} | {_cell(q.text)} |"
        for key, default, q in rows
    ]
    return "\n".join([_COLUMNS, *lines, ""])


def _range(q: Quantity, default: str) -> str:
    if default.isalpha():  # a name
        return ""
    return dataclasses.replace(q, unit="-").range  # its unit has a column


def _kinds(head: str, keys: dict[str, type], defaults: Any = None) -> str:
    names = {str: "text", int: "whole number", float: "number", bool: "true or false"}
    names |= {list: "list", Parameter: "number or `{value, tolerance}`"}
    lines = [f"| {head} | is | default | what |", "|---|---|---|---|"]
    for key, kind in keys.items():
        value = getattr(defaults, key, None)
        default = "" if value in (None, ()) else value
        lines.append(f"| `{key}` | {names[kind]} | {default} | {_TEXTS[head][key]} |")
    return "\n".join(lines)


def _cell(text: str) -> str:
    return text.replace("|", "\\|")


PAGES = {
    "settings.md": settings_page,
    "cli.md": cli_page,
    "findings.md": findings_page,
    "reference/json.md": json_page,
}

if __name__ == "__main__":
    for name, page in PAGES.items():
        (DOCS / name).write_text(page(), encoding="utf-8")
