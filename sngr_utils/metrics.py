"""What is measured about an estimate. Pure functions of arrays."""

from dataclasses import dataclass

import numpy as np


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
    def base_rate(self) -> float:
        """Share of all cases that are true: the precision of firing at random among them."""
        return self.failed / self.total if self.total else float("nan")


def detection(fired: np.ndarray, failed: np.ndarray) -> Detection:
    """Count (N,) boolean decisions against (N,) boolean truths."""
    fired, failed = np.asarray(fired, dtype=bool), np.asarray(failed, dtype=bool)
    counts = [fired & failed, fired & ~failed, ~fired & failed, ~fired & ~failed]
    return Detection(*(int(np.count_nonzero(c)) for c in counts))


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
