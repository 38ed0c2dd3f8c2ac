"""The scenario's numbers (section "Experimental set-up"), for one world and for many."""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sngr_utils.settings import Checked, Seed

Length = Annotated[float, Field(ge=1e-4, le=1e4)]  # m
Sigma = Annotated[float, Field(ge=1e-4, le=3)]  # m; of a scene of five, more says nothing
SPAN = 1e4  # of the largest length to the smallest: their squares meet in one linear system


class Scenario(Checked):
    """The paper's scenario (section "Experimental set-up"); the defaults are its values."""

    n_poses: Annotated[int, Field(ge=3)] = 30
    radius: Length = 5.0  # m
    n_landmarks: Annotated[int, Field(ge=2)] = 6
    landmark_half_width: Length = 4.0  # m, landmarks are uniform in a square of twice this
    odometry_sigma_xy: Sigma = 0.05  # m per step
    odometry_sigma_theta: Annotated[float, Field(ge=1e-4, le=1)] = 0.01  # rad per step
    range_sigma: Sigma = 0.1  # m

    @model_validator(mode="after")
    def _lengths_meet(self) -> Self:
        names = ("radius", "landmark_half_width", "odometry_sigma_xy", "range_sigma")
        least, *_, most = sorted(names, key=lambda name: getattr(self, name))
        low, high = getattr(self, least), getattr(self, most)
        if high > SPAN * low:
            raise ValueError(f"{most} is {high} and {least} {low}: they may span {SPAN:g} at most")
        return self

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
