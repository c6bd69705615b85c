"""Settings: flag > `--set` > later `-c` > earlier `-c` > `./adhesion.toml` > default, checked once.

The keys are the fields of `Vehicle`, of `ReadOptions`, `Mapping` and `AnalysisSettings`, and the
parameters of each estimator and controller: nothing is listed here a second time.
"""

import copy
import dataclasses
import json
import re
import tomllib
from collections.abc import Callable, Iterable, Sequence
from collections.abc import Mapping as Tree
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any, get_args

import numpy as np

from ..channels.meaning import Mapping
from ..channels.places import bogie_axles
from ..channels.rules import names_brake, names_place
from ..core import estimator, methods, toml
from ..core.errors import UserError, unknown
from ..core.estimator import Estimator
from ..core.model import (
    MOTOR_FORCES,
    CarAxle,
    IdentifiedVehicle,
    Meaning,
    Parameter,
    Quantity,
    Track,
    Train,
    Vehicle,
    quantities,
)
from ..core.physics import CHAIN
from ..diagnostics.registry import tunable
from ..formats.source import ReadOptions, TimeSource
from ..rail.highest import PEAK_TIME
from ..rail.slope import Bands, Params, check_bands
from ..records.faults import Window
from ..stops.settings import StopSettings
from ..train.mean_axle import vehicle_of_axles
from ..wsp import controller
from ..wsp.wsp_controller import ParameterSet
from . import cars, loads, stated_brake, stated_friction, stated_track
from .stated_values import is_axle, parameter, plain_number, table_of

Table = toml.Table
Tables = Tree[str, Any]  # of TOML, read only
_FORMAT_HINT = "settings are TOML, for example the line: vehicle.friction = 0.3"
# In words, because a shell takes some of these marks for its own.
MARKS = {"comma": ",", "semicolon": ";", "tab": "\t", "space": " ", "pipe": "|", "point": "."}
READ_KEYS: Tree[str, dict[str, type]] = {  # of the sections on how logs are read
    "csv": {"header": bool, "delimiter": str, "decimal": str, "encoding": str},
    "xlsx": {"sheet": str},
    "can": {"dbc": list},
}
TIME_KEYS = {"channel": str, "unit": str, "source": str}
GROUP_KEYS = {"channel": str, "equals": str}
_ENTRY_KEYS: dict[str, type] = dict.fromkeys(("channel", "field", "unit", "group"), str)
CHANNEL_KEYS = {
    **_ENTRY_KEYS,
    "teeth": int,
    "wrap": float,
    "zero": Parameter,
    "delay": Parameter,
    "axles": list,
}
# Places of a channel, and the axles of the n-th where nothing else is stated.
PLACES: dict[str, Callable[[int], tuple[int, ...]]] = {"axle": lambda n: (n,), "bogie": bogie_axles}
# of a force of motors, which several axles may share
FORCE_KEYS = {**_ENTRY_KEYS, "axles": list, "arm": float, "full_force": float, "tolerance": float}
_ROUNDING = -1e-4  # eigenvalue of correlations that are rounded
_OF_LOGS = ("channels", *READ_KEYS)  # sections on how logs are read
_ORIGIN = (*_OF_LOGS, "selection", "antiskid")  # what a result was made from
_SPEED: dict[str, Meaning] = {"speed": "wheel_speed"}
_BY_NAME: dict[str, Meaning] = {name: name for name in get_args(Meaning) if name != "time"}
MEANINGS = _SPEED | _BY_NAME  # the meaning of each key of [channels]
# 1 sigma of what is stated of a sensor without one: in its unit, and [s]
_SENSOR_TOLERANCES = {"zero": 0.0, "delay": 0.1}


VEHICLE_USES = ("log", "stated")
# Parameters that scale the force per mass by K, and those that do by pressure as well. The others
# are alike in all vehicles, or have little weight.
_BY_FORCE = ("friction", "axle_mass")
_BY_PRESSURE = (*(name for name in CHAIN if name != "efficiency"), "cylinder_diameter")


