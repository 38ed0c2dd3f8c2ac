"""Covariance of positions after their rigid alignment with the truth.

The prior on the first pose only holds the frame. An alignment takes the frame from the path
itself, and what all positions err by together is then no error.
"""

import numpy as np

from sngr_utils.slam import chain_cost, chain_solver, damped_step
from sngr_utils.slam.chain_problem import Chain
from sngr_utils.slam.range_loss import LEAST_SQUARES


def aligned_covariances(
    chain: Chain,
    at: chain_solver.State,
    covariances: np.ndarray,
    chosen: np.ndarray,
    missed: np.ndarray,
) -> np.ndarray:
    """(N, 2, 2) covariance of the chosen positions once they are aligned, world frame, [m^2].

    Parameters
    ----------
    chain, at : the problem and its minimum
    covariances : (T, 2, 2) of all positions before, world frame, [m^2]
    chosen : (N,) int, poses that are aligned
    missed : (Q, T, 3) moves of the poses by what else is open, see `missed_steps`
    """
    places = at.frames[chosen, :2]
    arms = places - places.mean(axis=0)
    across = np.column_stack([-arms[:, 1], arms[:, 0]])
    shifted = np.broadcast_to(np.eye(2), (len(chosen), 2, 2))
    moves = np.dstack([shifted, across[:, :, None]])  # of positions, by a shift and a turn
    total = np.array([len(chosen), len(chosen), np.sum(arms**2)])
    fitted = moves / total  # a shift and a turn, by positions
    cos, sin = at.frames[chosen, 2], at.frames[chosen, 3]
    to_world = np.moveaxis(np.array([[cos, -sin], [sin, cos]]), 2, 0)
    chain_cost.cost(chain, LEAST_SQUARES, at)
    system = chain_cost.linearise(chain, LEAST_SQUARES, at)
    shared = np.empty_like(moves)  # covariance of a position with the shift and the turn
    steps, border = np.empty((len(at.frames), 3)), np.empty(len(system.pull))
    system.pull[:] = 0.0
    for j in range(3):
        system.slope[:] = 0.0
        system.slope[chosen, :2] = -np.einsum("nji,nj->ni", to_world, fitted[:, :, j])
        damped_step.solve(system, 0.0, False, steps, border)
        shared[:, :, j] = np.einsum("nij,nj->ni", to_world, steps[chosen, :2])
    rigid = np.einsum("nij,nik->jk", fitted, shared)
    crossed = shared @ moves.swapaxes(1, 2)
    moved = to_world @ missed[:, chosen, :2, None]
    moved -= moves @ np.einsum("nij,qnik->qjk", fitted, moved)[:, None]
    return (
        covariances[chosen]
        - crossed
        - crossed.swapaxes(1, 2)
        + moves @ rigid @ moves.swapaxes(1, 2)
        + np.einsum("qnik,qnjk->nij", moved, moved)
    )
