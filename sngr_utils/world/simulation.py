"""The simulated world: a robot on a circle, landmarks, odometry, ranges, wrong associations.

NumPy only. Nothing here knows about estimation.
"""

from dataclasses import dataclass, replace

import numpy as np

from sngr_utils.world.dead_reckoning import relative_motion, wrap_angle
from sngr_utils.world.log import Log
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.wrong_associations import wrong_associations


@dataclass(frozen=True)
class World:
    """What the robot lived through. M is the number of range measurements.

    Attributes
    ----------
    poses : (T, 3) true poses, [m, m, rad]
    landmarks : (K, 2) true positions, [m]
    odometry : (T-1, 3) measured motion from pose t to t+1 in the body frame of t, [m, m, rad]
    pose_of : (M,) int, pose index of each range, ascending
    label_of : (M,) int, landmark each range is *attached to* (possibly wrong)
    source_of : (M,) int, landmark each range truly came from, -1 for none (clutter)
    ranges : (M,) measured ranges, [m]
    scenario : Scenario, the noise levels the estimator is told
    x0_mean : (3,) where the estimator's prior on the first pose is centred, [m, m, rad]; the
        paper's is the true pose (`variations.draw_x0` draws it)

    An estimator reads none of `poses`, `landmarks`, `source_of`: they are for judging it.
    """

    poses: np.ndarray
    landmarks: np.ndarray
    odometry: np.ndarray
    pose_of: np.ndarray
    label_of: np.ndarray
    source_of: np.ndarray
    ranges: np.ndarray
    scenario: Scenario
    x0_mean: np.ndarray

    @property
    def n_poses(self) -> int:
        return len(self.poses)

    @property
    def n_landmarks(self) -> int:
        return len(self.landmarks)

    def log(self, x0_sigmas: list[float]) -> Log:
        """What an estimator may know of it, with the prior on the first pose [m, m, rad]."""
        return Log(
            odometry=self.odometry,
            odometry_covariances=np.diag(self.scenario.odometry_sigmas**2),
            pose_of=self.pose_of,
            ranges=self.ranges,
            range_sigmas=self.scenario.range_sigma,
            label_of=self.label_of,
            n_landmarks=self.n_landmarks,
            x0_mean=self.x0_mean,
            x0_sigmas=x0_sigmas,
        )

    def keep(self, marked: np.ndarray) -> "World":
        """The same world with the (M,) marked ranges only."""
        names = ("pose_of", "label_of", "source_of", "ranges")
        return replace(self, **{name: getattr(self, name)[marked] for name in names})

    def first(self, n: int) -> "World":
        """The first n poses, with their odometry and ranges."""
        part = self.keep(self.pose_of < n)
        return replace(part, poses=self.poses[:n], odometry=self.odometry[: n - 1])


def circle_poses(n_poses: int, radius: float) -> np.ndarray:
    """(T, 3) poses evenly spaced on a circle about the origin, heading along the tangent."""
    angle = 2 * np.pi * np.arange(n_poses) / n_poses
    heading = wrap_angle(angle + np.pi / 2)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle), heading])


def simulate(scenario: Scenario, p: float, *, rng: np.random.Generator) -> World:
    """Draw one world: landmarks, then odometry noise, then range noise, in that order.

    Wrong associations come from a child stream of `rng` of their own, so p changes the
    associations and nothing else.

    Parameters
    ----------
    p : probability that a range is attached to the wrong landmark, in [0, 1]
    rng : a fresh generator, `numpy.random.default_rng(seed)` for the paper's seeds

    Raises
    ------
    ValueError : p outside [0, 1]

    Source: paper, section "Experimental set-up".
    """
    if not 0 <= p <= 1:
        raise ValueError(f"p is {p!r}: a wrong-association probability lies in [0, 1]")
    (association_rng,) = rng.spawn(1)
    s = scenario
    poses = circle_poses(s.n_poses, s.radius)
    landmarks = rng.uniform(-s.landmark_half_width, s.landmark_half_width, (s.n_landmarks, 2))
    return measure(poses, landmarks, s, p, rng=rng, association_rng=association_rng)


def measure(
    poses: np.ndarray,
    landmarks: np.ndarray,
    scenario: Scenario,
    p: float,
    *,
    rng: np.random.Generator,
    association_rng: np.random.Generator,
) -> World:
    """Odometry along (T, 3) poses, and a range from each of them to each of (K, 2) landmarks.

    Parameters
    ----------
    p : probability that a range is attached to the wrong landmark
    association_rng : draws wrong associations, and nothing else does
    """
    noise = rng.normal(size=(len(poses) - 1, 3)) * scenario.odometry_sigmas
    odometry = relative_motion(poses) + noise
    distance = np.linalg.norm(poses[:, None, :2] - landmarks[None], axis=2)
    ranges = distance + rng.normal(size=distance.shape) * scenario.range_sigma
    pose_of, source_of = (index.ravel() for index in np.indices(distance.shape))
    label_of = wrong_associations(source_of, len(landmarks), p, rng=association_rng)
    return World(
        poses, landmarks, odometry, pose_of, label_of, source_of, ranges.ravel(), scenario,
        poses[0],
    )  # fmt: skip
