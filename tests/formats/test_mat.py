"""MATLAB files: vectors, structures and matrices become columns."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from adhesion_cli.core.errors import UserError
from adhesion_cli.formats.open import open_source
from adhesion_cli.formats.source import ReadOptions

N = 200
T, P, V = np.arange(N) / 50, np.linspace(0, 3, N), np.linspace(72, 60, N)


def columns(path: Path, variables: dict[str, Any], **options: Any) -> dict[str, Any]:
    savemat(path, variables, **options)
    source = open_source(path, ReadOptions())
    assert source.format == "mat"
    found = source.columns(source.fields)
    return {f.channel: c for f, c in zip(source.fields, found, strict=True)}


@pytest.mark.parametrize(
    ("variables", "names"),
    [
        ({"t_s": T, "p_bar": P, "v_kmh": V, "fs": 50.0, "note": "x"}, ["p_bar", "v_kmh"]),
        (
            {"log": {"time_s": T, "brake": {"p_bar": P}, "v_kmh": V}},
            ["log.brake.p_bar", "log.v_kmh"],
        ),
        ({"time": T, "p_bar": P, "v_kmh": np.stack([V, V])}, ["p_bar", "v_kmh_1", "v_kmh_2"]),
        ({"time": T[:, None], "gain": np.ones(N + 5), "p_bar": P, "v_kmh": V}, ["p_bar", "v_kmh"]),
        ({"time": T, "p_bar": P.astype(np.float32), "k": np.arange(N)}, ["p_bar", "k"]),
        ({"Fs": 50.0, "p_bar": P, "v_kmh": V}, ["p_bar", "v_kmh"]),
        ({"log": {"dt": 0.02, "p_bar": P, "v_kmh": V}}, ["log.p_bar", "log.v_kmh"]),
        (
            {"s": {"time": T, "signals": [{"values": P, "label": "p_bar"}, {"values": V}]}},
            ["s.signals.p_bar", "s.signals.2"],
        ),
    ],
)
def test_variables_of_one_length(
    tmp_path: Path, variables: dict[str, Any], names: list[str]
) -> None:
    found = columns(tmp_path / "a.mat", variables, do_compression="gain" in variables)
    assert list(found) == names
    assert all(np.allclose(c.t, T * 1e9) for c in found.values())
    assert np.allclose(found[names[0]].value, P, atol=1e-6)


def test_variables_that_are_not_read_are_reported(tmp_path: Path) -> None:
    path, slow = tmp_path / "a.mat", {"time_p": T[::4], "p_bar": P[::4]}
    large = {"map": np.ones((N, 100)), "cube": np.ones((2, 3, 4))}
    savemat(path, {"time": T, "v_kmh": V, "fs": 50.0, **slow, **large})
    source = open_source(path, ReadOptions())
    assert [f.channel for f in source.fields] == ["v_kmh"]
    [finding] = [f for f in source.findings if f.code == "group-not-read"]
    names = "time_p (50), p_bar (50), map (200 x 100), cube (2 x 3 x 4)"
    assert (finding.count, finding.names["groups"]) == (4, names)


def test_what_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.mat"
    with pytest.raises(UserError, match=r"no two variables .* \(variables: p \(200\)") as error:
        columns(path, {"p": P})
    assert "vectors of one length" in error.value.hint
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(600))
    with pytest.raises(UserError, match=r"version 7\.3 \(HDF5\)") as error:
        open_source(path, ReadOptions())
    assert "-v7" in error.value.hint
    path.write_bytes(b"MATLAB 5.0 MAT-file" + bytes(range(256)) * 4)
    with pytest.raises(UserError, match="damaged MATLAB file"):
        open_source(path, ReadOptions())
