"""The effective sample size of weights."""

import numpy as np


def effective_sample_size(weights: np.ndarray) -> float:
    """Kish's effective sample size (sum w)^2 / sum w^2 of N weights of any sum, from 1 to N.

    Source: Kish, Survey Sampling, 1965.
    """
    return float(np.sum(weights) ** 2 / np.sum(np.square(weights)))