@dataclass(frozen=True, slots=True)
class AnalysisSettings:
    """What `analyze` does with a log once it is read."""

    reference: Annotated[str, Quantity("", "reference: smoother or butterworth")] = "smoother"
    slowest: Annotated[float, Quantity("m/s", "no slip below this train speed")] = 1.0
    max_gap: Annotated[
        float, Quantity("s", "longer intervals are gaps; 0: five times the usual one", maximum=1e6)
    ] = 0.0
    peak_time: Annotated[
        float, Quantity("s", "the highest force and µ are means over this time", 0.001, 10.0)
    ] = PEAK_TIME
    vehicle: Annotated[
        str, Quantity("", "log: as stated, with what the log shows of its brake; stated: as it is")
    ] = "log"


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything a user may state, checked.

    Attributes:
        overrides: parameters as stated, by name of estimator, of controller, and of "slope": in
            the loop, the slope has other defaults.
        checks: thresholds of every check of the diagnostics, by its name.
        tables: what the user states, with one name for each vehicle parameter.
        flags: reading options that the user states by flags.
    """

    vehicle: Vehicle = field(default_factory=Vehicle)
    mappings: tuple[Mapping, ...] = ()
    read: ReadOptions = field(default_factory=ReadOptions)
    analysis: AnalysisSettings = field(default_factory=AnalysisSettings)
    train: Train = field(default_factory=Train)
    track: Track = field(default_factory=Track)
    slope: Params = field(default_factory=Params)
    bands: Bands = field(default_factory=Bands)
    stops: StopSettings = field(default_factory=StopSettings)
    overrides: dict[str, dict[str, float]] = field(default_factory=dict)
    checks: Table = field(default_factory=lambda: {k: c.Params() for k, c in tunable().items()})
    tables: Tables = field(default_factory=dict, compare=False, repr=False)
    flags: Tables = field(default_factory=dict, compare=False, repr=False)

    @property
    def stated(self) -> frozenset[str]:
        """Vehicle parameters that the user states, though it may be the default's value."""
        cars = self.tables.get("car", {}).values()
        vehicle_tables = [self.tables.get("vehicle", {}), *cars]
        names = {name for table in vehicle_tables for name in table} - {"axles"}
        return frozenset(names | ({"axle_mass"} if "load" in names else set()))

    def unstated_brake(self, by_pressure: bool) -> tuple[str, ...]:
        """The parameters that scale the force per mass, and that nobody stated."""
        names = (*_BY_FORCE, *(_BY_PRESSURE if by_pressure else ()))
        return tuple(name for name in names if name not in self.stated)

    @property
    def carries_vehicle(self) -> bool:
        """Whether the vehicle is that of a result file, and the user states nothing of it."""
        return not self.stated and self.vehicle != Vehicle()

    @property
    def states_brake_or_mass(self) -> bool:
        """Whether the user states part of the brake, or the mass; a wheel is neither."""
        return not self.stated.isdisjoint((*_BY_FORCE, *CHAIN, "cylinder_diameter", "spring_force"))

    def over(self, carried: Tables) -> "Settings":
        """These settings over those that a result file carries.

        Those on reading its log are ignored: the result is another file. So are thresholds that
        this version does not have.

        Raises:
            UserError: for an unknown key, a value out of range.
        """
        base = {k: v for k, v in carried.items() if k not in _ORIGIN}
        thresholds, checks = base.get("diagnostics", {}), tunable()
        known = {name: checks[name].Params._fields for name in thresholds if name in checks}
        base["diagnostics"] = {
            name: {k: v for k, v in thresholds[name].items() if k in x} for name, x in known.items()
        }
        if "profile" in base.get("track", {}).get("gradient", {}):  # the log had the position
            del base["track"]
        return _build([_normalise_names(base), self.tables], self.flags)

    def with_vehicle(self, identified: IdentifiedVehicle) -> "Settings":
        """The settings with an identified vehicle: whoever reads these takes it as it is."""
        vehicle_use = "stated" if identified.known else self.analysis.vehicle
        analysis = replace(self.analysis, vehicle=vehicle_use)
        return replace(self, vehicle=identified.vehicle, analysis=analysis)

    def params(self, est: Estimator) -> Any:
        """An estimator's parameters: its defaults and what the user stated."""
        return methods.validate(est, self.overrides.get(est.name, {}))


