"""Where a train ran, stopped and slid, as GeoJSON (RFC 7946) for maps.

A `FeatureCollection`: a line of the way of each log, a point for each stop and each slide. The
property `kind` says which, `group` and `label` are those of a plan.
"""

import json
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from ..core.annotated import Json, as_json
from ..core.errors import UserError
from ..core.model import Floats, Log
from ..core.summary import AxleSummary, SlideSummary, StopSummary
from ..core.text import utf8
from ..records.route import find_route

_OF_STOP = (
    "start_s time position_m valid reason nominal_speed_kmh initial_speed_mps distance_m "
    "mean_deceleration equivalent_deceleration coefficient slides max_slip"
).split()
_NAMED = 3  # logs that an error names


class MapOfLog(NamedTuple):
    """What a map shows of a log."""

    log: str
    lines: Sequence[Floats]  # latitudes and longitudes of the way, (points, 2) each
    stops: Sequence[StopSummary]
    slides: Sequence[tuple[int, SlideSummary]]  # after the number of the axle
    group: str | None = None  # of a plan
    label: str | None = None  # of that group


def map_of_log(log: Log, stops: Sequence[StopSummary], axles: Sequence[AxleSummary]) -> MapOfLog:
    """The map of a log; without lines where the log has no coordinates."""
    slides = [(x.axle, slide) for x in axles for a in x.applications for slide in a.slide_list]
    return MapOfLog(log.path, find_route(log).lines(), stops, slides)


def check_name(path: Path) -> None:
    """Refuses, by a UserError, a name that maps do not know."""
    if path.suffix.lower() not in (".geojson", ".json"):
        text, hint = f"{path}: a map is GeoJSON", f"--geojson {path.stem}.geojson"
        raise UserError(text, hint, code=2)


def as_text(maps: Iterable[MapOfLog]) -> str:
    """Maps of logs as one document, of those that have coordinates; a UserError where none has."""
    all_maps = list(maps)
    placed = [line_map for line_map in all_maps if line_map.lines]
    if not placed:
        names = ", ".join(line_map.log for line_map in all_maps[:_NAMED])
        raise UserError(
            f"{names}: no latitude and longitude, which a map needs",
            'state their channels, as [channels] latitude = "NAME" and longitude = "NAME", or '
            "leave --geojson out",
        )
    features = [feature for line_map in placed for feature in _features(line_map)]
    document = {"type": "FeatureCollection", "features": features}
    return json.dumps(document, ensure_ascii=False, allow_nan=False) + "\n"


def _features(one: MapOfLog) -> list[Json]:
    names = {"log": utf8(Path(one.log).name), "group": one.group, "label": one.label}
    stated_names = {key: name for key, name in names.items() if name is not None}
    features = [
        _feature("LineString", line[:, ::-1].tolist(), {"kind": "run", **stated_names})
        for line in one.lines
    ]
    for stop in one.stops:
        values_of_stop = {name: as_json(getattr(stop, name)) for name in _OF_STOP}
        features += _point(stop, {"kind": "stop", **stated_names, **_flat(values_of_stop)})
    for axle, slide in one.slides:
        features += _point(slide, {"kind": "slide", **stated_names, "axle": axle, **as_json(slide)})
    return features


def _flat(properties: Json) -> Json:
    """Properties without tables in them, which many maps cannot show."""
    flat: Json = {}
    for name, value in properties.items():
        if isinstance(value, dict):
            flat |= {name: value["value"], f"{name}_u95": value["u95"]}
        else:
            flat[name] = value
    return flat


def _point(place: StopSummary | SlideSummary, properties: Json) -> list[Json]:
    if place.latitude is None or place.longitude is None:
        return []
    other_properties = {k: v for k, v in properties.items() if k not in ("latitude", "longitude")}
    return [_feature("Point", [place.longitude, place.latitude], other_properties)]


def _feature(kind: str, coordinates: Any, properties: Json) -> Json:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "geometry": geometry, "properties": properties}
