"""Louis' covariance: what an EM estimate knows, less what the associations leave open.

A range touches its own pose and the landmarks it may have come from, so that both informations
are those of a chain of poses bordered by the landmarks, and the inverse takes linear time.
"""

from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.sparse import linalg as iterative

from sngr_utils.numerics.jit import compile_once
from sngr_utils.robust.association import NEGLIGIBLE
from sngr_utils.slam import chain_cost, chain_problem, damped_step, information
from sngr_utils.slam.chain_cost import State
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES

MOST_MISSING = 0.9  # of the information in any direction, see `position_covariances`
IMPOSSIBLE = 1e-18  # responsibilities below it are no part of a score's covariance
FEW = 250  # variables up to which all directions are found at once
MANY = 300  # directions above the share beyond which a bound stands for all, in linear time
APART = 1e-4  # from 1, a share at which the information is no longer near singular
NUDGE = 1.0003  # by which what is withheld grows where a share is nearer


class Blocks(NamedTuple):
    """A symmetric matrix of a chain with T poses and B columns in its border.

    Attributes
    ----------
    own, rest : (T, 3, 3) of each pose, and (T, 3, 3+B) between pose t and [pose t+1 | border]
    front : (3+B, 3+B) of the border in the lower right, else zero
    """

    own: np.ndarray
    rest: np.ndarray
    front: np.ndarray

    def less(self, other: "Blocks", share: float) -> "Blocks":
        """`share` times this, less another one."""
        return Blocks(*(share * a - b for a, b in zip(self, other, strict=True)))


def position_covariances(chain: Chain, at: State, weights: np.ndarray) -> np.ndarray:
    """(T, 2, 2) position covariances in the world frame, [m^2], associations integrated out.

    The information is that of the weighted ranges, C, less what the unknown associations
    withhold: M, the covariance of its score over them, range by range. Where they withhold more
    than 90 % in a direction (d with M d = share C d), the posterior is no Gaussian about this
    estimate, and 10 % are kept. Of a long estimate that is lost there are thousands of such
    directions: beyond `MANY` 10 % are kept in all, a bound from above.

    Parameters
    ----------
    chain : every range once
    at : the estimate
    weights : (N, K+1) posterior of every range's source

    Source: Louis, JRSS B 44, 1982.
    """
    system, withheld = _linearised(chain, at, weights), _withheld(chain, at, weights)
    complete = Blocks(*system[:3])
    n_above = _eliminated(complete.less(withheld, MOST_MISSING))[1]
    size = 3 * len(at.frames) + len(complete.front) - 3
    if n_above == 0:
        covariances = _inverse(complete.less(withheld, 1.0))
    elif size <= FEW:
        covariances = _capped(complete, withheld, len(at.frames), size)
    elif n_above > MANY:
        covariances = _inverse(complete) / (1 - MOST_MISSING)
    else:
        covariances = _capped_in_few(system, withheld, n_above, size)
    return information.in_world_frame(covariances[:, :2, :2], *at.frames.T[2:])


def _linearised(chain: Chain, at: State, weights: np.ndarray) -> information.System:
    """Gauss-Newton information of the weighted ranges, and of all that is sure."""
    problem = chain_problem.weighted(chain, weights, 1.0, NEGLIGIBLE)
    at = at._replace(residuals=np.empty(len(problem.ranges)))
    chain_cost.cost(problem, LEAST_SQUARES, at)
    return chain_cost.linearise(problem, LEAST_SQUARES, at)


@compile_once
def _withheld(chain, at, weights):
    """Covariance of the score over the associations, a range with an open source at a time."""
    k = len(at.landmarks)
    system = information.empty_system(len(at.frames), 2 * k + np.sum(chain.columns >= 0))
    blocks = Blocks(system.own, system.rest, system.front)
    for m in range(len(chain.ranges)):
        largest = 0.0
        for j in range(k):
            largest = max(largest, weights[m, j])
        if largest < 1.0 - NEGLIGIBLE:
            _add_open(chain, at, weights, m, blocks)
    return blocks


