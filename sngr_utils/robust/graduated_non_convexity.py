"""Graduated non-convexity, by GTSAM."""

import gtsam
import numpy as np

HUBER_K, CAUCHY_K, DCS_PHI, GEMAN_MCCLURE_C, INLIER_QUANTILE = 1.345, 2.3849, 1.0, 1.0, 0.99


def graduated(
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
