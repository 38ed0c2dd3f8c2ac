"""Batch estimates of the same graph under robust losses: what SNGR is to be compared with.

Each world holds one set of odometry and ranges; `estimate` gives every method exactly these.
The range factors carry the loss, for they alone can be attached to a wrong landmark; the x0
prior, the odometry and the weak landmark priors stay quadratic. Tuning constants are those of
the literature for residuals of unit variance, never fitted to these worlds.
"""

from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from scipy import stats

from sngr_utils.robust.graduated_non_convexity import (
    CAUCHY_K,
    DCS_PHI,
    GEMAN_MCCLURE_C,
    HUBER_K,
    INLIER_QUANTILE,
    graduated,
    reweighted,
)
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import sure_factors
from sngr_utils.slam.landmark_starts import STARTS, start_landmarks
from sngr_utils.slam.levenberg_marquardt import levenberg_marquardt
from sngr_utils.slam.solution import Solution, values_of
from sngr_utils.world import dead_reckoning, simulation

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

GNC_SQUARED = stats.chi2.ppf(INLIER_QUANTILE, 1)  # threshold on r^2, and Geman and McClure's c^2

Estimate = tuple[np.ndarray, np.ndarray]  # poses (T, 3) and landmarks (K, 2)


def estimate(
    the_world: simulation.World, conventions: Conventions, method: str, start: str
) -> Estimate:
    """Batch Levenberg-Marquardt estimate of a world from dead-reckoned poses.

    The x0 prior is centred on `World.x0_mean`, as in `isam2.run_isam2`.

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
        the_world = replace(the_world, label_of=the_world.source_of)
    poses = dead_reckoning.dead_reckoning(the_world.x0_mean, the_world.odometry)
    landmarks = start_landmarks(the_world.log(conventions.x0_sigmas), poses, start)
    solution = solve(the_world, conventions, method, (poses, landmarks))
    return solution.poses, solution.landmarks


def solve(
    the_world: simulation.World, conventions: Conventions, method: str, start: Estimate
) -> Solution:
    """The solution under the loss of `method` from poses and landmarks to start from.

    The ranges of its graph have the noise model that the loss gives them at the estimate, so
    that its marginals are the inverse of the reweighted Gauss-Newton information.
    """
    sure = sure_factors(the_world, conventions, start[1])
    factors, values = gtsam.NonlinearFactorGraph(sure), values_of(*start)
    factors.push_back(range_factors(the_world, start[1], method))
    if method in ("gnc_tls", "gnc_gm"):
        result, weights = graduated(factors, values, method, known_inliers=range(sure.size()))
        factors = reweighted(factors, weights)
    else:
        result = levenberg_marquardt(factors, values)
    return Solution(None, factors, result, the_world.n_poses, the_world.n_landmarks)


def range_factors(
    the_world: simulation.World, landmarks: np.ndarray, method: str
) -> gtsam.NonlinearFactorGraph:
    """The ranges, by label, under the loss of `method`; those to a NaN landmark are left out."""
    estimators = gtsam.noiseModel.mEstimator
    losses = {
        "huber": lambda: estimators.Huber.Create(HUBER_K),
        "cauchy": lambda: estimators.Cauchy.Create(CAUCHY_K),
        "dcs": lambda: estimators.DCS.Create(DCS_PHI),
        "geman_mcclure": lambda: estimators.GemanMcClure.Create(GEMAN_MCCLURE_C),
    }
    noise = gtsam.noiseModel.Isotropic.Sigma(1, the_world.scenario.range_sigma)
    if method in losses:
        noise = gtsam.noiseModel.Robust.Create(losses[method](), noise)
    factors = gtsam.NonlinearFactorGraph()
    measured = zip(the_world.pose_of, the_world.label_of, the_world.ranges, strict=True)
    for t, k, distance in measured:
        if np.isfinite(landmarks[k, 0]):
            factors.push_back(gtsam.RangeFactor2D(X(t), L(k), distance, noise))
    return factors
