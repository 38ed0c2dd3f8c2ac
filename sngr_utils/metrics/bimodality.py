"""The bimodality coefficient."""

import numpy as np


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
