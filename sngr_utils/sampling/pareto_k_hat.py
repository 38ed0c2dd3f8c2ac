"""Pareto k-hat: how heavy the tail of importance weights is."""

import math

import numpy as np


def pareto_k_hat(weights: np.ndarray) -> float:
    """Shape of a generalised Pareto law fitted to the largest of N weights; -inf if all equal.

    Source: Zhang & Stephens, Technometrics 51 (2009) 316; tail length and shrinkage towards
    one half as in Vehtari et al., JMLR 25 (2024).
    """
    n = len(weights)
    size = int(min(0.2 * n, 3 * math.sqrt(n)))
    tail = np.sort(np.partition(weights, n - size - 1)[n - size - 1 :])
    excess = tail[1:] - tail[0]
    if excess[-1] <= 1e-12 * tail[-1]:
        return -math.inf
    n_grid = 30 + int(math.sqrt(size))
    grid = 1 - np.sqrt(n_grid / (np.arange(n_grid) + 0.5))
    theta = grid / (3 * excess[(size + 2) // 4 - 1]) + 1 / excess[-1]
    k = np.log1p(-theta[:, None] * excess).mean(axis=1)
    log_profile = size * (np.log(-theta / k) - k - 1)
    posterior = np.exp(log_profile - np.logaddexp.reduce(log_profile))
    k_hat = np.log1p(-(theta @ posterior) * excess).mean()
    return float((size * k_hat + 10 * 0.5) / (size + 10))
