"""The Student t against SciPy's."""

import numpy as np
from scipy import stats

from sngr_utils.numerics.student_t import DEGREES, log_fall, log_height, student_t


def test_density_is_that_of_scipy():
    points = np.random.default_rng(0).normal(size=(50, 4)) * 3
    exact = stats.multivariate_t(np.zeros(4), np.eye(4), DEGREES).logpdf(points)
    ours = log_height(4) + log_fall(np.sum(points**2, axis=1), 4)
    assert np.allclose(ours, exact, rtol=1e-13)


def test_draws_follow_the_density():
    """Squared distance over d is F(d, 10): Kolmogorov-Smirnov. Failure probability 1e-5."""
    draws = student_t(4000, 3, rng=np.random.default_rng(0))
    law = stats.f(3, DEGREES).cdf
    assert stats.kstest(np.sum(draws**2, axis=1) / 3, law).pvalue > 1e-5
