"""The JSON documents of `antiskid`; their keys are a contract."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from ..core.annotated import Json
from ..core.document import findings_document, tagged
from ..core.finding import Finding
from . import wsp_controller
from .plant import RailConditions
from .replay import Answer, Case
from .scenario import Scenario
from .stop import Stop


def antiskid_document(
    stop: Stop,
    scenario: str,
    parameters: Mapping[str, Mapping[str, float]],
    dry: float | None,
    controllers: Mapping[str, Mapping[str, float | None]],
    **more: Any,
) -> Json:
    """The `adhesion.antiskid/1` document.

    `stop` is one of the stops, which share estimator and seed. `dry` is the stopping distance on
    dry rail [m], None where it is not known. `controllers` has the fields of each controller's
    `Verdict`, `more` has entries of a replayed log.
    """
    head = {"scenario": scenario, "seed": stop.seed, "estimator": stop.algo}
    body = {"parameters": parameters, "dry_distance_m": dry, "controllers": controllers}
    return tagged("antiskid", **head, **body, **more)


def replay_document(
    log: str,
    case: Case,
    parameters: Mapping[str, Mapping[str, float]],
    dry: float | None,
    answers: dict[str, Answer],
    findings: Sequence[Finding],
) -> Json:
    """The `adhesion.antiskid/1` document; medians of the draws with their 95 % intervals."""
    values = {law: a.values.items() for law, a in answers.items()}
    median = {law: {k: x and x[0] for k, x in items} for law, items in values.items()}
    spread = {law: {k: x and list(x[1:]) for k, x in items} for law, items in values.items()}
    compared = {law: a.compared._asdict() for law, a in answers.items()}
    of_log = {"log": log, "draws": len(case.draws), "start_s": case.start_s}
    of_log |= {"logged_distance_m": case.logged_m, "intervals": spread, "compared": compared}
    of_log["findings"] = findings_document(findings)
    stop, name = next(iter(answers.values())).stop, case.scenario.name
    return antiskid_document(stop, name, parameters, dry, median, **of_log)


def stop_settings(
    stop: Stop,
    case: Scenario,
    settings: wsp_controller.Settings,
    settings_tree: Json,
    track: RailConditions | None = None,
    **more: str,
) -> Json:
    """All that a stop was made from, as the settings its file carries.

    `settings_tree` states vehicle and bands, `more` the log that `track` was fitted to.
    """
    unused = ("vehicle", "sensor", "wsp")  # the vehicle has its own section
    loop: Json = {"controller": stop.controller, "estimator": stop.algo, **more}
    scenario = {k: v for k, v in asdict(case).items() if k not in unused}
    if track:  # its last knot is at infinity
        knots, conditions = track.knots[:-1].tolist(), track.values[:, :-1].tolist()
        scenario["rail"] = {"knots": knots, "conditions": conditions}
        scenario["rail"] |= {"resistance": track.resistance, "drag": track.drag}
    loop["scenario"] = _as_json({**scenario, "seed": stop.seed})
    parameters = wsp_controller.parameters([stop.controller], stop.algo, settings)
    return {**settings_tree, **parameters, "antiskid": loop}


def _as_json(value: Any) -> Any:
    """As JSON has it; what is not stated, or without a limit, is left out."""
    if hasattr(value, "_asdict"):
        value = value._asdict()
    if isinstance(value, dict):
        return {k: _as_json(v) for k, v in value.items() if v is not None and v != math.inf}
    if isinstance(value, list | tuple):
        return [_as_json(v) for v in value]
    return value
