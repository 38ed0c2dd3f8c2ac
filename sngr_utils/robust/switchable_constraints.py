"""Switchable constraints: every range has a switch, a variable that says how far it is believed.

The switch s multiplies the whitened residual r of its range, and a prior holds it at 1: a range
that would pull the trajectory apart is turned off at a bounded cost. Whatever the residuals, the
best switches are known in closed form, s = 1 / (1 + sigma^2 r^2); what they leave is Geman and
McClure's loss with c = 1 / sigma, which is solved.
"""

import numpy as np
from scipy import integrate, optimize

from sngr_utils.robust.losses import Estimate
from sngr_utils.slam import chain_problem, chain_solver
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.range_loss import GEMAN_MCCLURE, LEAST_SQUARES, Loss
from sngr_utils.world.log import Log


def _efficiency(c: float) -> float:
    """Asymptotic efficiency on Gaussian data of Geman and McClure's loss with the constant c.

    (E psi')^2 / E psi^2 of its influence psi. Source: Huber, Robust Statistics, 1981, ch. 4.
    """

    def weighted(r, function):  # the density written out, for speed: this runs at import
        return function((r / c) ** 2, r) * (np.exp(-r * r / 2) / np.sqrt(2 * np.pi))

    def mean(function):
        return integrate.quad(weighted, -9, 9, (function,))[0]

    slope = mean(lambda q, _: (1 - 3 * q) / (1 + q) ** 3)
    return slope**2 / mean(lambda q, r: r**2 / (1 + q) ** 4)


# Sigma of the switch prior. The authors' sigma is 1: that is the row "geman_mcclure" of the
# peers, and throws away half of what good ranges say. This one is 95 % efficient on Gaussian
# data, as the constants of Huber's and Cauchy's losses are.
SWITCH_SIGMA = 1 / optimize.brentq(lambda c: _efficiency(c) - 0.95, 1, 10)


def solve(
    log: Log, conventions: Conventions, start: Estimate, switch_sigma: float = SWITCH_SIGMA
) -> tuple[chain_solver.Estimate, np.ndarray]:
    """Solve for poses and landmarks with a switch for every range.

    The switch function is the identity, which the authors prefer to a sigmoid: at the optimum
    s is between 0 and 1 without being told to.

    Parameters
    ----------
    start : (T, 3) poses [m, m, rad] and (K, 2) landmarks [m]; ranges to a NaN landmark are
        left out
    switch_sigma : of the prior on a switch, without unit

    Returns
    -------
    the estimate, its covariances over the switches, and the (M,) switches

    Raises
    ------
    ValueError : switch_sigma is not positive

    Source: Suenderhauf & Protzel, Switchable constraints for robust pose graph SLAM, IROS 2012.
    """
    if not switch_sigma > 0:
        raise ValueError(f"switch_sigma is {switch_sigma!r}: it must be positive")
    chain = chain_problem.of_log(log, start[1], conventions.landmark_prior_sigma)
    at, *found = chain_solver.minimise(
        chain, Loss(GEMAN_MCCLURE, 1 / switch_sigma), chain_solver.THOROUGH,
        chain_solver.state_of(chain, *start),
    )  # fmt: skip
    switches = 1 / (1 + (switch_sigma * at.residuals / chain.sigmas) ** 2)
    # of a range whose switch is integrated out, so much is left: s^2, less what s is not known
    known = chain._replace(weights=switches**3)
    return chain_solver.concluded(known, LEAST_SQUARES, at, *found), switches
