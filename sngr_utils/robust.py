"""Batch estimates of the same graph under robust losses: what SNGR is to be compared with.

Each world holds one set of odometry and ranges; `estimate` gives every method exactly these.
The range factors carry the loss, for they alone can be attached to a wrong landmark; the x0
prior, the odometry and the weak landmark priors stay quadratic. Tuning constants are those of
the literature for residuals of unit variance, never fitted to these worlds.
"""

import math
from dataclasses import replace

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X
from scipy import stats

from sngr_utils import graph
from sngr_utils.numerics.jit import compile_once
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
STARTS = {
    "first_poses": "least squares on the ranges of a landmark's first three dead-reckoned poses",
    "grid": "the best cell of a grid, by all ranges of a landmark, any of which may be wrong",
}
HUBER_K, CAUCHY_K, DCS_PHI, GEMAN_MCCLURE_C, INLIER_QUANTILE = 1.345, 2.3849, 1.0, 1.0, 0.99
GNC_SQUARED = stats.chi2.ppf(INLIER_QUANTILE, 1)  # threshold on r^2, and Geman and McClure's c^2

Estimate = tuple[np.ndarray, np.ndarray]  # poses (T, 3) and landmarks (K, 2)

GRID_CELLS = 100  # per axis
NEGLIGIBLE_EXPONENT = 40.0  # e^-40 is nothing beside an outlier, in floating point
GRID_OUTLIER_SHARE = 0.5  # knowing nothing about a range: right or wrong alike


