"""The prior transform: from the unit cube to a Gaussian."""

from collections.abc import Callable

import numpy as np
from scipy.special import ndtri


def prior_transform(covariance: np.ndarray, scale: float) -> Callable[[np.ndarray], np.ndarray]:
    """Map from the unit cube to N(0, scale * covariance), by probit (paper eq. "prior").

    Parameters
    ----------
    covariance : (d, d) positive definite
    scale : c in the paper

    Raises
    ------
    numpy.linalg.LinAlgError : covariance not positive definite
    """
    cholesky = np.linalg.cholesky(scale * covariance)
    return lambda unit: cholesky @ ndtri(unit)
