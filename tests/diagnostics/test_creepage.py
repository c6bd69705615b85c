"""One axle whose creepage contradicts its pressure, in comparison with the other axles."""

from dataclasses import replace

import numpy as np
import pytest

from adhesion_cli.analysis.prepare import Prepared, prepare
from adhesion_cli.channels.log import read
from adhesion_cli.core.finding import Finding
from adhesion_cli.core.model import Parameter, Vehicle
from adhesion_cli.formats.memory import MemorySource, Signals
from adhesion_cli.reference.force import compute

T = np.arange(0.0, 50.0, 0.05)
BRAKE = np.interp(T, [8.0, 10.0], [0.0, 3.0])  # [bar]
DIAMETERS = (1.0, 1.01, 0.99, 1.005)


def prepared(
    force: float = 1.0,
    rail: float = 1.0,
    read_low: float = 1.0,
    late: float = 0.0,
    *axles: int,
    mass_share: float = Vehicle().axle_mass.share,
) -> Prepared:
    """On a stop of four axles with a stiffness of 25 per unit of slip.

    Args:
        force: of some axles, as a share of what their pressure gives.
        rail: stiffness of their rail, as a share.
        read_low: what their pressure sensors read, as a share.
        late: by how much their speeds are delayed [s].
        axles: which ones; the second by default.
        mass_share: 1 sigma of the stated mass, as a share.
    """
    v = np.maximum(32.0 - 0.05 * np.cumsum(0.35 * BRAKE + 0.02), 0.0)
    rng, signals = np.random.default_rng(4), {}
    for number in (1, 2, 3, 4):
        share, stiffness, reading, delay = (
            (force, rail, read_low, late) if number in (axles or (2,)) else (1.0, 1.0, 1.0, 0.0)
        )
        slip = 0.035 * BRAKE * share / (25.0 * stiffness)
        rim = DIAMETERS[number - 1] * np.interp(T - delay, T, v * (1.0 - slip))
        signals[f"BCP {number} [bar]"] = reading * BRAKE
        noise = rng.normal(0.0, 0.02, len(T))
        signals[f"axle {number} [km/h]"] = np.round(3.6 * rim + noise, 1)
    signals["train speed [km/h]"] = 3.6 * v
    mass = Vehicle().axle_mass.value
    mass_and_tolerance = Parameter(mass, mass_share * mass)
    vehicle = replace(Vehicle(), spring_force=Parameter(0.0, 0.0), axle_mass=mass_and_tolerance)
    return prepare(read(MemorySource(Signals(T, signals)), (), vehicle), vehicle)


def findings(*args: float, **named: float) -> list[Finding]:
    """What `prepared` says of the axles' forces."""
    axles = [int(axle) for axle in args[4:]]
    log = prepared(*args[:4], *axles, **named)
    return [f for f in log.findings if f.code == "axle-force-suspect"]


@pytest.mark.parametrize("axle", [1, 3])
def test_an_axle_that_creeps_less_brakes_less(axle: int) -> None:
    (finding,) = findings(0.7, 1.0, 1.0, 0.0, axle)
    assert finding.channel == f"BCP {axle} [bar]"
    assert finding.values["share"] == pytest.approx(0.7, abs=finding.values["share_u95"])
    assert finding.values["share_u95"] < 0.1


def test_where_no_mass_is_stated_an_axle_may_be_heavier() -> None:
    """Its creepage for the same brake force is lower, as of a motor bogie beside trailers."""
    assert findings(0.72)
    assert not findings(0.72, mass_share=0.3)
    assert findings(0.5, mass_share=0.3)


def test_the_band_of_a_suspect_axle_holds_both_forces() -> None:
    vehicle = replace(Vehicle(), spring_force=Parameter(0.0, 0.0))
    means, sigmas = {}, {}
    for record in prepared(0.6).records:
        force = compute(record, vehicle)
        braked = record.clamping_force_smooth > 0.9 * record.clamping_force_smooth.max()
        means[record.axle] = float(np.nanmean(force.force[braked]))
        sigmas[record.axle] = float(np.nanmean(force.tolerance[braked]))
    assert means[2] == pytest.approx(means[1], rel=0.02)  # by its pressure
    assert 1.96 * sigmas[2] > 0.38 * means[2]
    assert sigmas[3] < 0.7 * sigmas[2]


def test_a_pressure_that_reads_too_low_is_seen_by_the_creepage() -> None:
    (finding,) = findings(read_low=0.7)
    assert finding.values["share"] == pytest.approx(1.0 / 0.7, abs=finding.values["share_u95"])


def test_a_wet_rail_under_one_axle_and_a_delayed_speed_are_no_brake() -> None:
    assert not findings()
    assert not findings(rail=0.7)
    assert not findings(late=0.1)
    assert not findings(0.7, 1.0, 1.0, 0.0, 3, 4)  # which two are right, nothing shows
    assert not findings(force=0.7, read_low=0.7)  # an axle that is braked less by design


def test_a_pressure_that_one_axle_lacks_for_a_while_does_not_stop_the_comparison() -> None:
    rim = 3.6 * np.maximum(32.0 - 0.05 * np.cumsum(0.35 * BRAKE + 0.02), 0.0)
    signals = {f"axle {n} [km/h]": rim for n in (1, 2, 3, 4)} | {"train speed [km/h]": rim}
    rng = np.random.default_rng(1)
    for n in (1, 2, 3, 4):
        pressure = BRAKE + rng.normal(0.0, 0.02, len(T))
        signals[f"BCP {n} [bar]"] = np.minimum(pressure, 2.5) if n == 2 else pressure
    log = read(MemorySource(Signals(T, signals)), (), Vehicle())
    codes = {f.code for f in prepare(log, Vehicle()).findings}
    assert "pressure-saturated" in codes
    assert "axle-force-suspect" not in codes  # wheels without creepage show nothing


@pytest.mark.parametrize("seed", [2, 3, 6, 10])
def test_a_trailer_beside_blended_axles_has_its_own_error_by_the_train_speed(seed: int) -> None:
    """The slow noise of a receiver cancels only between axles that brake at the same times."""
    rng, signals = np.random.default_rng(seed), {}
    blended = BRAKE * np.interp(T, [18.0, 20.0, 30.0, 32.0], [1.0, 0.4, 0.4, 1.0])
    brakes = {1: blended, 2: 0.5 * BRAKE, 3: blended, 4: blended, 5: blended}
    v = np.maximum(32.0 - 0.05 * np.cumsum(0.07 * sum(brakes.values()) + 0.02), 0.0)
    slow_noise = np.convolve(rng.normal(0.0, 0.02, len(T)), np.full(60, 60**-0.5), "same")
    for n, brake in brakes.items():
        rim = 3.6 * v * (1.0 - 0.035 * brake / 25.0) + rng.normal(0.0, 0.02, len(T))
        signals |= {f"BCP {n} [bar]": brake, f"axle {n} [km/h]": np.round(rim, 2)}
    signals["train speed [km/h]"] = 3.6 * np.maximum(v + slow_noise, 0.0)
    vehicle = replace(Vehicle(), spring_force=Parameter(0.0, 0.0))
    log = read(MemorySource(Signals(T, signals)), (), vehicle)
    assert not [f for f in prepare(log, vehicle).findings if f.code == "axle-force-suspect"]
