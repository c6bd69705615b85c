"""`adhesion calibrate`: the vehicle from its own logs."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from . import results
from .options import Logs, Shared, check, load_settings, option, settings_file, shared

if TYPE_CHECKING:
    from ..studies.calibrate import CalibrationRun


@shared("config", "set_", "dbc", "json", "force", "strict")
def command(
    logs: Logs,
    shared: Shared,
    out: Annotated[Path | None, option("-o --out", "FILE.toml", "Write what -c takes.")] = None,
) -> int:
    """Find the vehicle's force from the deceleration of its logs.

    All logs are of one vehicle. The brake applications in which all wheels roll determine the
    friction and its change over speed, the spring force and the delay of the pressure. The mass
    limits the result: state it with its tolerance.

    Example: adhesion calibrate sample_logs/service-brake.csv leaf-film.mcap
    """
    from ..studies import calibrate
    from . import terminal

    files = settings_file(out)
    check(shared, files, *logs)
    calibration = calibrate.calibrate(logs, load_settings(shared), terminal.progress(shared.quiet))
    return results.finish_study(shared, logs, files, calibration, calibrate, report(calibration))


def report(calibration: "CalibrationRun") -> str:
    """The table prior → posterior, and the band before and after."""
    from ..studies.calibrate import as_rows
    from .terminal import folded, records

    result = calibration.result
    prior, posterior = (100.0 * u / x for u, x in zip(result.band, result.force, strict=True))
    ratio, mass = result.rows["force_over_mass"], result.rows["axle_mass"]
    force_u, mass_u = (100.0 * x.posterior_u / x.posterior for x in (ratio, mass))
    limit = (
        f"The logs show the force over the mass within {force_u:.1f} %. The mass is known within "
        f"{mass_u:.1f} %, and the force no better. The other axles may brake otherwise by "
        f"{100.0 * calibration.settings.train.alike:.1f} %: that is in the friction, too "
        "(`train.alike`; 1 sigma each)."
    )
    counts = f"{calibration.applications}, logs: {len(calibration.logs)}"
    head = f"Brake applications: {counts}; ± is 1 sigma:"
    band = f"95 % band of the force at the mean brake: ±{prior:.1f} % as stated, "
    band += f"±{posterior:.1f} % calibrated"
    table = records(as_rows(calibration), text_columns=3)
    return "\n".join([head, "", table, "", band, folded(limit)])