@compile_once
def _add_open(chain, at, weights, m, blocks):
    """Add the covariance of one range's score; a range from no landmark has a score of zero."""
    width, t = len(blocks.front), chain.pose_of[m]
    likely = np.flatnonzero(weights[m, :-1] > IMPOSSIBLE)
    scores, mean = np.zeros((len(likely), width)), np.zeros(width)  # by pose t, and the border
    chance, none = np.empty(len(likely)), 1.0
    for i in range(len(likely)):
        j = likely[i]
        distance, x, y = information.distance_and_direction(at.frames, at.landmarks, t, j)
        scale, variance = at.calibration[0], chain.sigmas[m] ** 2
        slope = (chain.ranges[m] - scale * distance - at.calibration[1]) / variance
        cos, sin = at.frames[t, 2], at.frames[t, 3]
        scores[i, 0] = -scale * slope * (cos * x + sin * y)
        scores[i, 1] = scale * slope * (sin * x - cos * y)
        scores[i, 3 + 2 * j], scores[i, 4 + 2 * j] = scale * slope * x, scale * slope * y
        if chain.columns[0] >= 0:
            scores[i, 3 + chain.columns[0]] = slope * distance
        if chain.columns[1] >= 0:
            scores[i, 3 + chain.columns[1]] = slope
        chance[i] = weights[m, j]
        none -= chance[i]
        mean += chance[i] * scores[i]
    _add_square(mean, max(none, 0.0), t, blocks)
    for i in range(len(likely)):
        _add_square(scores[i] - mean, chance[i], t, blocks)


@compile_once
def _add_square(vector, weight, t, blocks):
    """Add weight times the square of a (3+B,) vector of pose t and the border."""
    touched = np.flatnonzero(vector)
    for i in touched:
        for j in touched:
            term = weight * vector[i] * vector[j]
            if i >= 3 and j >= 3:
                blocks.front[i, j] += term
            elif i < 3 and j < 3:
                blocks.own[t, i, j] += term
            elif i < 3:
                blocks.rest[t, i, j] += term


def _eliminated(blocks: Blocks) -> tuple[Blocks, int]:
    """Poses eliminated and the border inverted, in place; how many eigenvalues are negative.

    Source: Sylvester's law of inertia; Haynsworth, Linear Algebra and its Applications 1, 1968.
    """
    below = _eliminate(*blocks)
    border = np.triu(blocks.front[3:, 3:])
    border += np.triu(border, 1).T
    below += int(np.sum(np.linalg.eigvalsh(border) <= 0))
    blocks.front[3:, 3:] = np.linalg.inv(border)
    return blocks, below


@compile_once
def _eliminate(own, rest, front):
    """`information.eliminate` of a matrix that need not be definite; its negative pivots.

    Leaves the inverse of every pivot, and the gains, as that does.
    """
    lost, gain, below = np.zeros(front.shape), np.empty(rest.shape[1:]), 0
    for t in range(len(own)):
        information.take_over(t, own, rest, front, lost)
        below += _invert_any(own[t])
        information.hand_on(t, own, rest, front, lost, gain)
    return below


@compile_once
def _invert_any(a):
    """Invert a symmetric (3, 3) matrix in place; the number of its negative eigenvalues."""
    xx, xy = a[1, 1] * a[2, 2] - a[1, 2] ** 2, a[0, 2] * a[1, 2] - a[0, 1] * a[2, 2]
    xz, minor = a[0, 1] * a[1, 2] - a[0, 2] * a[1, 1], a[0, 0] * a[1, 1] - a[0, 1] ** 2
    determinant = a[0, 0] * xx + a[0, 1] * xy + a[0, 2] * xz
    below = (a[0, 0] < 0) + ((a[0, 0] < 0) != (minor < 0)) + ((minor < 0) != (determinant < 0))
    yy, yz = a[0, 0] * a[2, 2] - a[0, 2] ** 2, a[0, 1] * a[0, 2] - a[0, 0] * a[1, 2]
    a[0, 0], a[0, 1], a[0, 2] = xx / determinant, xy / determinant, xz / determinant
    a[1, 1], a[1, 2], a[2, 2] = yy / determinant, yz / determinant, minor / determinant
    a[1, 0], a[2, 0], a[2, 1] = a[0, 1], a[0, 2], a[1, 2]
    return below


