"""Numbers and times as people's logs write them: each kind in seeded variants."""

from pathlib import Path

import numpy as np
import pytest
from helpers import wild_logs
from helpers.wild_logs import KINDS, ROWS, P, T

from adhesion_cli.core.time_axis import clean
from adhesion_cli.core.units import in_name, unit
from adhesion_cli.formats.csv.reader import open_csv
from adhesion_cli.formats.source import ReadOptions

_SOUND = {"time-coarse-spread", "time-wrapped"}  # they cost no sample


@pytest.mark.parametrize("kind", KINDS)
def test_each_kind_of_log_gives_the_same_samples(tmp_path: Path, kind: str) -> None:
    for log in wild_logs.variants(kind):
        path = tmp_path / log.name
        path.write_bytes(log.text)
        source = open_csv(path, ReadOptions())
        fields = {f.unit or in_name(f.channel)[1]: f for f in source.fields}
        symbol, field = next(
            (u, f)
            for u, f in fields.items()
            if (known := unit(u)) and known.dimension == "pressure"
        )
        (column,) = source.columns([field])
        axis = clean("p", column, int(column.t.min()))
        findings = [*source.findings, *axis.findings]
        expected = _SOUND | ({"csv-rows-skipped"} if kind == "K1-blocks" else set())
        assert {f.code for f in findings if f.severity != "info"} <= expected, log.text[:300]
        known = unit(symbol)
        assert known is not None
        assert len(axis.data.t) == ROWS, log.text[:300]
        assert np.abs((axis.data.t - axis.data.t[0]) / 1e9 - T).max() <= log.apart_s
        assert np.abs(axis.data.value * known.factor / 1e5 - P).max() <= log.pressure_bar
