"""The log of the first cars of a long train, whose other cars brake later and otherwise."""

from pathlib import Path

import numpy as np
import pytest

from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.analysis.settings import load
from adhesion_cli.analysis.stops_of_log import stops_of_result
from adhesion_cli.analysis.summarise import brake_applications

T = np.arange(0.0, 70.0, 0.05)
LOGGED = -np.expm1(-np.maximum(T - 6.0, 0.0) / 0.5)  # build-up of the logged axles
LOCOMOTIVE, WAGONS = 0.2, 0.9  # deceleration by the brakes of each, of their own mass [m/s²]


@pytest.mark.parametrize("later", [0.0, 2.5])
def test_other_cars_that_brake_later_make_the_force_unsure(later: float, tmp_path: Path) -> None:
    others = -np.expm1(-np.maximum(T - 6.0 - 0.4 * later, 0.0) / max(later, 0.5))
    # a fifth of the train's mass is the locomotive's, unless all brake alike
    slowing = 0.2 * LOCOMOTIVE * LOGGED + 0.8 * WAGONS * others if later else WAGONS * LOGGED
    v = np.maximum(25.0 - 0.05 * np.cumsum(0.015 + slowing), 0.0)
    rng, columns = np.random.default_rng(6), {"t [s]": T}
    for axle in (1, 2, 3, 4):
        columns[f"BCP {axle} [bar]"] = 3.0 * LOGGED + rng.normal(0.0, 0.006, len(T))
        columns[f"axle {axle} [km/h]"] = 3.6 * v + rng.normal(0.0, 0.02, len(T)) * (v > 0.0)
    columns["train speed [km/h]"] = 3.6 * v
    path = tmp_path / "locomotive.csv"
    header = ",".join(columns)
    np.savetxt(path, np.column_stack([*columns.values()]), "%.3f", ",", header=header, comments="")
    result = analyze(path, load(folder=False), ["td"])
    early = [f for f in result.findings if f.code == "pressure-delay" and f.names["why"]]
    applications = brake_applications(result)
    (application, *_), (stop, *_) = applications[1], stops_of_result(result, applications.values())
    assert application.coefficient is not None
    true = (LOCOMOTIVE if later else WAGONS) / 9.81
    off = abs(application.coefficient.mean - true)
    assert bool(early) == bool(later)
    assert off < application.coefficient.mean_u95
    assert (application.coefficient.mean_u95 > 0.8 * application.coefficient.mean) == bool(later)
    assert stop.response_time_s is not None
    assert stop.response_from == ("deceleration" if later else "brakes")
    if later:  # by the lags of the saturations, weighted by force
        lag = (0.2 * LOCOMOTIVE * 0.5 + 0.8 * WAGONS * (1.0 + later)) / (
            0.2 * LOCOMOTIVE + 0.8 * WAGONS
        )
        assert stop.response_time_s.value == pytest.approx(lag, abs=0.1)