SettingsSource = Path | Tables  # a settings file, or its tables
Sources = SettingsSource | Sequence[SettingsSource] | None
Assignments = Sequence[str | Tables]  # of `--set`, or tables


def load(
    config: Sources = None, assignments: Assignments = (), folder: bool = True, **flags: Any
) -> Settings:
    """Settings from files and `--set`.

    Args:
        config: the `-c` files, later ones first; what none of them states, `./adhesion.toml` does
            where there is one.
        assignments: `name=value`, as in ``neso.beta1=100`` or ``vehicle.phi=0.28``; or tables.
        folder: whether `./adhesion.toml` counts.
        flags: reading options.

    Raises:
        UserError: for an unreadable file, an unknown key, a value out of range.
    """
    return _build([stated_tables(config, assignments, folder)], flags)


def _build(layers: Sequence[Tables], flags: Tables) -> Settings:
    """The settings of these layers, of which the last is what the user states."""
    checked = _checked_settings(_merge_layers(layers), flags)
    return replace(checked, tables=layers[-1], flags=flags)


def stated_tables(config: Sources, assignments: Assignments, folder: bool = True) -> Table:
    """What files and `--set` state, as tables that `load` takes in place of them.

    A brake as engineers state it is there as the parameters of (15).

    Raises:
        UserError: for an unreadable file, an unknown vehicle parameter, a brake stated twice.
    """
    return cars.with_parameters(layered_tables(config, assignments, folder))


def layered_tables(config: Sources, assignments: Assignments, folder: bool = True) -> Table:
    """What files and `--set` state, each key under its own name."""
    local_file = Path("adhesion.toml")
    layers = [toml.read(local_file, _FORMAT_HINT)] if folder and local_file.is_file() else []
    files = [config] if isinstance(config, Path | Tree) else config or ()
    layers += [toml.read(x, _FORMAT_HINT) if isinstance(x, Path) else dict(x) for x in files]
    layers.append(merged(assignments))
    return _merge_layers(map(_normalise_names, layers))


def merged(assignments: Iterable[str | Tables]) -> Table:
    """The tables that several `--set`, or keywords of a call, state.

    Raises:
        UserError: where one has no name or no value.
    """
    tree: Table = {}
    for source in assignments:
        _merge(tree, assignment(source) if isinstance(source, str) else source)
    return tree


def _merge_layers(layers: Iterable[Tables]) -> Table:
    tree: Table = {}
    for layer in layers:
        _forget(tree, layer)
        cars.forget(tree, layer)
        _merge(tree, layer)
    return tree


def _forget(tree: Table, layer: Tables) -> None:
    """Removes the correlations of the vehicle parameters that the next layer states anew."""
    stated_vehicle, stated_cars = layer.get("vehicle", {}), layer.get("car", {})
    _forget_correlations(tree.get("vehicle", {}), stated_vehicle)
    for name, table in tree.get("car", {}).items():
        _forget_correlations(table, {**stated_vehicle, **stated_cars.get(name, {})})


def _forget_correlations(vehicle: Table, stated_tables: Tables) -> None:
    correlations = vehicle.pop("correlation", {}) if stated_tables else {}
    remaining: Table = {}
    for a, related in correlations.items():
        others_left = {b: x for b, x in related.items() if b not in stated_tables}
        if others_left and a not in stated_tables:
            remaining[a] = others_left
    vehicle |= {"correlation": remaining} if remaining else {}


def stated_sections(assignments: Sequence[str]) -> set[str]:
    """The sections of which `--set` states something."""
    return {name for text in assignments for name in _normalise_names(assignment(text))}


