"""What the engines are compared on, and what a comparison gives; nothing here runs any."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from sngr_utils.metrics.standard_error import standard_error
from sngr_utils.settings import Checked, Probability


class BenchSettings(Checked):
    """What the engines are compared on, and how often.

    bench_p : wrong-association probability of the world
    bench_windows : windows of it, spread evenly
    bench_runs : turns over the windows; the compiled samplers run ten times in each, dynesty in
        every third, with the loop over the closure in every ninth
    reference_draws : importance samples behind each window's reference evidence and mean
    lengths : numbers of poses at which the growth is measured
    """

    bench_p: Probability = 0.2
    bench_windows: Annotated[int, Field(ge=1)] = 4
    bench_runs: Annotated[int, Field(ge=2)] = 36
    reference_draws: Annotated[int, Field(ge=1000)] = 100_000
    lengths: Annotated[list[Annotated[int, Field(ge=3)]], Field(min_length=2)] = [
        30, 100, 300, 1000, 3000, 10_000, 30_000,
    ]  # fmt: skip


@dataclass(frozen=True)
class Performance:
    """What the runs of one contender came to. R runs over the bench's windows.

    Attributes
    ----------
    seconds : (R,) CPU time of each run
    calls : (R,) likelihood calls
    errors : (R,) log Z less the reference, [nats]
    mean_errors : (R,) root mean square error of the mean, in posterior standard deviations
    variance_ratios : (R,) geometric mean of the variances over the reference's
    ess : (R,) effective samples
    """

    seconds: np.ndarray
    calls: np.ndarray
    errors: np.ndarray
    mean_errors: np.ndarray
    variance_ratios: np.ndarray
    ess: np.ndarray


# The sampler of the paper with GTSAM's factors one by one in a Python loop: all of the closure,
# as the paper describes it, and those that touch the window. Ratios are to the second.
NESTLE, BLACKJAX = PEERS = ("nestle, one ellipsoid", "blackjax, nested slice")
MOST_BIAS, MOST_ERROR = 0.05, 0.012  # nats, of an engine's log Z, that a ratio may stand beside
CLOSURE_LOOP, WINDOW_LOOP = "dynesty, loop over the closure", "dynesty, loop over the window"


def ratio(slow: np.ndarray, fast: np.ndarray) -> tuple[float, float, float]:
    """How many times faster one is than another, and the 95 % interval of that.

    The interval is that of a quotient of two means on a log scale, from the spread over repeats. It
    says nothing of another machine, nor of another day on this one.

    Parameters
    ----------
    slow, fast : times of repeats of each, not necessarily as many; NaN ends for a single one
    """
    faster = float(np.mean(slow) / np.mean(fast))
    errors = [standard_error(times) / np.mean(times) for times in (slow, fast)]
    reach = float(np.exp(1.96 * np.hypot(*errors)))
    return faster, faster / reach, faster * reach


def comparable(performance: Performance) -> bool:
    """Whether the 95 % interval of the bias of log Z lies within `MOST_BIAS`, and is narrow.

    Only then is a ratio of times one between two ways of computing the same number.
    """
    bias, error = performance.errors.mean(), standard_error(performance.errors)
    return bool(abs(bias) + 1.96 * error <= MOST_BIAS and error <= MOST_ERROR)