def estimate(
    the_world: simulation.World, conventions: graph.Conventions, method: str, start: str
) -> Estimate:
    """Batch Levenberg-Marquardt estimate of a world from dead-reckoned poses.

    The x0 prior is centred on `World.x0_mean`, as in `graph.run_isam2`.

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
    landmarks = start_landmarks(the_world, poses, start)
    solution = solve(the_world, conventions, method, (poses, landmarks))
    return solution.poses, solution.landmarks


def solve(
    the_world: simulation.World, conventions: graph.Conventions, method: str, start: Estimate
) -> graph.Solution:
    """The solution under the loss of `method` from poses and landmarks to start from.

    The ranges of its graph have the noise model that the loss gives them at the estimate, so
    that its marginals are the inverse of the reweighted Gauss-Newton information.
    """
    sure = sure_factors(the_world, conventions, start[1])
    factors, values = gtsam.NonlinearFactorGraph(sure), values_of(*start)
    factors.push_back(range_factors(the_world, start[1], method))
    if method in ("gnc_tls", "gnc_gm"):
        result, weights = _graduated(factors, values, method, known_inliers=range(sure.size()))
        factors = reweighted(factors, weights)
    else:
        result = levenberg_marquardt(factors, values)
    return graph.Solution(None, factors, result, the_world.n_poses, the_world.n_landmarks)


def levenberg_marquardt(factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Values:
    """Optimise to convergence; robust losses are reweighted, which is slow."""
    # GTSAM's own defaults let lambda underflow to 0, which no factor raises again: a hang
    params = gtsam.LevenbergMarquardtParams.CeresDefaults()
    params.setMaxIterations(500)
    params.setRelativeErrorTol(1e-10)
    params.setAbsoluteErrorTol(1e-10)
    return gtsam.LevenbergMarquardtOptimizer(factors, values, params).optimize()


def sure_factors(
    the_world: simulation.World, conventions: graph.Conventions, landmarks: np.ndarray
) -> gtsam.NonlinearFactorGraph:
    """The factors that cannot be outliers: x0 prior, odometry, weak landmark priors.

    The last are centred on the (K, 2) `landmarks`, [m]; there is none where that is NaN.
    """
    factors = gtsam.NonlinearFactorGraph()
    factors.push_back(graph.pose_prior(the_world.x0_mean, conventions.x0_sigmas))
    for t, motion in enumerate(the_world.odometry):
        factors.push_back(graph.odometry_factor(t, motion, the_world.scenario))
    for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
        sigma = conventions.landmark_prior_sigma
        factors.push_back(graph.landmark_prior(k, landmarks[k], sigma))
    return factors


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


def start_landmarks(the_world: simulation.World, poses: np.ndarray, start: str) -> np.ndarray:
    """(K, 2) start of each landmark, [m]; NaN if fewer than three distinct poses saw it.

    Parameters
    ----------
    poses : (T, 3) dead-reckoned poses, [m, m, rad]
    start : one of `STARTS`
    """
    landmarks = np.full((the_world.n_landmarks, 2), np.nan)
    variances = dead_reckoning.dead_reckoning_variances(poses, the_world.scenario)
    for k in range(the_world.n_landmarks):
        mine = the_world.label_of == k
        seen_from, ranges = the_world.pose_of[mine], the_world.ranges[mine]
        distinct, first = np.unique(seen_from, return_index=True)
        if len(distinct) < graph.START_AFTER:
            continue
        if start == "first_poses":
            few = first[: graph.START_AFTER]
            landmarks[k] = graph.start_landmark(poses[seen_from[few], :2], ranges[few])
        else:
            variance = variances[seen_from] + the_world.scenario.range_sigma**2
            longest = the_world.ranges.max()
            landmarks[k] = best_cell(poses[seen_from, :2], ranges, variance, longest)
    return landmarks


def best_cell(
    positions: np.ndarray, ranges: np.ndarray, variances: np.ndarray, longest: float
) -> np.ndarray:
    """(2,) cell of a grid where N ranges are most likely, each of them right or an outlier.

    A right range is Gaussian about the distance, an outlier uniform up to `longest`. The grid
    covers every place that some range can reach from its position.

    Parameters
    ----------
    positions : (N, 2) where the ranges were taken, [m]
    ranges : (N,), [m]
    variances : (N,) of a right range about the distance, [m^2]
    longest : the longest range there is, [m]

    Source: the two-component likelihood of a range finder, Thrun, Burgard, Fox, Probabilistic
    Robotics, section 6.3.
    """
    low, high = positions.min(axis=0) - ranges.max(), positions.max(axis=0) + ranges.max()
    axes = np.linspace(low, high, GRID_CELLS)
    # a point of the cell is uniform about its centre: one twelfth of the squared width
    spread = variances + ((high - low) / (GRID_CELLS - 1)).max() ** 2 / 12
    right = (1 - GRID_OUTLIER_SHARE) / np.sqrt(2 * np.pi * spread)
    scores = _grid_scores(
        axes, positions, ranges, 0.5 / spread, right, GRID_OUTLIER_SHARE / longest
    )
    i, j = np.unravel_index(np.argmax(scores), scores.shape)
    return np.array([axes[i, 0], axes[j, 1]])


@compile_once
def _grid_scores(axes, positions, ranges, sharpness, right, outlier):
    """Log-likelihood of every cell, less that of outliers only: most ranges miss most cells."""
    scores = np.zeros((len(axes), len(axes)))
    for i in range(len(axes)):
        for j in range(len(axes)):
            for n in range(len(ranges)):
                dx, dy = axes[i, 0] - positions[n, 0], axes[j, 1] - positions[n, 1]
                error = ranges[n] - math.sqrt(dx * dx + dy * dy)
                exponent = sharpness[n] * error * error
                if exponent < NEGLIGIBLE_EXPONENT:
                    scores[i, j] += math.log1p(right[n] * math.exp(-exponent) / outlier)
    return scores


def values_of(poses: np.ndarray, landmarks: np.ndarray) -> gtsam.Values:
    """Poses and the landmarks that are not NaN, as GTSAM's start."""
    values = gtsam.Values()
    for t, pose in enumerate(poses):
        values.insert(X(t), gtsam.Pose2(*pose))
    for k in np.flatnonzero(np.isfinite(landmarks[:, 0])):
        values.insert(L(k), landmarks[k])
    return values


def _graduated(
    factors: gtsam.NonlinearFactorGraph, values: gtsam.Values, method: str, known_inliers: range
) -> tuple[gtsam.Values, np.ndarray]:
    """Graduated non-convexity on all but the known inliers; its estimate and (F,) weights."""
    losses = {"gnc_tls": gtsam.GncLossType.TLS, "gnc_gm": gtsam.GncLossType.GM}
    params = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
    params.setLossType(losses[method])
    params.setKnownInliers(list(known_inliers))
    optimizer = gtsam.GncLMOptimizer(factors, values, params)
    optimizer.setInlierCostThresholdsAtProbability(INLIER_QUANTILE)
    return optimizer.optimize(), optimizer.getWeights()


def reweighted(
    factors: gtsam.NonlinearFactorGraph, weights: np.ndarray
) -> gtsam.NonlinearFactorGraph:
    """The factors with their squared errors times (F,) weights; those of weight 0 left out."""
    kept = gtsam.NonlinearFactorGraph()
    for i in np.flatnonzero(weights > 0):
        factor, noise = factors.at(int(i)), factors.at(int(i)).noiseModel()
        scaled = gtsam.noiseModel.Diagonal.Sigmas(noise.sigmas() / np.sqrt(weights[i]))
        kept.push_back(factor.cloneWithNewNoiseModel(scaled))
    return kept