def tree(
    settings: Settings,
    algos: Sequence[Estimator],
    axles: Sequence[int] = (),
    window: Window = (None, None),
) -> Table:
    """Every parameter in force, as a TOML would state it; `Settings.over` takes it back.

    `algos` are the estimators that ran; axles and window are as given by the flags.
    """
    return {
        **cars.as_tables(settings.vehicle),
        "analysis": dataclasses.asdict(settings.analysis),
        "train": settings.train._asdict(),
        "track": stated_track.as_stated(settings.track),
        "slope": settings.slope._asdict(),
        "bands": settings.bands._asdict(),
        "stops": settings.stops._asdict(),
        "diagnostics": {name: p._asdict() for name, p in settings.checks.items()},
        **{e.name: settings.params(e)._asdict() for e in algos},
        **_log_sections(settings, axles, window),
    }


def _log_sections(settings: Settings, axles: Sequence[int], window: Window) -> Table:
    """How the log was read and what was taken of it: the sections of `_ORIGIN`, where stated."""
    read = settings.read
    channels: Table = {}
    for key, channel_table in settings.tables.get("channels", {}).items():
        _merge(channels, {MEANINGS.get(key, key): channel_table})
    from_s, to_s = window
    selection: Table = {"from": from_s, "to": to_s, "axles": list(axles) or None}
    sections = {
        "channels": channels,
        **{name: {k: getattr(read, k) for k in keys} for name, keys in READ_KEYS.items()},
        "can": {"dbc": list(read.dbc)},
        "selection": {**selection, "strict": read.strict},
    }
    unset_values: tuple[Any, ...] = None, {}, []
    return {s: {k: v for k, v in x.items() if v not in unset_values} for s, x in sections.items()}


def nested(flat: Tree[str, str]) -> Table:
    """The tree from dotted keys with JSON values, as a result file carries it."""
    tree: Table = {}
    for name, text in flat.items():
        _merge(tree, _nested(name.split("."), json.loads(text)))
    return tree


def _nested(keys: Sequence[str], value: Any) -> Any:
    return {keys[0]: _nested(keys[1:], value)} if keys else value


def assignment(text: str) -> Table:
    """The table that one `--set` states.

    Raises:
        UserError: where it has no name or no value.
    """
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        problem = f"--set {text[:80]!r} has no '='"
        raise UserError(problem, "for example --set neso.beta1=100", code=2)
    try:
        return toml.parsed(text, "--set")
    except tomllib.TOMLDecodeError:
        value = value.strip()
        bare_number = toml.BARE_NUMBER.fullmatch(value)  # else a bare word is a text
    keys = name.strip().split(".", toml.DEEPEST)
    return toml.bounded(_nested(keys, float(value) if bare_number else value), "--set")


def _merge(target: Table, layer: Tables) -> None:
    """Lays `layer` over `target`; tables merge, a number over `{value, tolerance}` replaces it."""
    for key, value in layer.items():
        existing = target.get(key)
        if isinstance(value, dict) and isinstance(existing, dict) and _same_kind(existing, value):
            _merge(existing, value)
        else:
            target[key] = copy.deepcopy(value)


def _same_kind(a: Tables, b: Tables) -> bool:
    """Whether two tables say the same kind of thing: not one channel and one channel per axle."""
    if stated_friction.replaces(a, b):
        return False
    kinds = set()
    for x in (a, b):
        of_axles = any("channel" in entry for entry in x.values() if isinstance(entry, dict))
        kinds.add((bool({"channel", "unit"} & x.keys()), of_axles))
    return kinds != {(True, False), (False, True)}


def _normalise_names(layer: Tables) -> Table:
    """One layer with every vehicle parameter under its own name, diameters halved.

    They are in `vehicle`, and in the table of each car.
    """
    keys = vehicle_keys() | {key: key for key in stated_brake.KEYS}
    normalised = {k: v for k, v in layer.items() if k not in keys and k != "vehicle"}
    if isinstance(channels := layer.get("channels"), dict):
        normalised["channels"] = {k: _channel_tables(v) for k, v in channels.items()}
    if "car" in layer:
        normalised["car"] = {
            name: _normalise_parameters(f"car.{name}", table_of(f"car.{name}", table).items())
            for name, table in table_of("car", layer["car"]).items()
        }
    bare_keys = {k: v for k, v in layer.items() if k in keys}
    vehicle_values = [*bare_keys.items(), *table_of("vehicle", layer.get("vehicle", {})).items()]
    vehicle = _normalise_parameters("vehicle", vehicle_values)
    return {**normalised, "vehicle": vehicle} if vehicle else normalised


