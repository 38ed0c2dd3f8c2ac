"""Louis' covariance: what an EM estimate knows, less what the associations leave open.

Information is sparse: a range touches its own pose and the landmarks it may have come from, so
that the poses are a chain bordered by the landmarks, and its inverse takes linear time.
"""

import numpy as np
from scipy import sparse
from scipy.sparse import linalg

from sngr_utils.numerics.linalg import invert
from sngr_utils.robust.association import NEGLIGIBLE
from sngr_utils.slam import chain_cost, chain_problem, information
from sngr_utils.slam.chain_cost import State
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.factors import range_derivatives
from sngr_utils.slam.range_loss import LEAST_SQUARES

MOST_MISSING = 0.9  # of the information in any direction, see `position_covariances`
IMPOSSIBLE = 1e-18  # responsibilities below it are no part of a score's covariance


def position_covariances(chain: Chain, at: State, weights: np.ndarray) -> np.ndarray:
    """(T, 2, 2) position covariances in the world frame, [m^2], associations integrated out.

    The information is that of the weighted ranges, C, less what the unknown associations
    withhold: M, the covariance of its score over them, range by range. Where they withhold more
    than 90 % in a direction (d with M d = share C d), the posterior is no Gaussian about this
    estimate, and 10 % are kept.

    Parameters
    ----------
    chain : every range once
    at : the estimate
    weights : (N, K+1) posterior of every range's source

    Source: Louis, JRSS B 44, 1982.
    """
    n_poses = len(at.frames)
    complete, scores = _information(chain, at, weights), _scores(chain, at, weights)
    if n_above := _n_above(complete, scores, n_poses):
        covariances = _capped(complete, scores, n_above, n_poses)
    else:
        covariances = _pose_covariances(complete - scores @ scores.T, n_poses)
    cos, sin = at.frames[:, 2], at.frames[:, 3]
    rotations = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
    return rotations @ covariances[:, :2, :2] @ rotations.transpose(0, 2, 1)


def _information(chain: Chain, at: State, weights: np.ndarray) -> sparse.csr_array:
    """(D, D) Gauss-Newton information of the weighted ranges, poses first, then the border."""
    problem = chain_problem.weighted(chain, weights[:, :-1], 1.0, NEGLIGIBLE)
    at = at._replace(residuals=np.empty(len(problem.ranges)))
    chain_cost.cost(problem, LEAST_SQUARES, at)
    own, rest, front, *_ = chain_cost.linearise(problem, LEAST_SQUARES, at)
    n, (_, rows, columns) = 3 * len(own), np.indices(own.shape) + 3 * np.indices(own.shape)[0]
    place = rows.ravel(), columns.ravel()
    chained = sparse.coo_array((own.ravel(), place), shape=(n, n))
    following = sparse.coo_array(
        (rest[:-1, :, :3].ravel(), (rows[:-1].ravel(), columns[1:].ravel())), shape=(n, n)
    )
    border = sparse.csr_array(rest[:, :, 3:].reshape(n, -1))
    return sparse.block_array(
        [[chained + following + following.T, border], [border.T, front[3:, 3:]]], format="csr"
    )


def _scores(chain: Chain, at: State, weights: np.ndarray) -> sparse.csc_array:
    """(D, S) sparse V with M = V V^T, the covariance of the score over the associations.

    One column for each source that an open range may have: its score less the mean over all,
    times the root of its probability. A range from none of the landmarks has no score.
    """
    poses, (scale, offset) = information.poses_of(at.frames), at.calibration
    size = 3 * len(poses) + at.landmarks.size + np.sum(chain.columns >= 0)
    pieces, n_columns = [], 0
    for m in np.flatnonzero(weights[:, :-1].max(axis=1, initial=0.0) < 1 - NEGLIGIBLE):
        t, likely = int(chain.pose_of[m]), np.flatnonzero(weights[m, :-1] > IMPOSSIBLE)
        mine, n = weights[m, likely], len(likely)
        distance, by_pose, by_landmark = range_derivatives(poses[t], at.landmarks[likely])
        slope = (chain.ranges[m] - scale * distance - offset) / chain.sigmas[m] ** 2
        score = np.zeros((n + 1, 1 + n, 2))  # by the position, and by each of the landmarks
        score[:n, 0] = scale * slope[:, None] * by_pose
        score[np.arange(n), 1 + np.arange(n)] = scale * slope[:, None] * by_landmark
        calibration = np.zeros((n + 1, 2))
        calibration[:n] = np.column_stack([slope * distance, slope])
        estimated = chain.columns >= 0
        score = np.hstack([score.reshape(n + 1, -1), calibration[:, estimated]])
        chances = np.append(mine, max(1 - mine.sum(), 0.0))
        centred = np.sqrt(chances)[:, None] * (score - chances @ score)
        first = 3 * len(poses) + 2 * likely
        touched = np.concatenate([
            [3 * t, 3 * t + 1], np.column_stack([first, first + 1]).ravel(),
            3 * len(poses) + chain.columns[estimated],
        ])  # fmt: skip
        columns = np.repeat(np.arange(n_columns, n_columns + n + 1), len(touched))
        pieces.append((centred.ravel(), np.tile(touched, n + 1), columns))
        n_columns += n + 1
    entries, rows, columns = (
        map(np.concatenate, zip(*pieces, strict=True)) if pieces else ([], [], [])
    )
    return sparse.csc_array((entries, (rows, columns)), shape=(size, n_columns))


