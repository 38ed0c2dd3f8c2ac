"""What the batch estimates are by definition: GTSAM on the same factors, from the same start.

For tests, and for the bench; nothing else is made of it.
"""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.robust import association, em, losses
from sngr_utils.slam import chain_solver
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import range_factor, sure_factors
from sngr_utils.slam.solution import Solution, landmarks_of, poses_of, values_of
from sngr_utils.world.simulation import World

ESTIMATORS = gtsam.noiseModel.mEstimator
KERNELS = {
    "huber": ESTIMATORS.Huber.Create(1.345),
    "cauchy": ESTIMATORS.Cauchy.Create(2.3849),
    "dcs": ESTIMATORS.DCS.Create(1.0),
    "geman_mcclure": ESTIMATORS.GemanMcClure.Create(1.0),
}
GNC = {"gnc_tls": gtsam.GncLossType.TLS, "gnc_gm": gtsam.GncLossType.GM}


def levenberg_marquardt(factors: gtsam.NonlinearFactorGraph, values: gtsam.Values) -> gtsam.Values:
    """Optimise to convergence; robust losses are reweighted."""
    # GTSAM's own defaults let lambda underflow to 0, which no factor raises again: a hang
    params = gtsam.LevenbergMarquardtParams.CeresDefaults()
    params.setMaxIterations(chain_solver.THOROUGH.most_steps)
    params.setRelativeErrorTol(chain_solver.THOROUGH.relative)
    params.setAbsoluteErrorTol(chain_solver.THOROUGH.absolute)
    return gtsam.LevenbergMarquardtOptimizer(factors, values, params).optimize()


def range_factors(
    the_world: World, landmarks: np.ndarray, kernel: ESTIMATORS.Base | None = None
) -> gtsam.NonlinearFactorGraph:
    """The ranges, by label, under a kernel; those to a NaN landmark are left out."""
    noise = gtsam.noiseModel.Isotropic.Sigma(1, the_world.scenario.range_sigma)
    noise = noise if kernel is None else gtsam.noiseModel.Robust.Create(kernel, noise)
    factors = gtsam.NonlinearFactorGraph()
    measured = zip(the_world.pose_of, the_world.label_of, the_world.ranges, strict=True)
    for t, k, distance in measured:
        if np.isfinite(landmarks[k, 0]):
            factors.push_back(gtsam.RangeFactor2D(X(t), L(k), distance, noise))
    return factors


def reweighted(
    factors: gtsam.NonlinearFactorGraph, weights: np.ndarray
) -> gtsam.NonlinearFactorGraph:
    """The factors with their squared errors times (F,) weights; those of weight 0 left out."""
    kept = gtsam.NonlinearFactorGraph()
    for i in np.flatnonzero(weights > 0):
        factor = factors.at(int(i))
        sigmas = factor.noiseModel().sigmas() / np.sqrt(weights[i])
        kept.push_back(factor.cloneWithNewNoiseModel(gtsam.noiseModel.Diagonal.Sigmas(sigmas)))
    return kept


def solve(
    the_world: World,
    conventions: Conventions,
    method: str,
    start: losses.Estimate,
    kernel: ESTIMATORS.Base | None = None,
) -> Solution:
    """The `Solution` of a method of `losses`, or under a kernel of one's own."""
    factors = sure_factors(the_world, conventions, start[1])
    n_sure, values = factors.size(), values_of(*start)
    factors.push_back(range_factors(the_world, start[1], kernel or KERNELS.get(method)))
    if method in GNC:
        params = gtsam.GncLMParams(gtsam.LevenbergMarquardtParams())
        params.setLossType(GNC[method])
        params.setKnownInliers(list(range(n_sure)))
        optimizer = gtsam.GncLMOptimizer(factors, values, params)
        optimizer.setInlierCostThresholds(losses.GNC_SQUARED / 2)
        result = optimizer.optimize()
        factors = reweighted(factors, optimizer.getWeights())
    else:
        result = levenberg_marquardt(factors, values)
    return Solution(None, factors, result, the_world.n_poses, the_world.n_landmarks)


def fit(
    the_world: World, conventions: Conventions, start: losses.Estimate, exclusive: bool
) -> losses.Estimate:
    """`em.fit` without clutter, every least-squares problem solved by GTSAM."""
    log, (poses, landmarks) = the_world.log(conventions.x0_sigmas), start
    sure, params = (
        sure_factors(the_world, conventions, landmarks),
        gtsam.LevenbergMarquardtParams.CeresDefaults(),
    )
    shares, width = association.Shares(0.5, 0.0), em.WIDEST
    for _ in range(em.ITERATIONS):
        weights = association.responsibilities(log, poses, landmarks, shares, width, exclusive)
        shares, before = association.estimate_shares(log, weights, landmarks, shares), poses
        factors = gtsam.NonlinearFactorGraph(sure)
        for m, k in np.argwhere(weights[:, :-1] > association.NEGLIGIBLE):
            sigma = width * log.range_sigmas[m] / np.sqrt(weights[m, k])
            factors.push_back(range_factor(int(log.pose_of[m]), int(k), log.ranges[m], sigma))
        values = values_of(poses, landmarks)
        found = gtsam.LevenbergMarquardtOptimizer(factors, values, params).optimize()
        poses, landmarks = poses_of(found, log.n_poses), landmarks_of(found, log.n_landmarks)
        moved = np.abs(poses - before)[:, :2].max()
        if width == 1.0 and moved < em.SETTLED * np.median(log.range_sigmas):
            break
        width = max(1.0, em.COOLING * width)
    return poses, landmarks