def _normalise_parameters(section: str, stated_values: Iterable[tuple[str, Any]]) -> Table:
    """The table of a vehicle or of a car with every parameter under its own name."""
    keys = vehicle_keys() | {key: key for key in stated_brake.KEYS}
    keys |= {"axles": "axles"} if section != "vehicle" else {}
    normalised: Table = {}
    for key, value in stated_values:
        if key not in keys:
            raise unknown("vehicle parameter", key, list(keys))
        if keys[key] in normalised:
            message = f"{section}.{keys[key]} is stated twice in one place, once as {key!r}"
            raise UserError(message, "keep one of them", code=2)
        normalised[keys[key]] = _halve(value) if key == "wheel_diameter" else value
    return normalised


def _halve(value: Any) -> Any:
    """A radius from a diameter: a number, `{value, tolerance}`, or a list of them."""
    if isinstance(value, list):
        return [_halve(v) for v in value]
    if isinstance(value, dict):
        return {k: _halve(v) for k, v in value.items()}
    return plain_number("vehicle.wheel_diameter", value) / 2.0


def sections() -> list[str]:
    """The names of all sections."""
    return ["vehicle", "car", "track", *_OF_LOGS, "analysis", "diagnostics", *_numeric()]


def _numeric() -> "dict[str, methods.Tunable]":
    """The sections that hold numbers only."""
    kinds = {"slope": Params, "bands": Bands, "train": Train, "stops": StopSettings}
    own_sections = {name: ParameterSet(name, kind) for name, kind in kinds.items()}
    return {**estimator.registry(), **controller.registry(), **own_sections}


def _checked_settings(tree: Table, read: Tables) -> Settings:
    numeric, section_names = _numeric(), sections()
    for key, value in tree.items():
        if key not in section_names:
            raise unknown("setting", key, [*section_names, *vehicle_keys()])
        table_of(key, value)
    overrides = {k: _numbers(numeric[k], v) for k, v in tree.items() if k in numeric}
    bands, train = Bands(**overrides.pop("bands", {})), Train(**overrides.pop("train", {}))
    stops = StopSettings(**overrides.pop("stops", {}))
    mappings, time_options = _channels(tree.get("channels", {}))
    options = dict(time_options)
    for name, types in READ_KEYS.items():
        options |= _fields(name, tree.get(name, {}), types)
    options["named_channels"] = tuple(m.channel for m in mappings if m.channel)
    # marks are stated by their names, too
    marks = {k: MARKS.get(v, v) for k, v in options.items() if k in ("delimiter", "decimal")}
    names = options.get("dbc", [])
    if not all(isinstance(name, str) for name in names):
        text = f"can.dbc = {names!r} is wrong"
        raise UserError(text, 'write a list of texts, as ["brake.dbc"]', code=2)
    options |= marks | {"dbc": tuple(names)} | {k: v for k, v in read.items() if v is not None}
    kinds = {f.name: type(f.default) for f in dataclasses.fields(AnalysisSettings)}
    analysis = _fields("analysis", tree.get("analysis", {}), kinds)
    for name in analysis.keys() - {"reference", "vehicle"}:
        quantities(AnalysisSettings)[name].check(f"analysis.{name}", analysis[name])
    checks = tree.get("diagnostics", {})
    for name in checks.keys() - tunable().keys():
        raise unknown("check", f"diagnostics.{name}", [f"diagnostics.{k}" for k in tunable()])
    return Settings(
        _vehicle(tree),
        tuple(mappings),
        ReadOptions(**options, names_brake=names_brake, names_place=names_place),
        AnalysisSettings(**analysis),
        train,
        stated_track.stated_track(tree.get("track", {})),
        Params(**overrides.get("slope", {})),
        check_bands(bands, "bands"),
        stops,
        overrides,
        {n: c.Params(**_numbers(c, checks.get(n, {}))) for n, c in tunable().items()},
    )


