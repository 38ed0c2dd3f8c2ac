"""A world made harder, or its prior honest: bursts, slips of the odometry, a drawn x0 prior.

Each takes a world and returns another; what is not named stays as it was.
"""

from dataclasses import replace

import numpy as np

from sngr_utils.world.dead_reckoning import dead_reckoning
from sngr_utils.world.simulation import World
from sngr_utils.world.wrong_associations import wrong_associations


def draw_x0(world: World, sigmas: list[float], *, rng: np.random.Generator) -> World:
    """The mean of the x0 prior drawn about the truth, as its sigmas say it is.

    The paper's prior is centred on the truth: it errs by nothing, which its sigmas deny, and a
    consistent estimator has a NEES below the number of coordinates. With this one it has 2.

    Parameters
    ----------
    sigmas : (3,) in the body frame, [m, m, rad]
    """
    noise = rng.normal(size=3) * sigmas
    return replace(world, x0_mean=dead_reckoning(world.poses[0], noise[None])[-1])


def burst(world: World, p: float, length: int, *, rng: np.random.Generator) -> World:
    """Wrong associations at `length` consecutive poses, beginning at a random one, with chance p.

    Outside the burst all labels are true. The place is uniform, so that it tells nothing of
    where the trajectory is held weakly.

    Parameters
    ----------
    p : probability that a range of the burst is attached to a wrong landmark, in [0, 1]
    length : poses, from 1 to T

    Raises
    ------
    ValueError : p or length out of range
    """
    if not 0 <= p <= 1:
        raise ValueError(f"p is {p!r}: a wrong-association probability lies in [0, 1]")
    if not 1 <= length <= world.n_poses:
        raise ValueError(f"length is {length!r}: a burst has from 1 to {world.n_poses} poses")
    first = rng.integers(world.n_poses - length + 1)
    inside = (world.pose_of >= first) & (world.pose_of < first + length)
    wrong = wrong_associations(world.source_of, world.n_landmarks, p, rng=rng)
    return replace(world, label_of=np.where(inside, wrong, world.source_of))


def slip(world: World, steps: int, sigma: float, *, rng: np.random.Generator) -> World:
    """Odometry that errs by N(0, sigma^2) more in x and y at `steps` consecutive steps.

    The estimator is not told. The place is uniform.

    Parameters
    ----------
    steps : from 1 to T-1
    sigma : per step and axis, [m]

    Raises
    ------
    ValueError : steps or sigma out of range
    """
    if not 1 <= steps <= len(world.odometry):
        raise ValueError(f"steps is {steps!r}: there are {len(world.odometry)}")
    if sigma < 0:
        raise ValueError(f"sigma is {sigma!r}: it must not be negative")
    first = rng.integers(len(world.odometry) - steps + 1)
    odometry = world.odometry.copy()
    odometry[first : first + steps, :2] += rng.normal(size=(steps, 2)) * sigma
    return replace(world, odometry=odometry)
