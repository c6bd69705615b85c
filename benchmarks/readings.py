"""Other readings of the paper's text than those of `adhesion reproduce`, and what they give.

    python benchmarks/readings.py

The paper leaves the sample interval, how the methods start, and the meaning of "noise power" and
"maximum error" to the reader. Each line is one reading and one method: time to 95 % and maximum
error of the constant condition, as in Table 2. The last line is of the varying condition.
"""

from collections.abc import Mapping
from typing import NamedTuple

from adhesion_cli.core.model import Vehicle
from adhesion_cli.core.physics import wheelset
from adhesion_cli.studies import reproduce
from adhesion_cli.studies.reproduce import DELAY, INTERVAL, POWER, PUBLISHED

SEEDS = range(1, 11)


class Reading(NamedTuple):
    """One way to read the text, as far as it differs from `reproduce.READINGS`."""

    text: str
    algos: tuple[str, ...] = tuple(PUBLISHED)
    parameters: Mapping[str, float] = {}
    interval: float = INTERVAL  # of the samples [s]
    variance: float = POWER  # of each sample of the wheel speed [rad²/s²]
    coasting: float = DELAY  # before the brake [s]
    settles: bool = False  # the response time is that of settling
    error_seconds: float = 2.0  # of which the maximum error is taken

    def measured(self, algo: str) -> dict[str, float | None]:
        """Response time and maximum error of a method."""
        scenario = reproduce.constant_scenario(self.coasting, self.interval, self.variance)
        parameters = {**reproduce.printed(algo, self.interval), **self.parameters}
        judged = self.settles, self.error_seconds
        return reproduce.measure_constant(algo, SEEDS, scenario, parameters, *judged)


_A = wheelset(Vehicle(), 1).a
READINGS = (
    Reading("state not scaled: (9) as printed", ("leso", "neso"), {"beta2": 216.0 * _A}),
    Reading("(14) as printed", ("gradient",), {"p": 10.0 * _A**2 / 4.0}),
    Reading("noise power is a spectral density", variance=POWER / INTERVAL),
    Reading("sample interval 1 ms", interval=1e-3),
    Reading("sample interval 2 ms", interval=2e-3),
    Reading("sample interval 5 ms", interval=5e-3),
    Reading("started with the brake, delay not counted", coasting=0.0),
    Reading("settled within 5 %", ("leso", "neso", "gradient", "kalman"), settles=True),
    Reading("maximum error of the last 4 s", error_seconds=4.0),
    Reading("started at y0", ("td",), {"from_zero": 0.0}),
    Reading("h0 = 2h", ("td",), {"h0": 2.0 * INTERVAL}),
    Reading("h0 = 3h", ("td",), {"h0": 3.0 * INTERVAL}),
    Reading("h0 = 4h", ("td",), {"h0": 4.0 * INTERVAL}),
    Reading("exact steps", ("td", "leso", "neso", "gradient"), {"euler": 0.0}),
    Reading("kept alive by process noise q = 1e-5", ("kalman",), {"q": 1e-5}),
    Reading("R = 100, not the noise's", ("kalman",), {"R": 100.0 * INTERVAL / 1e-3}),
)


def main() -> None:
    """Prints every reading."""
    for reading in READINGS:
        for algo in reading.algos:
            row = reading.measured(algo)
            response = "-" if row["response_s"] is None else f"{row['response_s']:.2f}"
            print(f"{reading.text:<42} {algo:<9} {response:>6} s {row['max_error_n']:>8.1f} N")
    alive = reproduce.measure_varying("kalman", SEEDS[:5], {"q": 1e-5})
    text = "varying, kept alive by process noise"
    figures = f"rmse {alive['rmse_n']:.0f} N, lag {alive['lag_s']:.2f} s, gain {alive['gain']:.2f}"
    print(f"{text:<42} {'kalman':<9} {figures}")


if __name__ == "__main__":
    main()