def _numbers(tunable: methods.Tunable, table: Any) -> dict[str, float]:
    entries, name = table_of(tunable.name, table), tunable.name
    numbers = {k: plain_number(f"{name}.{k}", v) for k, v in entries.items()}
    methods.validate(tunable, numbers)
    return numbers


def vehicle_keys() -> dict[str, str]:
    """Every spelling of a vehicle parameter, and the field it means."""
    names = {name: name for name in quantities(Vehicle)}
    symbols = {q.symbol: name for name, q in quantities(Vehicle).items() if q.symbol}
    keys = {"wheel_diameter": "wheel_radius", "correlation": "correlation", "load": "load"}
    return {**names, **symbols, **keys}


def _vehicle(tree: Table) -> Vehicle:
    axles = [CarAxle(x.number, x.car, cars.named(x, _single_axle)) for x in cars.by_axle(tree)]
    if axles:
        return vehicle_of_axles(axles)
    return _single_axle(tree.get("vehicle", {}))


def _single_axle(table: Table) -> Vehicle:
    values: Table = {}
    for name, value in table.items():
        default = getattr(Vehicle(), name)
        if name == "correlation":
            values[name] = _correlation(value)
        elif name == "friction" and stated_friction.is_table(value):
            values[name], values["friction_table"] = stated_friction.friction_table(value)
        elif name == "load":
            values[name] = loads.stated_load(value)
        elif name == "wheel_radius":
            radii = value if isinstance(value, list) else [value]
            if not radii:
                line = f"vehicle.{name} = [0.43, 0.43]"
                hint = f"one value, or one per axle, as {toml.option(line)}"
                raise UserError(f"vehicle.{name} is an empty list", hint, code=2)
            values[name] = tuple(_parameter(name, v, default[0]) for v in radii)
        else:
            values[name] = _parameter(name, value, default)
    if (load := values.get("load")) and "axle_mass" not in table:
        values["axle_mass"] = load.mass(sum(load.pressure) / 2.0)
    vehicle = Vehicle(**values)
    if vehicle.friction_table and vehicle.friction_fade.value:
        text = "vehicle.friction is a table and vehicle.friction_fade is stated: speed counts twice"
        raise UserError(text, "leave out vehicle.friction_fade, or set it to 0", code=2)
    return vehicle


def _correlation(table: Any) -> tuple[tuple[str, str, float], ...]:
    """The correlation coefficients that the vehicle states, which some errors must have."""
    section, names = "vehicle.correlation", list(quantities(Vehicle))
    coefficients = []
    for a, row in table_of(section, table).items():
        for b, share in table_of(f"{section}.{a}", row).items():
            for name in (a, b):
                if name not in names:
                    raise unknown("vehicle parameter", name, names)
            coefficients.append((a, b, plain_number(f"{section}.{a}.{b}", share)))
    matrix = np.eye(len(names))
    for a, b, share in coefficients:
        matrix[names.index(a), names.index(b)] = matrix[names.index(b), names.index(a)] = share
    if np.linalg.eigvalsh(matrix)[0] < _ROUNDING or (np.diag(matrix) != 1.0).any():
        hint = "state each pair of two parameters once, from −1 to 1, as `calibrate` writes them"
        raise UserError(f"{section}: no errors have these correlations", hint, code=2)
    return tuple(coefficients)


def _parameter(key: str, entry: Any, default: Parameter) -> Parameter:
    """A value, or `{value, tolerance}`; without a tolerance the default's share of the value."""
    name, quantity = f"vehicle.{key}", quantities(Vehicle)[key]
    number = parameter(name, entry, default.share, default.value)
    quantity.check(name, number.value)
    replace(quantity, minimum=0.0, text="1 sigma").check(f"{name}.tolerance", number.tolerance)
    return number


