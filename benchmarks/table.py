"""Every benchmark of this folder in one table: ours, the rival, their ratio, the target.

    python benchmarks/table.py            # all of them, a quarter of an hour
    python benchmarks/read_mcap.py        # one of them

A benchmark is a file with `rows()`, which measures and gives a `Row` per case.
"""

import importlib
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple


class Row(NamedTuple):
    """One case, measured on both sides in one run."""

    name: str
    ours: float
    rival: float
    unit: str
    against: str  # who the rival is
    least: float | None = None  # target of ours / rival
    most: float | None = None

    @property
    def ratio(self) -> float:
        return self.ours / self.rival

    @property
    def target(self) -> str:
        if self.least is not None:
            return f"≥ {self.least:g}"
        return "" if self.most is None else f"≤ {self.most:g}"

    @property
    def met(self) -> str:
        if self.least is None and self.most is None:
            return ""
        low, high = self.least or 0.0, float("inf") if self.most is None else self.most
        return "yes" if low <= self.ratio <= high else "NO"


def show(rows: Iterable[Row]) -> None:
    """Prints the table, each row as soon as it is measured."""
    print(f"{'':36} {'ours':>9} {'rival':>9} {'unit':10} {'ratio':>7} {'target':>7} met  rival is")
    for row in rows:
        print(
            f"{row.name:36} {row.ours:9.4g} {row.rival:9.4g} {row.unit:10} {row.ratio:7.3g} "
            f"{row.target:>7} {row.met:4} {row.against}",
            flush=True,
        )


def every() -> Iterator[Row]:
    """Rows of every benchmark in this folder that compares."""
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if hasattr(benchmark := importlib.import_module(path.stem), "rows"):
            yield from benchmark.rows()


if __name__ == "__main__":
    show(every())
