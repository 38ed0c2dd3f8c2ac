"""Max-mixtures: a range is explained by the best of several Gaussians instead of by one.

A sum of Gaussians is no least-squares problem, their maximum is one wherever it is asked: each
range takes the component that explains it best, GTSAM solves with these, and so on until no
range changes its mind. Every round lowers the cost, and there are finitely many choices.
"""

from collections.abc import Callable

import gtsam
import numpy as np
from gtsam.symbol_shorthand import L, X

from sngr_utils.robust import association, losses
from sngr_utils.slam import levenberg_marquardt, range_density
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.factors import sure_factors
from sngr_utils.slam.solution import Solution, values_of
from sngr_utils.world import simulation

COMPONENTS = {
    "null": "the labelled landmark, or a null hypothesis as wide as the ranges differ",
    "all": "the labelled landmark, or any other one",
}
WRONG_SHARE = range_density.OUTLIER_SHARE  # weight of all but the label, as in the grid's start
MAX_ROUNDS = 100

Choice = tuple[np.ndarray, np.ndarray]  # (M,) landmark and (M,) sigma [m] of each range


def solve(
    the_world: simulation.World,
    conventions: Conventions,
    start: losses.Estimate,
    components: str,
) -> Solution:
    """Alternate the choice of components and Levenberg-Marquardt until the choice stays.

    Parameters
    ----------
    start : (T, 3) poses [m, m, rad] and (K, 2) landmarks [m]; no range is explained by a NaN
        landmark
    components : one of `COMPONENTS`

    Raises
    ------
    ValueError : unknown components

    Source: Olson & Agarwal, Inference on networks of mixtures for robust robot mapping, IJRR
    2013.
    """
    if components not in COMPONENTS:
        raise ValueError(f"components is {components!r}: it must be one of {sorted(COMPONENTS)}")
    choose: Callable = choose_null if components == "null" else choose_landmark
    poses, landmarks = start
    sure = sure_factors(the_world, conventions, landmarks)
    values = values_of(poses, landmarks)
    solution = Solution(None, sure, values, the_world.n_poses, the_world.n_landmarks)
    chosen = None
    for _ in range(MAX_ROUNDS):
        previous, chosen = chosen, choose(the_world, solution.poses, solution.landmarks)
        if previous is not None and all(map(np.array_equal, chosen, previous)):
            break
        factors = gtsam.NonlinearFactorGraph(sure)
        factors.push_back(_chosen_ranges(the_world, *chosen))
        result = levenberg_marquardt.levenberg_marquardt(factors, solution.estimate)
        solution = Solution(None, factors, result, the_world.n_poses, the_world.n_landmarks)
    return solution


def choose_null(the_world: simulation.World, poses: np.ndarray, landmarks: np.ndarray) -> Choice:
    """For each range the better of its label with the sensor's sigma and the null hypothesis.

    The null hypothesis is Gaussian too, and as wide as two ranges differ: sqrt 2 of their
    standard deviation. Ranges to a NaN landmark get the landmark -1.
    """
    sigma, null = the_world.scenario.range_sigma, np.sqrt(2) * np.std(the_world.ranges)
    rows = np.arange(len(the_world.ranges))
    mine = association.residuals(the_world, poses, landmarks, (1.0, 0.0))[rows, the_world.label_of]
    right = np.log((1 - WRONG_SHARE) / sigma) - 0.5 * (mine / sigma) ** 2
    wrong = np.log(WRONG_SHARE / null) - 0.5 * (mine / null) ** 2
    label = np.where(np.isfinite(mine), the_world.label_of, -1)
    return label, np.where(right >= wrong, sigma, null)


def choose_landmark(
    the_world: simulation.World, poses: np.ndarray, landmarks: np.ndarray
) -> Choice:
    """For each range the landmark that explains it best, its label having the largest weight."""
    sigma = the_world.scenario.range_sigma
    weights = np.full(
        (len(the_world.ranges), the_world.n_landmarks), WRONG_SHARE / (the_world.n_landmarks - 1)
    )
    weights[np.arange(len(weights)), the_world.label_of] = 1 - WRONG_SHARE
    residuals = association.residuals(the_world, poses, landmarks, (1.0, 0.0))
    scores = np.log(weights) - 0.5 * (residuals / sigma) ** 2
    best = np.argmax(np.where(np.isfinite(scores), scores, -np.inf), axis=1)
    label = np.where(np.isfinite(scores).any(axis=1), best, -1)
    return label, np.full(len(label), sigma)


def _chosen_ranges(
    the_world: simulation.World, landmark: np.ndarray, sigma: np.ndarray
) -> gtsam.NonlinearFactorGraph:
    noises = {value: gtsam.noiseModel.Isotropic.Sigma(1, value) for value in set(sigma)}
    factors = gtsam.NonlinearFactorGraph()
    chosen = zip(the_world.pose_of, landmark, the_world.ranges, sigma, strict=True)
    for t, k, distance, value in chosen:
        if k >= 0:
            factors.push_back(gtsam.RangeFactor2D(X(t), L(k), distance, noises[value]))
    return factors