def _channels(section: Table) -> tuple[list[Mapping], Table]:
    """`[channels]`: what each log name means, and how to read the time."""
    mappings: list[Mapping] = []
    options: Table = {}
    places: dict[tuple[str, int], str] = {}  # what states this meaning of an axle
    of_rows = {"time": TIME_KEYS, "group": GROUP_KEYS}
    for key, value in section.items():
        if key in of_rows:
            table = _fields(f"channels.{key}", _table(value), of_rows[key])
            options |= {f"{key}_{k}": v for k, v in table.items()}
        elif key not in MEANINGS:
            raise unknown("meaning in [channels]", key, [*of_rows, *MEANINGS])
        if MEANINGS.get(key) in MOTOR_FORCES:
            mappings += _motor_forces(key, value)
            continue
        for place, entry in _by_place(key, value) if key in MEANINGS else []:
            axles, table = _axles(f"channels.{key}", place, _table(entry))
            table = _channel(key, table)
            for axle in axles:
                previous_place = place
                if axle and table["channel"]:
                    previous_place = places.setdefault((MEANINGS[key], axle), place)
                if previous_place != place:
                    place_names = f"{previous_place!r} and {place!r}"
                    text = f"channels.{key} states axle {axle} twice: {place_names}"
                    raise UserError(text, "leave one of them out, or state its axles", code=2)
                mappings.append(Mapping(MEANINGS[key], axle, **table))
    for name in ("time_channel", "group_channel"):
        if options.get(name, "").isdigit():
            options[name] = f"column {options[name]}"
    source = options.get("time_source", "log")
    if source not in get_args(TimeSource):
        raise unknown("time source", source, list(get_args(TimeSource)))
    return mappings, options


def _by_place(key: str, value: Any) -> list[tuple[str, Any]]:
    """`pressure = "p"` is every axle's, `pressure."axle 2" = …` one axle's, a bogie's is of two."""
    if not isinstance(value, dict):
        return [("", value)]
    shared = {name: entry for name, entry in value.items() if name in CHANNEL_KEYS}
    places = {k: v for k, v in value.items() if k not in shared and (_place(k) or not shared)}
    shared |= {k: v for k, v in value.items() if k not in places}
    return [("", shared)] * bool(shared or not places) + [*places.items()]


def _place(name: str) -> tuple[str, int] | None:
    """Kind and number of a place, as of "bogie 2" or "1"; None for another key."""
    match = re.fullmatch(rf"({'|'.join(PLACES)}|)[ _]*([1-9]\d*)", name.lower())
    return (match[1] or "axle", int(match[2])) if match else None


def _axles(section: str, name: str, table: Table) -> tuple[tuple[int | None, ...], Table]:
    """The axles of a place, None for every axle; and its table without them."""
    place = _place(name)
    if name and not place:
        line = f'{section}."axle 1" = {{channel = "NAME"}}'
        hint = f"axles and bogies count from 1, as {toml.option(line)}"
        raise UserError(f"{section}.{name!r} is no axle and no bogie", hint, code=2)
    axles: tuple[int | None, ...] = PLACES[place[0]](place[1]) if place else (None,)
    if "axles" not in table:
        return axles, table
    axles_entry = table["axles"]
    if not isinstance(axles_entry, list) or not axles_entry or not all(map(is_axle, axles_entry)):
        line = f'{section}."{name or "bogie 1"}".axles = [1, 2]'
        hint = f"list the axles that it serves, from 1, as {toml.option(line)}"
        text = f"{section}.{name!r}" if name else section
        raise UserError(f"{text}: axles = {axles_entry} are no axles", hint, code=2)
    return tuple(dict.fromkeys(axles_entry)), {k: v for k, v in table.items() if k != "axles"}


