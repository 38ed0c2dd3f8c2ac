"""How a verdict follows from a printed value and ours. Pure functions; nothing is judged by hand.

A printed number that is the outcome of one or five worlds counts as reproduced if our worlds could
have refuted it and do not; a claim in prose counts as reproduced only if our worlds support it.
Each rule says how often it errs. `prediction` has the rules for samples.
"""

import math

import numpy as np
from scipy import stats

from sngr_utils.publish.prediction import LEVEL
from sngr_utils.publish.printed import Printed

REPRODUCED = "reproduced"
TREND = "trend reproduced"
NOT = "not reproduced"
UNTESTABLE = "untestable"
CANNOT = "cannot hold"
FOLLOWS = "follows"
NO_RATIO = "not comparable"
VERDICTS = (REPRODUCED, TREND, NOT, UNTESTABLE, CANNOT, FOLLOWS, NO_RATIO)

MAX_SHARE = 0.15  # of its natural range that a test may accept: more, and it is none
SAME_RATIO, SAME_ORDER = 2.0, 10.0  # factors within which two ratios of wall clocks agree


def deterministic(ours: float, printed: Printed) -> bool:
    """Whether our value rounds to the printed one. Never errs: nothing is random."""
    return printed.value is None if math.isnan(ours) else printed.allows(ours)


def trend(first: np.ndarray, last: np.ndarray, direction: str) -> bool:
    """Whether most worlds "rise" or "fall" from the first level of a series to the last.

    A one-sided sign test at 2.5 % over the worlds defined at both and not equal there, which is
    at most how often it sees a trend where there is none, however skewed the changes are.
    """
    change = (last - first) if direction == "rises" else (first - last)
    change = change[np.isfinite(change) & (change != 0)]
    if not len(change):
        return False
    up = int(np.sum(change > 0))
    return bool(stats.binomtest(up, len(change), alternative="greater").pvalue <= LEVEL / 2)


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
