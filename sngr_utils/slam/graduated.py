"""Graduated non-convexity: least squares again and again, while a robust loss takes shape.

Every range has a weight. A surrogate of the loss, first nearly convex, says from the residuals
what it should be; each round solves from the same start under the weights of the last one.
"""

import numpy as np

from sngr_utils.slam import chain_cost, chain_solver
from sngr_utils.slam.chain_cost import State
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES

# GTSAM's (GncLMOptimizer)
ROUNDS, STEP = 100, 1.4
COST_SETTLED, WEIGHTS_SETTLED = 1e-5, 1e-4
LEAST_SHAPE = 1e-6


def truncated_weight(squared: np.ndarray, limit: float, shape: float) -> np.ndarray:
    """(N,) weights of truncated least squares (eq. 14 of the source); exact as shape grows.

    Parameters
    ----------
    squared : (N,) squared residuals, in sigmas
    limit : squared residual at which the loss is truncated
    """
    with np.errstate(divide="ignore"):
        between = np.sqrt(limit * shape * (shape + 1) / squared) - shape
    return np.clip(between, 0, 1)


def geman_mcclure_weight(squared: np.ndarray, limit: float, shape: float) -> np.ndarray:
    """(N,) weights of Geman and McClure's loss with c^2 = limit (eq. 12); exact at shape 1."""
    return (shape * limit / (shape * limit + squared)) ** 2


def solve(
    chain: Chain, poses: np.ndarray, landmarks: np.ndarray, truncated: bool, limit: float
) -> tuple[chain_solver.Estimate, np.ndarray]:
    """Estimate under truncated least squares, or Geman and McClure's loss, and (N,) weights.

    Parameters
    ----------
    poses, landmarks : as for `chain_solver.solve`; every round starts there
    truncated : else Geman and McClure
    limit : squared residual, in sigmas, beyond which a range is an outlier

    Raises
    ------
    ValueError : as `chain_solver.solve`

    Source: Yang, Antonante, Tzoumas, Carlone, RA-L 2020; rounds and stops as in GTSAM.
    """
    weigh = truncated_weight if truncated else geman_mcclure_weight
    start = chain_solver.state_of(chain, poses, landmarks)
    shape = _first_shape(_squared(chain, start), truncated, limit)
    weighted, found = chain, _minimise(chain, start)
    for _ in range(ROUNDS if shape > 0 else 0):
        before = found[1]
        weights = weigh(_squared(chain, found[0]), limit, shape)
        weighted = chain._replace(weights=chain.weights * weights)
        found = _minimise(weighted, start)
        settled = abs(found[1] - before) < COST_SETTLED * max(before, 1e-7)
        binary = truncated and np.all(np.abs(weights - np.round(weights)) <= WEIGHTS_SETTLED)
        if settled or binary or (not truncated and shape == 1):
            break
        shape = shape * STEP if truncated else max(1.0, shape / STEP)
    return chain_solver.concluded(weighted, LEAST_SQUARES, *found), weighted.weights


def _minimise(chain: Chain, start: State) -> tuple:
    """`chain_solver.minimise` with GTSAM's defaults from a copy of the start."""
    copy = State(*(array.copy() for array in start))
    return chain_solver.minimise(chain, LEAST_SQUARES, chain_solver.LEGACY, copy)


def _squared(chain: Chain, at: State) -> np.ndarray:
    """(N,) squared residuals of the ranges, in sigmas; 0 for one of no landmark or weight."""
    chain_cost.cost(chain, LEAST_SQUARES, at)
    return (at.residuals / chain.sigmas) ** 2


def _first_shape(squared: np.ndarray, truncated: bool, limit: float) -> float:
    """At which the surrogate is convex (remark 5 of the source); <= 0 if nothing is an outlier."""
    worst = squared.max(initial=0.0)
    if not truncated:
        return 2 * worst / limit
    excess = 2 * worst - limit
    return max(limit / excess, LEAST_SHAPE) if excess > 0 else -1.0
