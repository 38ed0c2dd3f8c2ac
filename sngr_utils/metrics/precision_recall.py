"""A detector against the truth: precision, recall, ROC and its area.

Curves and areas are scikit-learn's, which is imported where they are asked for: counts need none
of it, and it takes a second.
"""

import math
from dataclasses import dataclass

import numpy as np


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
        return self.true_positives / self.triggered if self.triggered else math.nan

    @property
    def recall(self) -> float:
        """Share of the failed windows that fired; NaN if none failed."""
        return self.true_positives / self.failed if self.failed else math.nan

    @property
    def matthews(self) -> float:
        """Matthews correlation coefficient, in [-1, 1]; 0 for firing at random.

        The correlation of the two indicators "fired" and "failed"; unlike precision it does
        not grow with the base rate. NaN if one of them is constant.

        Source: Matthews, Biochimica et Biophysica Acta 405, 1975.
        """
        above, below = matthews_parts(
            self.true_positives, self.false_positives, self.false_negatives, self.true_negatives
        )
        return float(above / below) if below else math.nan

    @property
    def base_rate(self) -> float:
        """Share of all cases that are true: the precision of firing at random among them."""
        return self.failed / self.total if self.total else math.nan


def matthews_parts(tp, fp, fn, tn) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator of `Detection.matthews`, of counts or arrays of counts."""
    product = (tp + fp) * (tp + fn) * (tn + fp) * (tn + fn)
    return tp * tn - fp * fn, np.sqrt(product)


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
    if not _mixed(truth):
        return math.nan
    from sklearn import metrics

    return float(metrics.roc_auc_score(truth, scores))


def average_precision(scores: np.ndarray, truth: np.ndarray) -> float:
    """Area under the precision-recall curve, as a step function; NaN if a class is empty.

    Scores that know nothing have the base rate: to be read beside it. Arguments as `roc_auc`.
    """
    if not _mixed(truth):
        return math.nan
    from sklearn import metrics

    return float(metrics.average_precision_score(truth, scores))


def roc_curve(scores: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """False and true positive rates, each (P,), as the threshold falls. Arguments as `roc_auc`.

    Raises
    ------
    ValueError : a class is empty
    """
    _require_mixed(truth)
    from sklearn import metrics

    false_rate, true_rate, _ = metrics.roc_curve(truth, scores)
    return false_rate, true_rate


def precision_recall_curve(scores: np.ndarray, truth: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Recall and precision, each (P,), as the threshold rises. Arguments as `roc_auc`.

    Raises
    ------
    ValueError : a class is empty
    """
    _require_mixed(truth)
    from sklearn import metrics

    precision, recall, _ = metrics.precision_recall_curve(truth, scores)
    return recall, precision


def _mixed(truth: np.ndarray) -> bool:
    """Are there both true and false cases?"""
    return len(np.unique(np.asarray(truth, dtype=bool))) == 2


def _require_mixed(truth: np.ndarray) -> None:
    if not _mixed(truth):
        raise ValueError("truth holds one class only: a curve needs true and false cases")
