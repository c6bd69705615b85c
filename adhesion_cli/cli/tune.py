"""`adhesion tune`: the parameters of an estimator for a fleet."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from ..core.errors import UserError
from . import options, results
from .options import Logs, Shared, option, shared

if TYPE_CHECKING:
    from ..studies.tune import Tuned


@shared("config", "set_", "dbc", "json", "force", "strict")
def command(
    logs: Logs,
    shared: Shared,
    algo: Annotated[
        str, option("-a --algo", "NAME", "The estimator.", **options.completes(options.estimators))
    ],
    out: Annotated[Path | None, option("-o --out", "FILE.toml", "Write what -c takes.")] = None,
    hold_back: Annotated[
        float, option("--hold-back", "SHARE", "Share of the logs to check with; 0.3.")
    ] = 0.3,
    seed: Annotated[int, option("--seed", "N", "Seed of their choice; 0.", min=0)] = 0,
) -> int:
    """Find the parameters of an estimator for the logs of a fleet.

    The rmse over brake applications becomes least on some logs, and is checked on the others, which
    are held back. It is against the true force where a log has it, else against the reference.
    Parameters that are not better on the logs held back are refused. The file of -o holds these
    parameters only: name it after the file of the vehicle, as -c train.toml -c my-neso.toml.

    Example: adhesion tune sample_logs/service-brake.csv leaf-film.mcap -a leso
    """
    from ..studies import tune
    from . import terminal

    files = options.settings_file(out)
    if not 0.0 < hold_back < 1.0:
        text = f"--hold-back {hold_back:g}: a share of the logs lies between 0 and 1"
        raise UserError(text, "--hold-back 0.3", code=2)
    options.check(shared, files, *logs)
    settings, progress = options.load_settings(shared), terminal.progress(shared.quiet)
    tuned = tune.tune(logs, settings, algo, hold_back=hold_back, seed=seed, progress=progress)
    return results.finish_study(shared, logs, files, tuned, tune, report(tuned, seed))


def report(tuned: "Tuned", seed: int) -> str:
    """The parameters before and after, and the rmse on both shares of the logs."""
    from ..core.model import quantities
    from .terminal import folded, number, records

    annotations = quantities(tuned.estimator.Params)
    parameters = [
        {
            "parameter": name,
            "unit": annotations[name].unit,
            "before": f"{default:g}",
            "tuned": f"{tuned.parameters[name]:g}",
        }
        for name, default in tuned.default_parameters.items()
    ]
    shares = [
        {
            "logs": data_part,
            "number": str(len(e.logs)),
            "RMSE before [N]": number(e.default_rmse),
            "RMSE tuned [N]": number(e.rmse),
        }
        for data_part, e in (("tuned on", tuned.train), ("held back", tuned.held_back))
    ]
    title = (
        f"{tuned.estimator.name}, logs held back by seed {seed}; RMSE against the true force where "
        "a log has it, else the reference:"
    )
    return "\n".join([folded(title), records(parameters, text_columns=2), "", records(shares)])
