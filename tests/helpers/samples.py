"""The bundled logs with the vehicle of their scenarios, each analysed once in a run."""

from functools import cache

from adhesion_cli.analysis import settings
from adhesion_cli.analysis.analyze import analyze
from adhesion_cli.core import bundled
from adhesion_cli.core.model import Result


@cache
def analysed_sample(name: str) -> Result:
    """A bundled log, with the estimator `td`."""
    stated = settings.load(None, ["analysis.vehicle=stated"])
    return analyze(bundled.folder("sample_logs") / f"{name}.csv", stated, ["td"])
