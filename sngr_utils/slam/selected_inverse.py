"""All window marginals at once: a selected inverse of the chain of poses and its landmarks.

The information matrix of a range-only graph is block tridiagonal in the poses, bordered by the
landmarks. Eliminating the poses in order leaves the landmarks; going back over the poses gives
the covariance blocks that the windows need, and nothing else. Time is O(T K^2), memory O(T K);
`gtsam.Marginals` is asked window by window.

Covariances follow GTSAM: a pose's tangent [x, y, theta] is in its own body frame.
"""

import warnings
from dataclasses import dataclass

import gtsam
import numpy as np

from sngr_utils.numerics.linalg import invert
from sngr_utils.slam.chain_problem import of_log
from sngr_utils.slam.conventions import Conventions
from sngr_utils.slam.information import (
    System,
    add_odometry,
    add_ranges,
    eliminate,
    empty_system,
    frames_of,
    substitute,
)
from sngr_utils.slam.solution import Solution
from sngr_utils.world import checks
from sngr_utils.world.log import LogWarning
from sngr_utils.world.simulation import World

UNDETERMINED = 1e12  # times its variance if all others were known: a variable that is left open


@dataclass(frozen=True)
class ChainCovariance:
    """Blocks of the covariance of a chain of T poses and K landmarks; NaN if a landmark is absent.

    Attributes
    ----------
    poses : (T, 3, 3) marginal of each pose, [m, m, rad] in its body frame
    first : (T-1, 3, 3) cross covariance of poses t (rows) and t+1
    second : (T-2, 3, 3) cross covariance of poses t (rows) and t+2
    pose_landmark : (T, 3, 2K) cross covariance of pose t (rows) and all landmarks, [m]
    landmarks : (2K, 2K) joint marginal of the landmarks, [m^2]
    """

    poses: np.ndarray
    first: np.ndarray
    second: np.ndarray
    pose_landmark: np.ndarray
    landmarks: np.ndarray

    @property
    def windows(self) -> np.ndarray:
        """(T-2, 9, 9) joint marginal Sigma_w of every window, [m, m, rad] per pose."""
        joint = np.empty((len(self.second), 9, 9))
        for i, start in enumerate((0, 3, 6)):
            stop = start + 3
            joint[:, start:stop, start:stop] = self.poses[i : len(self.poses) - 2 + i]
        for block, row, column in (
            (self.first[:-1], 0, 3), (self.first[1:], 3, 6), (self.second, 0, 6),
        ):  # fmt: skip
            joint[:, row : row + 3, column : column + 3] = block
            joint[:, column : column + 3, row : row + 3] = block.transpose(0, 2, 1)
        return joint


def eliminate_poses(system: System, n_landmarks: int) -> np.ndarray:
    """Eliminate the poses in place, see `information.eliminate`.

    Returns
    -------
    (B, B) covariance of the border: landmarks [m^2], range scale and offset

    Raises
    ------
    ValueError : naming a variable that the data leave open
    """
    alone = np.diagonal(system.front)[3:].copy()  # information of each column, all others known
    pose = eliminate(system.own, system.rest, system.front, system.lost)
    if pose >= 0:
        raise ValueError(f"pose {pose} is not determined: its information is not positive definite")
    joint = system.front[3:, 3:].copy()
    column = invert(joint)
    if column < 0 and len(joint):
        inflation = np.diagonal(joint) * alone
        column = np.argmax(inflation) if inflation.max() > UNDETERMINED else -1
    if column >= 0:
        landmark, last = column // 2, "the range scale or offset"
        name = f"landmark {landmark}" if landmark < n_landmarks else last
        raise ValueError(f"{name} is not determined by the ranges and its prior")
    return joint


def conclude(system: System, joint: np.ndarray, landmarks: np.ndarray) -> ChainCovariance:
    """The covariance blocks, from what `eliminate_poses` has left in `system`, which is used up.

    landmarks : (K, 2), NaN for one that is absent: so is its covariance
    """
    n_poses, size = len(system.own), landmarks.size
    second = np.empty((max(n_poses - 2, 0), 3, 3))
    system.front[3:, 3:] = joint  # the covariance takes the place of the information
    substitute(system.own, system.rest, system.front, second)
    absent = np.repeat(np.isnan(landmarks[:, 0]), 2)
    to_landmarks, joint = system.rest[:, :, 3 : 3 + size], joint[:size, :size].copy()
    to_landmarks[:, :, absent] = np.nan
    joint[absent], joint[:, absent] = np.nan, np.nan
    return ChainCovariance(system.own, system.rest[:-1, :, :3], second, to_landmarks, joint)


def covariance(solution: Solution, world: World, conventions: Conventions) -> ChainCovariance:
    """Covariance blocks of a solution, linearised at its estimate as GTSAM's marginals are.

    Parameters
    ----------
    world, conventions : what `solution` was computed from

    Raises
    ------
    ValueError : `solution` is not of this world (its factors are not as many)
    """
    landmarks = solution.landmarks
    present = np.isfinite(landmarks[:, 0])
    n_factors = world.n_poses + present.sum() + present[world.label_of].sum()
    if solution.graph.size() != n_factors:
        raise ValueError(
            f"solution has {solution.graph.size()} factors: this world makes {n_factors}"
        )
    poses = gtsam.utilities.extractPose2(solution.estimate)  # rows in the order of the keys
    return covariance_at(poses, landmarks, world, conventions)


def covariance_at(
    poses: np.ndarray, landmarks: np.ndarray, world: World, conventions: Conventions
) -> ChainCovariance:
    """Covariance blocks of a world's graph, linearised at poses and landmarks of any estimate.

    Parameters
    ----------
    poses, landmarks : (T, 3) and (K, 2), [m, m, rad] and [m]; NaN for a landmark that is absent
        from the graph, with all its ranges

    Raises
    ------
    ValueError : poses that are not finite, shapes that do not fit, or what no `Log` may have

    Source: the two passes are those of Rauch, Tung, Striebel, AIAA Journal 3, 1965, for a state
    with constant parameters; selected inversion in general: Takahashi, Fagan, Chen, 1973.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", LogWarning)  # a landmark may be absent
        log = world.log(conventions.x0_sigmas)
    frames = frames_of(checks.finite("poses", poses, (log.n_poses, 3)))
    landmarks = checks.floats("landmarks", landmarks, (log.n_landmarks, 2))
    chain = of_log(log, landmarks, conventions.landmark_prior_sigma)
    system = empty_system(log.n_poses, landmarks.size)
    system.front[3:, 3:] = np.eye(landmarks.size) / conventions.landmark_prior_sigma**2
    add_odometry(
        frames, chain.prior, chain.prior_information, chain.motions, chain.step_information,
        False, system,
    )  # fmt: skip
    residuals = np.zeros(len(chain.ranges))  # of no effect: nobody asks for the gradient
    add_ranges(
        frames, landmarks, 1.0, chain.columns, chain.pose_of, chain.landmark_of,
        chain.sigmas**-2, residuals, system,
    )  # fmt: skip
    return conclude(system, eliminate_poses(system, len(landmarks)), landmarks)


def window_covariances(solution: Solution, world: World, conventions: Conventions) -> np.ndarray:
    """(T-2, 9, 9) joint marginals of all windows: `windows.covariances`, in linear time."""
    return covariance(solution, world, conventions).windows
