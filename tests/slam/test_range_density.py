"""The two-component density of a range, against SciPy's."""

import numpy as np
import pytest
from scipy import stats

from sngr_utils.slam import range_density

VARIANCE, WRONG, LONGEST = np.array([0.01, 0.3]), np.array([0.2, 0.5]), 8.0


def test_the_density_is_a_gaussian_and_a_uniform_one():
    errors = np.array([0.05, -1.2])
    right = stats.norm.pdf(errors, 0, np.sqrt(VARIANCE))
    found = range_density.density(errors**2 / VARIANCE, VARIANCE, WRONG, LONGEST)
    assert found == pytest.approx((1 - WRONG) * right + WRONG / LONGEST, rel=1e-14)


@pytest.mark.parametrize("squared", [0.0, 0.7, 90.0, 4e4])
def test_the_loss_is_what_the_density_falls_by(squared):
    for variance, wrong in zip(VARIANCE, WRONG, strict=True):
        given = variance, wrong, LONGEST
        fall = range_density.density(0.0, *given) / range_density.density(squared, *given)
        found = range_density.loss(squared, range_density.floor(*given))
        assert found == pytest.approx(np.log(fall), abs=1e-13)