def _n_above(complete, scores, n_poses: int) -> int:
    """In how many directions is more than `MOST_MISSING` of the information withheld?

    As many as `MOST_MISSING` C - M has negative pivots when the poses are eliminated.

    Source: Sylvester's law of inertia; Haynsworth, Linear Algebra and its Applications 1, 1968.
    """
    own, rest, front = _blocks(MOST_MISSING * complete - scores @ scores.T, n_poses)
    count = 0
    for mine, others in zip(own, rest, strict=True):
        mine += front[:3, :3]
        others[:, 3:] += front[:3, 3:]
        front[:3], front[:, :3] = 0.0, 0.0
        count += np.sum(np.linalg.eigvalsh(mine) <= 0)
        front -= others.T @ np.linalg.solve(mine, others)
    return int(count + np.sum(np.linalg.eigvalsh(front[3:, 3:]) <= 0))


def _blocks(info: sparse.csr_array, n_poses: int) -> tuple[np.ndarray, ...]:
    """The blocks of a chain's information that `information.eliminate` takes."""
    size = info.shape[0] - 3 * n_poses
    own, rest = np.zeros((n_poses, 3, 3)), np.zeros((n_poses, 3, 3 + size))
    front = np.zeros((3 + size, 3 + size))
    front[3:, 3:] = info[3 * n_poses :, 3 * n_poses :].toarray()
    entries = info[: 3 * n_poses].tocoo()
    t, i, column = entries.row // 3, entries.row % 3, entries.col
    border = column >= 3 * n_poses
    here, following = column // 3 == t, ~border & (column // 3 == t + 1)
    own[t[here], i[here], column[here] % 3] = entries.data[here]
    rest[t[following], i[following], column[following] % 3] = entries.data[following]
    rest[t[border], i[border], column[border] - 3 * n_poses + 3] = entries.data[border]
    return own, rest, front


def _pose_covariances(info: sparse.csr_array, n_poses: int) -> np.ndarray:
    """(T, 3, 3) diagonal blocks of the inverse of a chain's information, [m, m, rad], body frame.

    Raises
    ------
    ValueError : it is not positive definite
    """
    own, rest, front = _blocks(info, n_poses)
    failed = information.eliminate(own, rest, front, np.zeros_like(front)) >= 0
    joint = front[3:, 3:].copy()
    if failed or invert(joint) >= 0:
        raise ValueError("the information matrix is not positive definite: no covariance")
    front[3:, 3:] = joint
    information.substitute(own, rest, front, np.empty((max(n_poses - 2, 0), 3, 3)))
    return own


def _capped(complete, scores, n_above: int, n_poses: int) -> np.ndarray:
    """`_pose_covariances` of C - M, the share of M made `MOST_MISSING` in `n_above` directions.

    Those are few, but their vectors are dense, and C - M may be indefinite. So the terms of M
    that matter most to them are left out until the rest is sound, and come back by Woodbury's
    identity, together with what the cap adds.
    """
    shares, directions = linalg.eigsh(
        scores @ scores.T, n_above, complete, which="LA", v0=np.ones(complete.shape[0]),
        Minv=linalg.LinearOperator(complete.shape, linalg.splu(complete.tocsc()).solve),
    )  # fmt: skip
    order = np.argsort(-np.sum((scores.T @ directions) ** 2, axis=1))
    n = 2 * n_above
    while _n_above(complete, scores[:, order[n:]], n_poses):
        n *= 2
    out, kept = scores[:, order[:n]].toarray(), scores[:, order[n:]]
    sound = complete - kept @ kept.T
    update = np.hstack([out, complete @ directions])
    signs = np.append(np.full(out.shape[1], -1.0), np.maximum(shares - MOST_MISSING, 1e-12))
    solved = linalg.splu(sound.tocsc()).solve(update)
    middle = np.diag(1 / signs) + update.T @ solved
    blocks = solved[: 3 * n_poses].reshape(n_poses, 3, -1)
    turned = np.linalg.solve(middle, solved[: 3 * n_poses].T).T.reshape(blocks.shape)
    return _pose_covariances(sound, n_poses) - blocks @ turned.transpose(0, 2, 1)
