"""How a verdict follows from a printed value and ours. Pure functions; nothing is judged by hand.

A printed number that is the outcome of one or five worlds counts as reproduced if our worlds do
not refute it; a claim in prose counts as reproduced only if our worlds support it. Each rule says
how often it errs. A sample is (n,), one number per world, NaN where undefined.
"""

import math

import numpy as np
from scipy import stats

from sngr_utils.publish.printed import Printed

REPRODUCED = "reproduced"
TREND = "trend reproduced"
NOT = "not reproduced"
CANNOT = "cannot hold"
NO_RATIO = "not comparable"
VERDICTS = (REPRODUCED, TREND, NOT, CANNOT, NO_RATIO)

LEVEL = 0.05  # wanted probability of refuting a value that is right
MIN_WORLDS = 20
SPLITS = 10_000  # random choices of five worlds
SPLIT_TAILS = (0.01, 0.99)  # what errs in about 5 %, measured: 30 worlds know little of tails
PRINTED_WORLDS = 5  # behind the paper's means
SAME_RATIO, SAME_ORDER = 2.0, 10.0  # factors within which two ratios of wall clocks agree


def deterministic(ours: float, printed: Printed) -> bool:
    """Whether our value rounds to the printed one. Never errs: nothing is random."""
    return printed.value is None if math.isnan(ours) else printed.allows(ours)


def world_interval(sample: np.ndarray) -> tuple[float, float]:
    """Closed interval that holds the value of one further world.

    From the k-th smallest to the k-th largest of n values, k = max(1, floor(0.025 (n + 1))).
    If all n + 1 worlds are alike in law, each rank of the further one is equally likely, so it
    falls outside with a probability of at most 2k / (n + 1), whatever the law: 0.065 for
    n = 30, at most 0.05 from n = 39. An undefined value (-inf here) ranks below all numbers.

    Raises
    ------
    ValueError : fewer than 20 worlds

    Source: Wilks, Annals of Mathematical Statistics 12 (1941) 91.
    """
    _enough(sample)
    ranked = np.sort(np.where(np.isnan(sample), -np.inf, sample))
    k = max(1, math.floor(LEVEL / 2 * (len(ranked) + 1)))
    return float(ranked[k - 1]), float(ranked[-k])


def one_world(sample: np.ndarray, printed: Printed) -> bool:
    """Whether the printed value could be one further world of ours, see `world_interval`.

    A printed dash is an undefined value. Errs, that is refutes what is right, with a probability
    of at most 2k / (n + 1).
    """
    low, high = world_interval(sample)
    if printed.value is None:
        return low == -math.inf
    return printed.allows(low, high)


def five_worlds(
    sample: np.ndarray, printed: Printed, statistic: str, *, rng: np.random.Generator
) -> bool:
    """Whether a printed "mean" or "std" could be that of five further worlds.

    Splits our n worlds at random into five and the rest, and takes the difference of the two
    means (or the ratio of the two standard deviations). The printed value, against all of our
    worlds, must lie in the central 98 % of that law. Neither normality nor our own mean is taken
    for granted. For n = 30 it errs in 3 % of cases for a normal law and up to 7 % for a
    log-normal one (a test measures it); a wider law of the splits is what skewness costs.

    Raises
    ------
    ValueError : fewer than 20 worlds, or an undefined value
    """
    _enough(sample)
    if np.isnan(sample).any():
        raise ValueError("a mean of five worlds needs a defined value in every world")
    order = rng.permuted(np.tile(sample, (SPLITS, 1)), axis=1)
    five, rest = order[:, :PRINTED_WORLDS], order[:, PRINTED_WORLDS:]
    if statistic == "mean":
        low, high = np.quantile(five.mean(axis=1) - rest.mean(axis=1), SPLIT_TAILS)
        return printed.allows(sample.mean() + low, sample.mean() + high)
    ratios = five.std(axis=1, ddof=1) / rest.std(axis=1, ddof=1)
    low, high = np.quantile(ratios, SPLIT_TAILS)
    spread = sample.std(ddof=1)
    return printed.allows(spread * low, spread * high)


def trend(first: np.ndarray, last: np.ndarray, direction: str) -> bool:
    """Whether the mean "rises" or "falls" from the first level of a series to the last.

    By more than about two standard errors: a one-sided paired t test at 2.5 % over the worlds
    defined at both, which is how often it sees a trend where there is none.
    """
    change = (last - first) if direction == "rises" else (first - last)
    change = change[np.isfinite(change)]
    if len(change) < 2:
        return False
    error = change.std(ddof=1) / math.sqrt(len(change))
    return bool(change.mean() > stats.t.ppf(1 - LEVEL / 2, len(change) - 1) * error)


def hardware(ours: float, printed: Printed) -> str:
    """Verdict on a ratio of two wall clocks of one machine, which another machine may repeat.

    Reproduced within a factor of 2 of what the rounding of the printed seconds allows: compiled
    and interpreted code do not speed up alike. Within 10, the order of magnitude, the trend is.
    No law is known of, so no error probability can be given.
    """
    for factor, verdict in ((SAME_RATIO, REPRODUCED), (SAME_ORDER, TREND)):
        if printed.allows(ours / factor, ours * factor):
            return verdict
    return NOT


def share_interval(holds: np.ndarray) -> tuple[float, float]:
    """Clopper-Pearson 95 % interval of the share of worlds in which a claim holds, (n,) bool."""
    limits = stats.binomtest(int(np.sum(holds)), len(holds)).proportion_ci(1 - LEVEL, "exact")
    return float(limits.low), float(limits.high)


def share(holds: np.ndarray, threshold: float) -> str:
    """Verdict on a claim that holds in some of our worlds, (n,) bool.

    Reproduced if the lower limit of `share_interval` reaches the threshold; the trend is if that
    limit exceeds one half, so that the claim holds in most worlds. Either errs, that is credits
    a claim whose true share is less, with a probability of at most 2.5 %.
    """
    if not len(holds):
        return NOT
    low, _ = share_interval(holds)
    if low >= threshold:
        return REPRODUCED
    return TREND if low > 0.5 else NOT


def _enough(sample: np.ndarray) -> None:
    if len(sample) < MIN_WORLDS:
        raise ValueError(f"{len(sample)} worlds: a verdict needs at least {MIN_WORLDS}")
