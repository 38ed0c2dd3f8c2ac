"""Gradients and Hessians by finite differences."""

from collections.abc import Callable
from functools import cache

import numpy as np

STEP = 1e-2  # of the differences, in standard deviations of the prior or of the last Gaussian


def derivatives(
    function: Callable[[np.ndarray], np.ndarray], at: np.ndarray, steps: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray]:
    """Value, gradient and minus the Hessian of a function at a point.

    Central differences of one step and of two, extrapolated: the error is of fourth order.

    Parameters
    ----------
    function : of (N, d) points, returns (N,) values
    steps : (d, d), in its columns the steps; the derivatives are per step
    """
    d, (directions, first, second) = len(at), _stencil(len(at))
    slopes, hessians = [], []
    for length in (1, 2):
        f = function(at + length * directions @ steps.T)
        up, down = f[1 : d + 1], f[d + 1 : 2 * d + 1]
        both = f[2 * d + 1 :].reshape(2, -1).sum(axis=0)
        own = (up + down - 2 * f[0]) / length**2
        mixed = 0.5 * ((both - 2 * f[0]) / length**2 - own[first] - own[second])
        hessian = np.diag(own)
        hessian[first, second] = hessian[second, first] = mixed
        slopes.append((up - down) / (2 * length))
        hessians.append(hessian)
    slope, hessian = ((4 * one - two) / 3 for one, two in (slopes, hessians))
    return float(f[0]), slope, -hessian


@cache
def _stencil(d: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, d) directions of the differences, in units of a step, and the d (d - 1) / 2 pairs."""
    eye, (first, second) = np.eye(d), np.triu_indices(d, 1)
    pairs = eye[first] + eye[second]
    directions = np.concatenate([np.zeros((1, d)), eye, -eye, pairs, -pairs])
    return directions, first, second
