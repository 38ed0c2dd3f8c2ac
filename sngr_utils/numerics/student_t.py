"""The multivariate Student t with the degrees of freedom of every proposal here."""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once

DEGREES = 10.0  # of freedom


def student_t(n: int, d: int, *, rng: np.random.Generator) -> np.ndarray:
    """(n, d) standard draws"""
    noise = rng.standard_normal((n, d))
    return noise / np.sqrt(rng.chisquare(DEGREES, (n, 1)) / DEGREES)


@compile_once
def log_height(d):
    """Log of the largest density of the standard law in d dimensions, [nats]."""
    gammas = math.lgamma(0.5 * (DEGREES + d)) - math.lgamma(0.5 * DEGREES)
    return gammas - 0.5 * d * math.log(DEGREES * math.pi)


@compile_once
def log_fall(distance, d):
    """Log density at a squared Mahalanobis distance, less that at the mode, [nats]."""
    return -0.5 * (DEGREES + d) * np.log1p(distance / DEGREES)
