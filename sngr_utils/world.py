"""The simulated world: a robot on a circle, landmarks, odometry, ranges, wrong associations.

NumPy only. Nothing here knows about estimation.
"""

from dataclasses import dataclass, replace
from typing import Annotated, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

Positive = Annotated[float, Field(gt=0)]
Probability = Annotated[float, Field(ge=0, le=1)]
Seed = Annotated[int, Field(ge=0)]


class Checked(BaseModel):
    """Base of all parameter sets: frozen, strictly typed, no unknown names, no NaN.

    A value out of range raises `pydantic.ValidationError` (a ValueError) that names the
    parameter, the value and what is allowed.
    """

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", allow_inf_nan=False, validate_default=True
    )

    @classmethod
    def pick(cls, names: dict[str, object]) -> Self:
        """The set whose fields are looked up in `names`, e.g. a notebook's ``globals()``."""
        return cls(**{field: names[field] for field in cls.model_fields})

    def part(self, model: type["Checked"]) -> "Checked":
        """The fields of this set that `model` declares, as a `model`."""
        return model(**{name: getattr(self, name) for name in model.model_fields})


class Scenario(Checked):
    """The paper's scenario (section "Experimental set-up"); the defaults are its values."""

    n_poses: Annotated[int, Field(ge=3)] = 30
    radius: Positive = 5.0  # m
    n_landmarks: Annotated[int, Field(ge=2)] = 6
    landmark_half_width: Positive = 4.0  # m, landmarks are uniform in a square of twice this
    odometry_sigma_xy: Positive = 0.05  # m per step
    odometry_sigma_theta: Positive = 0.01  # rad per step
    range_sigma: Positive = 0.1  # m

    @property
    def odometry_sigmas(self) -> np.ndarray:
        """(3,) per step, [m, m, rad]"""
        return np.array([self.odometry_sigma_xy, self.odometry_sigma_xy, self.odometry_sigma_theta])


class ManyWorlds(Scenario):
    """The scenario of a study over the worlds of seeds first_seed, first_seed + 1, ...

    jobs : processes; results do not depend on it
    """

    first_seed: Seed = 0
    jobs: Annotated[int, Field(ge=1)] = 1

    @property
    def scenario(self) -> Scenario:
        return self.part(Scenario)

    def seeds(self, n: int) -> list[int]:
        """Seeds of the first n worlds."""
        return list(range(self.first_seed, self.first_seed + n))


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
    source_of : (M,) int, landmark each range truly came from
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


def wrap_angle(angle: np.ndarray) -> np.ndarray:
    """Angle in [-pi, pi), [rad]."""
    return (angle + np.pi) % (2 * np.pi) - np.pi


def relative_motion(poses: np.ndarray) -> np.ndarray:
    """(T-1, 3) motion between consecutive poses, in the body frame of the first of each pair."""
    step = np.diff(poses, axis=0)
    cos, sin = np.cos(poses[:-1, 2]), np.sin(poses[:-1, 2])
    dx = cos * step[:, 0] + sin * step[:, 1]
    dy = -sin * step[:, 0] + cos * step[:, 1]
    return np.column_stack([dx, dy, wrap_angle(step[:, 2])])


def dead_reckoning(start: np.ndarray, odometry: np.ndarray) -> np.ndarray:
    """(T, 3) poses that the measured odometry alone leads to from the pose `start`."""
    poses = [np.asarray(start, dtype=float)]
    for dx, dy, dtheta in odometry:
        x, y, theta = poses[-1]
        cos, sin = np.cos(theta), np.sin(theta)
        poses.append(np.array([x + cos * dx - sin * dy, y + sin * dx + cos * dy, theta + dtheta]))
    poses = np.array(poses)
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def dead_reckoning_variances(poses: np.ndarray, scenario: Scenario) -> np.ndarray:
    """(T,) variance of each dead-reckoned position about the first pose, [m^2], mean of x and y.

    To first order: every step adds its own variance, and its heading error turns all that
    follows about its end. What is turned moves across the line between the two places, so half
    of that goes to each axis on average.

    Parameters
    ----------
    poses : (T, 3), [m, m, rad]
    """
    offsets = np.linalg.norm(poses[:, None, :2] - poses[None, 1:, :2], axis=2)
    earlier = np.arange(len(poses))[:, None] >= np.arange(1, len(poses))
    turned = 0.5 * scenario.odometry_sigma_theta**2 * np.sum(offsets**2 * earlier, axis=1)
    return np.arange(len(poses)) * scenario.odometry_sigma_xy**2 + turned


def rigid_covariances(poses: np.ndarray, x0_sigmas: list[float]) -> np.ndarray:
    """(T, 2, 2) covariance of positions that move rigidly with the first pose, [m^2].

    Parameters
    ----------
    poses : (T, 3), [m, m, rad]
    x0_sigmas : (3,) of the first pose in its body frame, [m, m, rad]
    """
    cos, sin = np.cos(poses[0, 2]), np.sin(poses[0, 2])
    by_x0 = np.zeros((len(poses), 2, 3))
    by_x0[:, :, :2] = [[cos, -sin], [sin, cos]]
    by_x0[:, 0, 2], by_x0[:, 1, 2] = -(poses - poses[0])[:, 1], (poses - poses[0])[:, 0]
    scaled = by_x0 * np.asarray(x0_sigmas)
    return scaled @ scaled.transpose(0, 2, 1)


def wrong_associations(
    true_labels: np.ndarray, n_landmarks: int, p: float, *, rng: np.random.Generator
) -> np.ndarray:
    """Attach each measurement, with probability p, to a uniformly drawn *other* landmark.

    The draws do not depend on p, so the wrong set at a smaller p is a subset of the wrong set
    at a larger one (common random numbers along a sweep).

    Parameters
    ----------
    true_labels : (M,) int, landmark each measurement came from
    n_landmarks : number of landmarks, at least 2
    p : probability of a wrong association

    Returns
    -------
    (M,) int labels
    """
    uniform = rng.random(len(true_labels))
    shift = rng.integers(1, n_landmarks, size=len(true_labels))
    return np.where(uniform < p, (true_labels + shift) % n_landmarks, true_labels)


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
    noise = rng.normal(size=(s.n_poses - 1, 3)) * s.odometry_sigmas
    odometry = relative_motion(poses) + noise
    distance = np.linalg.norm(poses[:, None, :2] - landmarks[None], axis=2)
    ranges = distance + rng.normal(size=distance.shape) * s.range_sigma
    pose_of, source_of = (index.ravel() for index in np.indices(distance.shape))
    label_of = wrong_associations(source_of, s.n_landmarks, p, rng=association_rng)
    return World(
        poses, landmarks, odometry, pose_of, label_of, source_of, ranges.ravel(), s, poses[0]
    )
