"""The line on the vehicle that stands above every result: stated or found, and how well known."""

from collections.abc import Sequence

import numpy as np

from ..core.summary import AxleSummary, VehicleSummary

_UNKNOWN = (
    "Vehicle: not stated, and the log cannot show its brake. Adhesion force and µ are not known. "
    "State the vehicle with -c FILE.toml."
)


def describe_vehicle(vehicle: VehicleSummary, axles: Sequence[AxleSummary] = ()) -> str:
    """The line, as plain text.

    Args:
        vehicle: that was used.
        axles: of the result, whose µ has an uncertainty.
    """
    if not vehicle.known:
        return _UNKNOWN
    evidence = _evidence(vehicle)
    if vehicle.source == "log":
        shares = [
            100.0 * a.coefficient.mean_u95 / a.coefficient.mean
            for axle in axles
            for a in axle.applications
            if a.coefficient and a.coefficient.mean > 0.0
        ]
        accuracy = f", µ ± {np.median(shares):.0f} %" if shares else ""
        return (
            "Vehicle: not stated. Its brake force per mass is found from "
            f"{evidence}{accuracy}. State the vehicle (-c FILE.toml) for newtons and a narrower "
            "band."
        )
    words = "as stated" if vehicle.source == "stated" else "not stated, the default one"
    stated = _force(vehicle.stated_force_per_bar_n, vehicle.stated_u95)
    used = _force(vehicle.force_per_bar_n, vehicle.u95)
    if vehicle.other_brake:
        return (
            f"Vehicle: {words}, but another brake slows the train as well. Force and µ are those "
            "of the air brake alone."
        )
    if vehicle.contradicted_by:
        factor = f"{vehicle.contradicted_by:.2g} times"
        return f"Vehicle: {words}, but the log contradicts it: its brake is {factor} as strong."
    if not vehicle.stops:
        return f"Vehicle: {words}{stated and f', force per bar {stated}'}."
    if not stated or not used:
        return f"Vehicle: {words}, with {evidence}."
    return f"Vehicle: {words}, force per bar {stated}. Used: {used}, with {evidence}."


def _evidence(vehicle: VehicleSummary) -> str:
    """How many brake applications of how many logs were used."""
    stops = "1 brake application" if vehicle.stops == 1 else f"{vehicle.stops} brake applications"
    return f"{stops} of {'this log' if vehicle.logs <= 1 else f'{vehicle.logs} logs'}"


def _force(force: float | None, u95: float | None) -> str:
    """A force per bar with its relative uncertainty (95 %); empty where there is none."""
    if not force or u95 is None:
        return ""
    return f"{force / 1e3:.3g} kN ± {100.0 * u95 / force:.0f} %"
