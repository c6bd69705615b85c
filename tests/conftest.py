import functools
import gc
import os
import sys
from pathlib import Path

import pytest
import typer.main
from helpers.commands import Run, in_process
from hypothesis import settings

from adhesion_cli.core import finding

# As the program has it: looking through all that is imported, again and again, is 5 % of the time.
gc.set_threshold(100_000)
# Else every process of a test compiles the package anew, and each run of the tests these: 20 s.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
# As the program has it: threads of OpenBLAS wait busily, and each core has a process of tests.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
# Typer builds all commands anew for each call of one: a tenth of a short one.
typer.main.get_command = functools.cache(typer.main.get_command)
settings.register_profile("deterministic", derandomize=True, deadline=None)
settings.load_profile("deterministic")


@pytest.fixture(autouse=True)
def every_field_is_stated(monkeypatch: pytest.MonkeyPatch) -> None:
    """A finding that lacks a field of its template is a fault of ours; users still see the rest."""

    def refuse(_: object, key: str) -> str:
        raise KeyError(key)

    monkeypatch.setattr(finding._Fields, "__missing__", refuse)


@pytest.fixture
def run(tmp_path: Path) -> Run:
    """The command in this process, in an empty folder."""
    return functools.partial(in_process, tmp_path)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What runs commands in forks comes first: one of two processes then starts their server.

    Such a server imports all and analyses a log, for 8 s. The other process begins in the middle.
    """
    forking = "tests", "cli", "fleet", "live", "results"
    items.sort(key=lambda item: item.path.parent.name not in forking)
