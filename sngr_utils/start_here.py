"""What notebook 00 works on: five places, two landmarks, six ranges, and one wrong label.

The notebook computes in its own cells, with NumPy; this only draws the data.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sngr_utils.settings import Checked, Seed

Sigma = Annotated[float, Field(ge=1e-3, le=10)]  # m, of a scene of eight metres
POSES = np.array([[0.0, 0.0], [2.0, 0.3], [4.0, 0.4], [6.0, 0.3], [8.0, 0.0]])  # m
LANDMARKS = np.array([[1.0, 2.5], [7.0, 2.5]])  # m
SEEN = [(0, 0), (1, 0), (2, 0), (2, 1), (3, 1), (4, 1)]  # which pose measures which landmark


class Config(Checked):
    """Parameters of the first chapter. Lengths in m.

    start_sigma : standard deviation of what is known of the first place
    prior_sigma : standard deviation of the guess about one place that the grid starts from
    grid_step : between two cells of the grid, whose number grows with its inverse square
    wrong : which of the six ranges is credited to the other landmark
    """

    seed: Seed = 1
    start_sigma: Sigma = 0.05
    odometry_sigma: Sigma = 0.1
    range_sigma: Sigma = 0.2
    prior_sigma: Sigma = 2.0
    grid_step: Annotated[float, Field(ge=0.005, le=0.2)] = 0.05
    wrong: Annotated[int, Field(ge=0, lt=len(SEEN))] = 5

    @model_validator(mode="after")
    def _grid_sees_the_guess(self) -> Self:
        if self.prior_sigma < self.grid_step:
            raise ValueError(f"prior_sigma is {self.prior_sigma}: the grid's step is longer")
        return self

    def draw(self) -> Drive:
        """A drive with right labels."""
        rng = np.random.default_rng(self.seed)
        odometry = np.diff(POSES, axis=0) + rng.normal(0, self.odometry_sigma, (len(POSES) - 1, 2))
        pose_of, label_of = np.array(SEEN).T
        distances = np.linalg.norm(POSES[pose_of] - LANDMARKS[label_of], axis=1)
        ranges = distances + rng.normal(0, self.range_sigma, len(SEEN))
        return Drive(odometry, ranges, pose_of, label_of)


@dataclass(frozen=True)
class Drive:
    """What the robot measured on its way past two landmarks.

    Attributes
    ----------
    odometry : (4, 2) measured motion from each place to the next, [m]
    ranges : (6,) measured distances, [m]
    pose_of, label_of : (6,) int, from which place, and to which landmark as far as is known
    """

    odometry: np.ndarray
    ranges: np.ndarray
    pose_of: np.ndarray
    label_of: np.ndarray

    @property
    def dead_reckoning(self) -> np.ndarray:
        """(5, 2) the odometry added up from the first place, [m]"""
        return np.vstack([POSES[:1], POSES[0] + np.cumsum(self.odometry, axis=0)])

    @property
    def factors(self) -> list[tuple[str, ...]]:
        """Names of the variables of each factor: the prior, the odometry, then the ranges."""
        steps = [(f"x{t}", f"x{t + 1}") for t in range(len(self.odometry))]
        pairs = zip(self.pose_of, self.label_of, strict=True)
        return [("x0",), *steps, *((f"x{t}", f"l{k + 1}") for t, k in pairs)]

    def credited_wrongly(self, number: int) -> Drive:
        """The same measurements, one range credited to the other landmark."""
        label_of = self.label_of.copy()
        label_of[number] = 1 - label_of[number]
        return replace(self, label_of=label_of)


def places() -> dict[str, np.ndarray]:
    """Where each variable truly is: name -> (2,), [m]"""
    named = {f"x{t}": place for t, place in enumerate(POSES)}
    return named | {f"l{k + 1}": place for k, place in enumerate(LANDMARKS)}
