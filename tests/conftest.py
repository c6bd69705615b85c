import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import settings

from adhesion_cli.core import finding

settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")


@pytest.fixture(autouse=True)
def every_field_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    """A finding that lacks a field of its template is a fault of ours; users still see the rest."""

    def refuse(_: object, key: str) -> str:
        raise KeyError(key)

    monkeypatch.setattr(finding._Fields, "__missing__", refuse)


@pytest.fixture
def run(tmp_path: Path) -> Callable[..., subprocess.CompletedProcess[str]]:
    """The command in a process of its own, in an empty folder."""

    def adhesion(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-m", "adhesion_cli", *map(str, arguments)],
            cwd=tmp_path, capture_output=True, text=True, check=False, timeout=300,
        )  # fmt: skip

    return adhesion
