"""Wheel-rail adhesion from brake-cylinder pressure and wheel speed.

>>> import adhesion_cli as adhesion
>>> run = adhesion.analyze("sample_logs/service-brake.csv")  # doctest: +SKIP
>>> run.applications[0].coefficient.mean  # doctest: +SKIP

A name is loaded when it is first used, so that the import itself takes no time.
"""

import sys

# `python -m adhesion_cli` would import modules from the working folder: a log may lie beside them.
if sys.argv[:1] == ["-m"] and not sys.flags.safe_path:
    del sys.path[0]

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .api.functions import (
        analyze,
        brake_test,
        calibrate,
        compare,
        convert,
        inspect,
        simulate,
        slip,
    )
    from .api.results import (
        Analysis,
        Axle,
        Calibration,
        Comparison,
        Inspection,
        SlipAnalysis,
        StopAnalysis,
    )
    from .core.errors import UserError
    from .core.finding import Finding
    from .formats.memory import Signals

__version__ = "0.1.0"
__all__ = [
    "Analysis", "Axle", "Calibration", "Comparison", "Finding", "Inspection", "Signals",
    "SlipAnalysis", "StopAnalysis", "UserError", "analyze", "brake_test", "calibrate", "compare",
    "convert", "inspect", "simulate", "slip",
]  # fmt: skip
_PLACES = {"UserError": "core.errors", "Finding": "core.finding", "Signals": "formats.memory"}


if not TYPE_CHECKING:  # else a type checker would take every name for a known one

    def __getattr__(name: str) -> Any:
        if name not in __all__:
            raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
        from importlib import import_module

        place = _PLACES.get(name, "api.results" if name[0].isupper() else "api.functions")
        value = globals()[name] = getattr(import_module(f".{place}", __name__), name)
        return value


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
