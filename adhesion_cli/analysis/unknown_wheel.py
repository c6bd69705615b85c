"""Wheels of a diameter that nobody states and the log does not show."""

from collections.abc import Sequence
from dataclasses import replace

from ..core.model import Parameter, Vehicle
from .prepare import AlignedLog
from .settings import Settings

ANY_WHEEL = 0.12  # 1 sigma of the radius, as a share: 95 % of diameters are 0.64 to 1.04 m


def is_wheel_unknown(log: AlignedLog, settings: Settings) -> bool:
    """Whether speeds count turns of wheels that nobody states, and no train speed shows them."""
    states_wheel = "wheel_radius" in settings.stated or settings.analysis.vehicle == "stated"
    return not states_wheel and any(not a.record.of_rim and a.train is None for a in log.axles)


def with_any_wheel(logs: Sequence[AlignedLog], settings: Settings) -> Settings:
    """The settings; with wheels of any railway vehicle where a log does not show the diameter."""
    if not any(is_wheel_unknown(log, settings) for log in logs):
        return settings
    axles = tuple(x._replace(vehicle=_any_wheel(x.vehicle)) for x in settings.vehicle.axles)
    return replace(settings, vehicle=replace(_any_wheel(settings.vehicle), axles=axles))


def _any_wheel(vehicle: Vehicle) -> Vehicle:
    radii = (Parameter(R.value, ANY_WHEEL * R.value) for R in vehicle.wheel_radius)
    return replace(vehicle, wheel_radius=tuple(radii))
