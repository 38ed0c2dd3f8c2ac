"""The scenario's numbers (section "Experimental set-up"), for one world and for many."""

from typing import Annotated

import numpy as np
from pydantic import Field

from sngr_utils.settings import Checked, Positive, Seed


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
