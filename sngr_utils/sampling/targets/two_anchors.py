"""The landmark seen from two anchors, by GTSAM: its factors, iSAM2 on them, its likelihood."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import A, L

from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.world.two_anchors import TwoAnchors

ANCHOR_SIGMA = 1e-6  # m: the anchors are known
ANCHORS, LANDMARK = (A(0), A(1)), L(0)


def build_graph(scene: TwoAnchors) -> gtsam.NonlinearFactorGraph:
    """Two known anchors, two ranges, and a weak prior on the landmark at the saddle."""
    graph = gtsam.NonlinearFactorGraph()
    range_noise = gtsam.noiseModel.Isotropic.Sigma(1, scene.range_sigma)
    known = gtsam.noiseModel.Isotropic.Sigma(2, ANCHOR_SIGMA)
    weak = gtsam.noiseModel.Isotropic.Sigma(2, scene.landmark_prior_sigma)
    for key, position in zip(ANCHORS, scene.anchors, strict=True):
        graph.push_back(gtsam.PriorFactorPoint2(key, position, known))
        graph.push_back(gtsam.RangeFactor2(key, LANDMARK, scene.measured_range, range_noise))
    graph.push_back(gtsam.PriorFactorPoint2(LANDMARK, scene.saddle, weak))
    return graph


def run_isam2(scene: TwoAnchors, at: np.ndarray, updates: int = 10) -> gtsam.Values:
    """iSAM2 with the landmark started `at` a point, and extra updates to move if it can."""
    start = gtsam.Values()
    for key, position in zip(ANCHORS, scene.anchors, strict=True):
        start.insert(key, position)
    start.insert(LANDMARK, at)
    params = gtsam.ISAM2Params()
    params.setRelinearizeThreshold(1e-6)
    params.relinearizeSkip = 1
    isam = gtsam.ISAM2(params)
    isam.update(build_graph(scene), start)
    for _ in range(updates):
        isam.update()
    return isam.calculateEstimate()


def log_likelihood(scene: TwoAnchors, estimate: gtsam.Values, factor: float) -> LocalLikelihood:
    """Local log-likelihood of the landmark, as a function of its offset."""
    return LocalLikelihood(build_graph(scene), estimate, [LANDMARK], factor)