def _inverse(blocks: Blocks) -> np.ndarray:
    """(T, 3, 3) diagonal blocks of the inverse, [m, m, rad], in the body frame."""
    (own, rest, front), _ = _eliminated(blocks)
    information.substitute(own, rest, front, np.empty((max(len(own) - 2, 0), 3, 3)))
    return own


@compile_once
def times(own, rest, front, vectors):
    """The matrix times (D, n) vectors."""
    product, n, last = np.zeros(vectors.shape), vectors.shape[1], 3 * len(own)
    for t in range(len(own)):
        for i in range(3):
            for j in range(3):
                for c in range(n):
                    product[3 * t + i, c] += own[t, i, j] * vectors[3 * t + j, c]
            for j in range(rest.shape[2]):
                if j >= 3 or t < len(own) - 1:
                    row = 3 * t + 3 + j if j < 3 else last + j - 3
                    for c in range(n):
                        product[3 * t + i, c] += rest[t, i, j] * vectors[row, c]
                        product[row, c] += rest[t, i, j] * vectors[3 * t + i, c]
    for i in range(3, len(front)):
        for j in range(3, len(front)):
            for c in range(n):
                product[last + i - 3, c] += front[i, j] * vectors[last + j - 3, c]
    return product


def _capped(complete: Blocks, withheld: Blocks, n_poses: int, size: int) -> np.ndarray:
    """`_inverse` of C - M, with no share of M above `MOST_MISSING`, by all directions."""
    pencil = (times(*blocks, np.eye(size)) for blocks in (withheld, complete))
    shares, directions = linalg.eigh(*pencil)
    scaled = directions / np.sqrt(1 - np.clip(shares, 0, MOST_MISSING))
    rows = scaled[: 3 * n_poses].reshape(n_poses, 3, size)
    return rows @ rows.transpose(0, 2, 1)


def _capped_in_few(
    system: information.System, withheld: Blocks, n_above: int, size: int
) -> np.ndarray:
    """The same by the `n_above` directions in which it is above.

    Each adds d d^T / (1 - share) to the inverse of C - M, definite or not, and shall add
    d d^T / (1 - MOST_MISSING). A share of all but 1 would make the difference of large numbers.
    """
    complete, split = Blocks(*system[:3]), 3 * len(system.own)

    def solve(v):
        steps, border = np.empty(system.slope.shape), np.empty(system.pull.shape)
        right = system._replace(slope=-v[:split].reshape(steps.shape), pull=-v[split:])
        damped_step.solve(right, 0.0, False, steps, border)
        return np.append(steps, border)

    def operator(work):
        return iterative.LinearOperator((size, size), work, dtype=float)

    shares, directions = iterative.eigsh(
        operator(lambda v: times(*withheld, v.reshape(size, 1)).ravel()), n_above,
        operator(lambda v: times(*complete, v.reshape(size, 1)).ravel()), which="LA",
        v0=np.ones(size), Minv=operator(solve),
    )  # fmt: skip
    grown = 1.0
    while np.min(np.abs(grown * shares - 1)) < APART:
        grown *= NUDGE
    nudged = Blocks(*(grown * block for block in withheld))
    added = 1 / (1 - MOST_MISSING) - 1 / (1 - grown * shares)
    rows = directions[:split].reshape(-1, 3, n_above)
    return _inverse(complete.less(nudged, 1.0)) + (rows * added) @ rows.transpose(0, 2, 1)
