"""What is measured about an estimate. Pure functions of arrays."""

import math
from dataclasses import dataclass

import numpy as np
from sklearn import metrics as sklearn_metrics


def rmse(estimate: np.ndarray, truth: np.ndarray) -> float:
    """Root mean square distance between two (N, 2) sets of positions, [m].

    Rows that are NaN in `estimate` (landmarks that were never started) are left out; NaN if
    nothing is left. No alignment: the first pose's prior fixes the frame.
    """
    squared = np.sum((np.asarray(estimate) - np.asarray(truth)) ** 2, axis=1)
    squared = squared[np.isfinite(squared)]
    return float(np.sqrt(squared.mean())) if len(squared) else float("nan")


def nees(errors: np.ndarray, covariances: np.ndarray) -> float:
    """Normalised estimation error squared, e^T P^-1 e, averaged over N poses.

    Its expectation is the dimension (2 for positions) if the errors follow the covariances.

    Parameters
    ----------
    errors : (N, d), [m]
    covariances : (N, d, d), [m^2]

    Source: Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and
    Navigation, section 5.4.
    """
    solved = np.linalg.solve(covariances, errors[:, :, None])[:, :, 0]
    return float(np.mean(np.sum(errors * solved, axis=1)))


@dataclass(frozen=True)
class Detection:
    """Counts of a detector against the truth, over all windows."""

    true_positives: int
    false_positives: int
    false_negatives: int
    true_negatives: int

    @property
    def triggered(self) -> int:
        return self.true_positives + self.false_positives

    @property
    def failed(self) -> int:
        return self.true_positives + self.false_negatives

    @property
    def total(self) -> int:
        return self.triggered + self.false_negatives + self.true_negatives

    @property
    def precision(self) -> float:
        """Share of the fired windows that failed; NaN if none fired."""
        return self.true_positives / self.triggered if self.triggered else float("nan")

    @property
    def recall(self) -> float:
        """Share of the failed windows that fired; NaN if none failed."""
        return self.true_positives / self.failed if self.failed else float("nan")

    @property
    def matthews(self) -> float:
        """Matthews correlation coefficient, in [-1, 1]; 0 for firing at random.

        The correlation of the two indicators "fired" and "failed"; unlike precision it does
        not grow with the base rate. NaN if one of them is constant.

        Source: Matthews, Biochimica et Biophysica Acta 405, 1975.
        """
        silent, sound = self.total - self.triggered, self.total - self.failed
        product = self.triggered * self.failed * silent * sound
        agreement = self.true_positives * self.true_negatives
        disagreement = self.false_positives * self.false_negatives
        return (agreement - disagreement) / math.sqrt(product) if product else float("nan")

    @property
    def base_rate(self) -> float:
        """Share of all cases that are true: the precision of firing at random among them."""
        return self.failed / self.total if self.total else float("nan")


def detection(fired: np.ndarray, failed: np.ndarray) -> Detection:
    """Count (N,) boolean decisions against (N,) boolean truths."""
    fired, failed = np.asarray(fired, dtype=bool), np.asarray(failed, dtype=bool)
    counts = [fired & failed, fired & ~failed, ~fired & failed, ~fired & ~failed]
    return Detection(*(int(np.count_nonzero(c)) for c in counts))


def roc_auc(scores: np.ndarray, truth: np.ndarray) -> float:
    """Area under the ROC curve: the chance that a true case scores above a false one.

    One half for scores that know nothing, whatever the base rate. NaN if a class is empty.

    Parameters
    ----------
    scores : (N,) higher means more likely true
    truth : (N,) bool
    """
    return float(sklearn_metrics.roc_auc_score(truth, scores)) if _mixed(truth) else float("nan")


def average_precision(scores: np.ndarray, truth: np.ndarray) -> float:
    """Area under the precision-recall curve, as a step function; NaN if a class is empty.

    Scores that know nothing have the base rate: to be read beside it. Arguments as `roc_auc`.
    """
    if not _mixed(truth):
        return float("nan")
    return float(sklearn_metrics.average_precision_score(truth, scores))


def roc_curve(scores: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """False and true positive rates, each (P,), as the threshold falls. Arguments as `roc_auc`.

    Raises
    ------
    ValueError : a class is empty
    """
    _require_mixed(truth)
    false_rate, true_rate, _ = sklearn_metrics.roc_curve(truth, scores)
    return false_rate, true_rate


def precision_recall_curve(scores: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Recall and precision, each (P,), as the threshold rises. Arguments as `roc_auc`.

    Raises
    ------
    ValueError : a class is empty
    """
    _require_mixed(truth)
    precision, recall, _ = sklearn_metrics.precision_recall_curve(truth, scores)
    return recall, precision


def within_auc(
    scores: np.ndarray, truth: np.ndarray, worlds: np.ndarray, *, rng: np.random.Generator
) -> tuple[float, tuple[float, float], int]:
    """AUC from pairs of cases of the same world only, its 95 % interval, and worlds that count.

    A pooled AUC also compares cases of different worlds, whose scores may differ in level; this
    one asks whether a score ranks the cases of one world. Worlds where all cases are alike have
    no pair. The interval draws whole worlds; NaN below five of them, which say too little.

    Parameters
    ----------
    scores : (N,) higher means more likely true
    truth : (N,) bool
    worlds : (N,) which world each case is of, e.g. its seed

    Source: Field & Welsh, Bootstrapping clustered data, JRSS B 69, 2007.
    """
    won, pairs = [], []
    for name in np.unique(worlds):
        here = np.asarray(worlds) == name
        positive, negative = scores[here & truth], scores[here & ~truth]
        if len(positive) and len(negative):
            gap = positive[:, None] - negative
            won.append(float(np.sum((gap > 0) + 0.5 * (gap == 0))))
            pairs.append(gap.size)
    n = len(pairs)
    if n == 0:
        return float("nan"), (float("nan"), float("nan")), 0
    won, pairs = np.array(won), np.array(pairs)
    if n < 5:
        return float(won.sum() / pairs.sum()), (float("nan"), float("nan")), n
    drawn = rng.multinomial(n, np.full(n, 1 / n), size=2000)
    low, high = np.quantile((drawn @ won) / (drawn @ pairs), [0.025, 0.975])
    return float(won.sum() / pairs.sum()), (float(low), float(high)), n


def _mixed(truth: np.ndarray) -> bool:
    """Are there both true and false cases?"""
    return len(np.unique(np.asarray(truth, dtype=bool))) == 2


def _require_mixed(truth: np.ndarray) -> None:
    if not _mixed(truth):
        raise ValueError("truth holds one class only: a curve needs true and false cases")


def bimodality_coefficient(samples: np.ndarray, weights: np.ndarray) -> float:
    """(skewness^2 + 1) / kurtosis of weighted samples; the uniform law has 5/9.

    Lies in (0, 1]; 1 for any two spikes, whatever their masses, 1/3 for a Gaussian.

    Parameters
    ----------
    samples : (N,)
    weights : (N,) non-negative, of any sum

    Source: SAS/STAT user's guide, the CLUSTER procedure (without the small-sample term).
    """
    weights = weights / weights.sum()
    centred = samples - np.sum(weights * samples)
    second, third, fourth = (np.sum(weights * centred**k) for k in (2, 3, 4))
    return float((third**2 / second**3 + 1) / (fourth / second**2))


def effective_sample_size(weights: np.ndarray) -> float:
    """Kish's effective sample size (sum w)^2 / sum w^2 of N weights of any sum, from 1 to N.

    Source: Kish, Survey Sampling, 1965.
    """
    return float(np.sum(weights) ** 2 / np.sum(np.square(weights)))
