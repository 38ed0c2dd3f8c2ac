"""Max-mixtures: a range is explained by the best of several Gaussians instead of by one.

A sum of Gaussians is no least-squares problem, their maximum is one wherever it is asked: each
range takes the component that explains it best, these are solved with, and so on until no range
changes its mind. Every round lowers the cost, and there are finitely many choices.
"""

import numpy as np

from sngr_utils.robust.association import Shares, log_prior, residuals
from sngr_utils.robust.losses import Estimate
from sngr_utils.slam import chain_problem, chain_solver
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.log import NO_LABEL, Log

COMPONENTS = {
    "null": "the labelled landmark, or a null hypothesis as wide as the ranges differ",
    "all": "the labelled landmark, or any other one",
}
WRONG_SHARE = 0.5  # weight of all but the label: right or wrong alike, as in the grid's start
MAX_ROUNDS = 100

Choice = tuple[np.ndarray, np.ndarray]  # (M,) landmark and (M,) sigma [m] of each range


def solve(
    log: Log, conventions: Conventions, start: Estimate, components: str
) -> chain_solver.Estimate:
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
    choose = choose_null if components == "null" else choose_landmark
    chain = chain_problem.of_log(log, start[1], conventions.landmark_prior_sigma)
    at, found, chosen = chain_solver.state_of(chain, *start), (0.0, 0, True), None
    for _ in range(MAX_ROUNDS):
        previous, chosen = chosen, choose(log, at.frames, at.landmarks)
        if previous is not None and all(map(np.array_equal, chosen, previous)):
            break
        chain = chain._replace(landmark_of=chosen[0], sigmas=chosen[1])
        at, *found = chain_solver.minimise(chain, LEAST_SQUARES, chain_solver.THOROUGH, at)
    return chain_solver.concluded(chain, LEAST_SQUARES, at, *found)


def choose_null(log: Log, poses: np.ndarray, landmarks: np.ndarray) -> Choice:
    """For each range the better of its label with the sensor's sigma and the null hypothesis.

    The null hypothesis is Gaussian too, and as wide as two ranges differ: sqrt 2 of their
    standard deviation. Ranges to a NaN landmark get the landmark -1.

    Parameters
    ----------
    poses : (T, 2 or more), x and y first, [m]
    """
    sigma, null = log.range_sigmas, np.sqrt(2) * np.std(log.ranges)
    nowhere = np.full(len(sigma), np.nan)  # the last column, of ranges without a label
    mine = np.column_stack([residuals(log, poses, landmarks), nowhere])
    mine = mine[np.arange(len(sigma)), log.label_of]
    right = np.log((1 - WRONG_SHARE) / sigma) - 0.5 * (mine / sigma) ** 2
    wrong = np.log(WRONG_SHARE / null) - 0.5 * (mine / null) ** 2
    label = np.where(np.isfinite(mine), log.label_of, NO_LABEL)
    return label, np.where(right >= wrong, sigma, null)


def choose_landmark(log: Log, poses: np.ndarray, landmarks: np.ndarray) -> Choice:
    """For each range the landmark that explains it best, its label having the largest weight."""
    scores = log_prior(log, Shares(WRONG_SHARE, 0.0))[:, :-1]
    scores -= 0.5 * (residuals(log, poses, landmarks) / log.range_sigmas[:, None]) ** 2
    best = np.argmax(np.where(np.isfinite(scores), scores, -np.inf), axis=1)
    label = np.where(np.isfinite(scores).any(axis=1), best, NO_LABEL)
    return label, log.range_sigmas
