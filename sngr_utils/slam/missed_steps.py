"""Steps of the odometry that err by more than their noise, and how open they leave an estimate.

Wheels that count forwards while the robot backs up err by little most of the time, and at a few
steps by many sigmas. Least squares spreads such an error over the poses around it, and its
covariance, which is that of white noise, does not say so. The estimate here stays as it is: its
covariance is widened, by an open variance for each step that is missed.

Which ones are is asked of the residuals that the estimate leaves, each in units of its own standard
deviation; under the model they are standard normal. The worst is missed if noise had one as bad in
one log of twenty, for as many as there are; neighbours are correlated, so that it is rarer. Then
the others are judged anew, with that one open.

Source: de Jong, Penzer, Journal of the American Statistical Association 93, 1998, on shocks in
state-space models.
"""

from typing import NamedTuple

import numpy as np
from scipy import stats

from sngr_utils.slam import chain_cost, chain_solver, damped_step, information, noise_estimation
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.chain_solver import State
from sngr_utils.slam.range_loss import LEAST_SQUARES
from sngr_utils.world.dead_reckoning import relative_motion

RARE = 0.05  # chance that noise alone misses a step of a log
SEEN = 1e-4  # of a step's variance, which the ranges must see: less is rounding
MOST = 20  # missed steps of a log


class Missed(NamedTuple):
    """By how much each of Q missed steps moves an estimate, in one standard deviation.

    Attributes
    ----------
    poses : (Q, T, 3) in the body frame, [m, m, rad]
    calibration : (Q, B) of those of range scale and offset [m] that are estimated
    """

    poses: np.ndarray
    calibration: np.ndarray


def find(chain: Chain, at: State) -> Missed:
    """The steps that are missed at the minimum `at` of a problem."""
    cost = chain_cost.cost(chain, LEAST_SQUARES, at)
    found = chain_solver.concluded(chain, LEAST_SQUARES, at, cost, 0, True)
    odometry = information.poses_of(chain.motions)
    residuals, spread = noise_estimation.steps(odometry, found)
    roots = np.linalg.cholesky(np.linalg.inv(chain.step_information))
    whiten = np.linalg.inv(roots)
    scores = _times(whiten, residuals).ravel()
    shares = 1 - np.diagonal(whiten @ spread @ whiten.swapaxes(1, 2), 0, 1, 2).ravel()
    back = noise_estimation.carried(relative_motion(found.poses))
    missed, columns, ways, borders = [], np.empty((0, scores.size)), [], []
    while (worst := _worst(scores, shares, columns, missed)) is not None:
        way, border = _way(chain, at, back, roots, worst)
        seen = _times(whiten, way[1:] - _times(back, way[:-1])).ravel()
        missed.append(worst)
        columns = np.vstack([columns, (np.arange(scores.size) == worst) - seen])
        ways.append(way)
        borders.append(border[found.landmarks.size :])
    among = np.linalg.inv(columns[:, missed])
    variances = np.maximum((among @ scores[missed]) ** 2 - np.diagonal(among), 0.0)
    sigmas, n = np.sqrt(variances)[:, None], len(missed)
    poses = np.reshape(ways, (n, *found.poses.shape))
    calibration = np.reshape(borders, (n, np.count_nonzero(chain.columns >= 0)))
    return Missed(sigmas[:, :, None] * poses, sigmas * calibration)


def _worst(
    scores: np.ndarray, shares: np.ndarray, columns: np.ndarray, missed: list[int]
) -> int | None:
    """The error that is missed most clearly with those open that are known to be; None if none is.

    Parameters
    ----------
    scores, shares : (N,) errors of the steps as the estimate leaves them, in sigmas of their noise,
        and the variances of these
    columns : (Q, N) their covariance with those that are open
    missed : of these, the numbers
    """
    gain = np.linalg.solve(columns[:, missed], columns)
    left, open_to = scores - scores[missed] @ gain, shares - np.sum(columns * gain, axis=0)
    open_to[missed] = 0.0
    sizes = np.where(open_to > SEEN, np.abs(left) / np.sqrt(np.maximum(open_to, SEEN)), 0.0)
    limit = stats.norm.isf(RARE / (2 * max(len(scores), 1)))
    return int(np.argmax(sizes)) if sizes.max(initial=0.0) > limit and len(missed) < MOST else None


def _way(
    chain: Chain, at: State, back: np.ndarray, roots: np.ndarray, error: int
) -> tuple[np.ndarray, np.ndarray]:
    """How the poses (T, 3) and the border move with an error of a step by a sigma of its noise."""
    step, along = divmod(error, 3)
    system = chain_cost.linearise(chain, LEAST_SQUARES, at)
    pull = chain.step_information[step] @ roots[step][:, along]
    system.pull[:] = system.slope[:] = 0.0
    system.slope[step + 1] -= pull
    system.slope[step] += back[step].T @ pull
    steps, border = np.empty(system.slope.shape), np.empty(len(system.pull))
    damped_step.solve(system, 0.0, False, steps, border)
    return steps, border


def _times(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    return np.einsum("nij,nj->ni", matrices, vectors)