def _channel(key: str, table: Table) -> Table:
    """What an entry states of its channel, each value of its type."""
    section = f"channels.{key}"
    sensor: Table = {}
    for name, floor in _SENSOR_TOLERANCES.items():
        if name in table:
            sensor[name] = parameter(f"{section}.{name}", table[name], usual=0.0, least=floor)
    table = _fields(section, {k: v for k, v in table.items() if k not in sensor}, CHANNEL_KEYS)
    if "zero" in sensor and "speed" in key:
        raise UserError(f"{section} has a zero: a speed has none", "leave zero out", code=2)
    if "delay" in sensor and key != "train_speed":
        text = f"{section} has a delay: only a train speed has one"
        raise UserError(text, "leave delay out", code=2)
    of_guesses = bool(sensor) or ("unit" in table and "field" not in table)
    if "channel" not in table and not of_guesses:
        line = f"{section} = {toml.value({'channel': 'NAME', **table})}"
        raise UserError(f"{section} names no channel", f"name it, as {toml.option(line)}", code=2)
    return {"channel": "", **table, **sensor}


def _motor_forces(key: str, value: Any) -> list[Mapping]:
    """The force of motors: of every axle, of one, or of a vehicle or bogie, spread over axles."""
    several = isinstance(value, dict) and not value.keys() & FORCE_KEYS.keys()
    mappings = []
    for owner, entry in value.items() if several else [("", value)]:
        name = f"channels.{key}.{owner}".rstrip(".")
        table = _fields(name, _table(entry), FORCE_KEYS)
        kind, number = _place(owner) or ("", 0)
        axles = table.pop("axles", []) or list(PLACES[kind](number) if kind == "bogie" else ())
        if not kind and owner not in ("", "vehicle") and not axles:
            hint = f'one of "vehicle", "bogie 1", "axle 1", as {_example(key)}'
            raise UserError(f"{name}: the axles of {owner!r} are not known", hint, code=2)
        if owner and "channel" not in table:
            raise UserError(f"{name} names no channel", f"name it, as {_example(key)}", code=2)
        if not all(map(is_axle, axles)):
            hint = f"list axles, from 1, as {_example(key)}"
            raise UserError(f"{name}: axles = {axles} are no axles", hint, code=2)
        for quantity, limit in (("arm", 2.0), ("full_force", 1e7), ("tolerance", 1.0)):
            if not 0.0 <= table.get(quantity, 0.0) <= limit:
                hint = f"from 0 to {limit:g}"
                message = f"{name}.{quantity} = {table[quantity]:g} is out of range"
                raise UserError(message, hint, code=2)
        axle = number if kind == "axle" else None
        place = owner or "vehicle" if axle is None and (owner or axles) else ""
        motor_entry: Table = {"channel": "", **table, "place": place, "axles": tuple(axles)}
        mappings.append(Mapping(MEANINGS[key], axle, **motor_entry))
    return mappings


def _example(key: str) -> str:
    line = f'channels.{key}.vehicle = {{channel = "NAME", unit = "kN", axles = [1, 2]}}'
    return toml.option(line)


def _table(value: Any) -> Table:
    return value if isinstance(value, dict) else {"channel": value}


def _fields(section: str, table: Any, types: Tree[str, type]) -> Table:
    """A table's entries, each of its type; a column's number may stand for a text."""
    fields: Table = {}
    for key, value in table_of(section, table, types).items():
        name = f"{section}.{key}"
        if types[key] is str and isinstance(value, (int, float)) and not isinstance(value, bool):
            fields[key] = str(value)
        elif types[key] is float:
            fields[key] = plain_number(name, value)
        elif type(value) is types[key]:
            fields[key] = value
        else:
            kind = {bool: "true or false", str: "a text in quotes", int: "a whole number"}
            kind[list] = 'a list of texts, as ["brake.dbc"]'
            raise UserError(f"{name} = {value!r} is wrong", f"write {kind[types[key]]}", code=2)
    return fields


def _channel_tables(meaning: Any) -> Any:
    """The channels of a meaning: a name alone as a table, `axle1` as `axle 1`, a bogie alike.

    A shell takes `axle1` without quotes. Tables merge, key by key.
    """
    if isinstance(meaning, str):
        return {"channel": meaning}
    if not isinstance(meaning, dict):
        return meaning
    spaced = {re.sub(r"^(axle|bogie)(?=\d)", r"\1 ", key): entry for key, entry in meaning.items()}
    return {
        key: _channel_tables(x) if key.partition(" ")[0] in PLACES else x
        for key, x in spaced.items()
    }
