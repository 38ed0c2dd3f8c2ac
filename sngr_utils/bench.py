"""The engines side by side: the same windows, one run, one core, and what each gets wrong."""

import numpy as np
import pandas as pd

from sngr_utils import report
from sngr_utils.experiments.engine_bench import Performance, ratio
from sngr_utils.experiments.growth import Growth
from sngr_utils.metrics import standard_error


def speed_table(performances: dict[str, Performance], per_call: float) -> pd.DataFrame:
    """CPU time of a window and how many times faster than the loop, beside its calls alone.

    Parameters
    ----------
    per_call : CPU time of one whole compiled likelihood, [s]; a sampler that ends a call early,
        where the sum has passed its limit, needs less
    """
    rows = []
    for name, p in performances.items():
        seconds, calls = p.seconds.mean(), p.calls.mean()
        faster = ratio(performances, name)
        rows.append([
            name,
            report.text(faster, ".1f" if faster < 10 else ".0f"),
            report.text(1e3 * seconds, ".0f" if seconds > 0.05 else ".1f"),
            report.text(1e3 * calls * per_call, ".1f"),
            report.text(calls, ".0f"),
            report.text(p.ess.sum() / p.seconds.sum(), ".0f"),
        ])
    columns = ["engine", "ratio", "ms per window", "calls alone [ms]", "calls", "ESS per s"]
    return pd.DataFrame(rows, columns=columns)


def speed_series(
    performances: dict[str, Performance], per_call: float
) -> tuple[list[str], list[float], list[float]]:
    """Names, measured time and limit, [ms], as `plots.draw_engines` takes them."""
    measured = [1e3 * p.seconds.mean() for p in performances.values()]
    limits = [1e3 * p.calls.mean() * per_call for p in performances.values()]
    return list(performances), measured, limits


def accuracy_table(performances: dict[str, Performance]) -> pd.DataFrame:
    """What each engine gets wrong: bias of log Z, spread, mean, variances."""
    rows = []
    for name, p in performances.items():
        error = standard_error.standard_error(p.errors)
        rows.append([
            name,
            str(len(p.errors)),
            f"{report.text(p.errors.mean(), '+.3f')} ± {report.text(error, '.3f')}",
            report.text(float(np.sqrt(np.mean(p.errors**2))), ".3f"),
            report.text(float(np.sqrt(np.mean(p.mean_errors**2))), ".2f"),
            report.text(float(np.exp(np.mean(np.log(p.variance_ratios)))), ".2f"),
        ])
    columns = ["engine", "runs", "bias of log Z", "rms", "error of the mean", "variance ratio"]
    return pd.DataFrame(rows, columns=columns)


def growth_table(grown: Growth) -> pd.DataFrame:
    """CPU time at every length, and the fitted slope of each row."""
    rows = [
        [name, *(report.text(1e3 * s, ".3g") for s in seconds), report.text(grown.slope(name))]
        for name, seconds in grown.seconds.items()
    ]
    return pd.DataFrame(rows, columns=["ms", *(f"{n:,}" for n in grown.lengths), "slope"])
