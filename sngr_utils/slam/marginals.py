"""Marginal covariances of poses, by GTSAM."""

import gtsam
import numpy as np
from gtsam.symbol_shorthand import X

from sngr_utils.slam import indeterminate, information
from sngr_utils.slam.solution import Solution


def gtsam_marginals(solution: Solution) -> gtsam.Marginals:
    """Marginals of the whole graph, linearised at the MAP estimate.

    iSAM2's own marginals are linearised where it last relinearised, so they differ a little.

    Raises
    ------
    ValueError : a landmark or pose that the data leave open, with its ranges
    """
    with indeterminate.named(solution.graph, solution.estimate):
        return gtsam.Marginals(solution.graph, solution.estimate)


def joint_covariance(marginals: gtsam.Marginals, keys: list[int]) -> np.ndarray:
    """Joint marginal covariance of `keys`, blocks in the order asked for.

    Parameters
    ----------
    keys : n variable keys, e.g. ``[X(0), X(1), X(2)]``

    Returns
    -------
    (D, D), D the summed dimension; body-frame tangent [m, m, rad] per pose, [m, m] per landmark

    GTSAM sorts the blocks of its full matrix by key; reading it with ``at(i, j)`` keeps ours.
    """
    joint = marginals.jointMarginalCovariance(keys)
    if keys == sorted(keys):
        return joint.fullMatrix()
    return np.block([[joint.at(i, j) for j in keys] for i in keys])


def position_covariances(solution: Solution, frame: str) -> np.ndarray:
    """(T, 2, 2) marginal covariance of each position, [m^2], in the "world" or "body" frame."""
    all_marginals, poses = gtsam_marginals(solution), range(solution.n_poses)
    blocks = np.array([all_marginals.marginalCovariance(X(t))[:2, :2] for t in poses])
    return blocks if frame == "body" else in_world_frame(blocks, solution)


def in_world_frame(blocks: np.ndarray, solution: Solution) -> np.ndarray:
    """(T, 2, 2) covariances of the positions of a solution, from those in the poses' own frames."""
    turned = [solution.estimate.atPose2(X(t)).rotation() for t in range(solution.n_poses)]
    cos, sin = np.array([(rotation.c(), rotation.s()) for rotation in turned]).T
    return information.in_world_frame(blocks, cos, sin)
