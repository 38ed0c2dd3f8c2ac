"""Batch estimates under robust losses: what SNGR is to be compared with.

A log holds one set of odometry and ranges; every method is given exactly these. The ranges carry
the loss, for they alone can be attached to a wrong landmark; the x0 prior, the odometry and the
weak landmark priors stay quadratic. Tuning constants are those of the literature for residuals
of unit variance, never fitted to these worlds.
"""

from dataclasses import replace

import numpy as np
from scipy import stats

from sngr_utils.slam import chain_problem, chain_solver, graduated
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.landmark_starts import STARTS, start_landmarks
from sngr_utils.slam.range_loss import (
    CAUCHY,
    DCS,
    GEMAN_MCCLURE,
    HUBER,
    LEAST_SQUARES,
    Loss,
)
from sngr_utils.world import dead_reckoning, simulation
from sngr_utils.world.log import Log

# rho(r) of a whitened range residual r, and where its constant comes from
METHODS = {
    "least_squares": "r^2 / 2, the loss of iSAM2",
    "huber": "k = 1.345, 95 % efficient on Gaussian data (Huber 1964; Holland & Welsch 1977)",
    "cauchy": "k = 2.3849, 95 % efficient on Gaussian data (Holland & Welsch 1977)",
    "dcs": "Phi = 1 (Agarwal et al., Dynamic covariance scaling, ICRA 2013)",
    "geman_mcclure": "c = 1 (Geman & McClure 1985; Zhang 1997)",
    "gnc_tls": "truncated at the 99 % quantile of chi-square, 1 degree of freedom, reached by "
    "graduated non-convexity (Yang et al., RA-L 2020)",
    "gnc_gm": "Geman-McClure with c^2 at that quantile, reached likewise (Yang et al., RA-L 2020)",
    "oracle": "r^2 / 2 with every range attached to the landmark it came from",
}
LOSSES = {
    "least_squares": LEAST_SQUARES,
    "huber": Loss(HUBER, 1.345),
    "cauchy": Loss(CAUCHY, 2.3849),
    "dcs": Loss(DCS, 1.0),
    "geman_mcclure": Loss(GEMAN_MCCLURE, 1.0),
}
GNC_SQUARED = stats.chi2.ppf(0.99, 1)  # threshold on r^2, and Geman and McClure's c^2

Estimate = tuple[np.ndarray, np.ndarray]  # poses (T, 3) and landmarks (K, 2)


def estimate(
    the_world: simulation.World, conventions: Conventions, method: str, start: str
) -> Estimate:
    """Batch estimate of a world from dead-reckoned poses, by its log; the oracle's by its truth.

    Parameters
    ----------
    method : one of `METHODS`
    start : one of `STARTS`, where each landmark starts and its weak prior is centred

    Returns
    -------
    poses : (T, 3), [m, m, rad]
    landmarks : (K, 2), [m]; NaN for a landmark that fewer than three distinct poses saw

    Raises
    ------
    ValueError : unknown method or start
    """
    if method not in METHODS:
        raise ValueError(f"method is {method!r}: it must be one of {sorted(METHODS)}")
    if start not in STARTS:
        raise ValueError(f"start is {start!r}: it must be one of {sorted(STARTS)}")
    if method == "oracle":
        the_world, method = replace(the_world, label_of=the_world.source_of), "least_squares"
    log = the_world.log(conventions.x0_sigmas)
    poses = dead_reckoning.dead_reckoning(log.x0_mean, log.odometry)
    found = solve(log, conventions, method, (poses, start_landmarks(log, poses, start)))
    return found.poses, found.landmarks


def solve(
    log: Log, conventions: Conventions, method: str, start: Estimate
) -> chain_solver.Estimate:
    """The estimate under the loss of `method` from poses and landmarks to start from.

    Its covariance is the inverse of the reweighted Gauss-Newton information.

    Parameters
    ----------
    method : one of `LOSSES`, "gnc_tls" or "gnc_gm"
    """
    chain = chain_problem.of_log(log, start[1], conventions.landmark_prior_sigma)
    if method in LOSSES:
        return chain_solver.solve(chain, *start, LOSSES[method], chain_solver.THOROUGH)
    return graduated.solve(chain, *start, method == "gnc_tls", GNC_SQUARED)[0]
