"""Stops of the whole train, and their statistics, as rows of text."""

from collections.abc import Sequence

from ..core.summary import Measured, StopSummary
from ..core.text import by_uncertainty
from .text_tables import number

NOTE = (
    "One row per stop of the whole train, from the command to standstill, with expanded "
    "uncertainties (95\N{NO-BREAK SPACE}%). a: mean deceleration v0²/(2s); a equiv.: without the "
    "response time, which is delay and half of the build-up; level: distance on level track from "
    "the nominal speed."
)
_COMMAND = {
    "channel": "a command channel",
    "brake_pipe": "the fall of the brake pipe",
    "pressure": "the first rise of a cylinder pressure: the dead time before it is not counted",
    "deceleration": "the begin of the deceleration",
}
_SPEED = {"train": "the train speed", "axles": "the axles: no train speed is logged"}


SHORT = ("at [s]", "v0 [km/h]", "distance [m]", "a [m/s²]", "a equiv.", "response [s]", "level [m]")


def short_row(s: StopSummary) -> dict[str, str]:
    """The figures of a stop that a first screen has room for."""
    return {name: cell for name, cell in stop_row(s).items() if name in SHORT}


def stop_row(s: StopSummary) -> dict[str, str]:
    """A stop: when, from which speed, distance, deceleration, response."""
    return {
        "at [s]": number(s.start_s, 1),
        "v0 [km/h]": with_u95(s.initial_speed_mps, 3.6, 1),
        "distance [m]": with_u95(s.distance_m, 1.0, 1),
        "time [s]": with_u95(s.duration_s, 1.0, 2),
        "a [m/s²]": with_u95(s.mean_deceleration, 1.0, 3),
        "a equiv.": with_u95(s.equivalent_deceleration, 1.0, 3),
        "response [s]": with_u95(s.response_time_s, 1.0, 2),
        "jerk [m/s³]": with_u95(s.jerk, 1.0, 2),
        "level [m]": with_u95(s.corrected_distance_m, 1.0, 1),
        "µ": with_u95(s.coefficient, 1.0, 3),
    }


def with_u95(x: Measured | None, factor: float, digits: int) -> str:
    """A quantity with its uncertainty, to at most these decimals."""
    if x is None:
        return "-"
    return "±".join(by_uncertainty(factor * x.value, factor * x.u95, digits))


def describe_sources(stops: Sequence[StopSummary]) -> str:
    """What showed command and speed of the stops."""
    commands = " or ".join(_COMMAND[x] for x in dict.fromkeys(s.command_from for s in stops))
    speeds = " or ".join(_SPEED[x] for x in dict.fromkeys(s.speed_from for s in stops))
    return f"Command: {commands}. Speed: {speeds}."
