"""Rao-Blackwellised particle filter: FastSLAM for ranges whose landmarks are in doubt.

A particle is one path of the robot and one list of decisions which landmark each range came from.
Given both, landmarks are independent of each other, and each has a filter of its own in every
particle: a few weighted Gaussians, since ranges from few poses leave mirror images. `particles`
has the loops.

The x0 prior needs no particles: with odometry and ranges only, moving it moves everything
rigidly. All particles start at its mean, and its covariance is added to their spread.
"""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
from pydantic import Field

from sngr_utils.robust import particles
from sngr_utils.settings import Checked, Probability
from sngr_utils.slam import landmark_starts
from sngr_utils.slam.conventions import Conventions
from sngr_utils.world import dead_reckoning, simulation


class Settings(Checked):
    """n_particles : paths, each with its own landmarks and associations
    start_after : distinct poses that must have seen a landmark before it is started
    n_hypotheses : Gaussians per landmark and particle
    resample_below : effective sample size, as a share of the particles, that calls for
        resampling
    """

    n_particles: Annotated[int, Field(ge=2)] = 300
    start_after: Annotated[int, Field(ge=landmark_starts.START_AFTER)] = 8
    n_hypotheses: Annotated[int, Field(ge=1)] = 4
    resample_below: Probability = 0.5


@dataclass(frozen=True)
class Particles:
    """The particles after the last pose. N particles, T poses, K landmarks.

    Attributes
    ----------
    paths : (N, T, 3), [m, m, rad]: every particle's own history
    weights : (N,), of sum 1
    landmarks : (N, K, 2) each particle's likeliest hypothesis, [m]; NaN where none was started
    wrong : (N,) share of its ranges that a particle credits to another landmark than their label
    """

    paths: np.ndarray
    weights: np.ndarray
    landmarks: np.ndarray
    wrong: np.ndarray

    @property
    def poses(self) -> np.ndarray:
        """(T, 3) weighted mean of the histories, [m, m, rad]: smoothed, not causal"""
        positions = np.einsum("n,ntd->td", self.weights, self.paths[:, :, :2])
        turned = np.einsum("n,nt->t", self.weights, np.exp(1j * self.paths[:, :, 2]))
        return np.column_stack([positions, np.angle(turned)])

    @property
    def mean_landmarks(self) -> np.ndarray:
        """(K, 2) weighted mean over the particles, [m]"""
        return np.einsum("n,nkd->kd", self.weights, self.landmarks)

    def position_covariances(self, x0_sigmas: list[float]) -> np.ndarray:
        """(T, 2, 2) spread of the histories, and what the x0 prior leaves open, world, [m^2].

        Resampling leaves few distinct histories of early poses: their spread is too small.

        Parameters
        ----------
        x0_sigmas : (3,) in the body frame, [m, m, rad]
        """
        poses = self.poses
        deviations = self.paths[:, :, :2] - poses[:, :2]
        spread = np.einsum("n,nti,ntj->tij", self.weights, deviations, deviations)
        return spread + dead_reckoning.rigid_covariances(poses, x0_sigmas)


def run(
    the_world: simulation.World,
    conventions: Conventions,
    settings: Settings,
    *,
    rng: np.random.Generator,
) -> Particles:
    """Filter the world pose by pose with odometry as the proposal.

    The share of wrong labels is unknown to it: each particle counts its own, from a uniform
    prior. A range weighs a particle by its probability over all landmarks, and is then credited
    to one of them, drawn from their posterior.

    Source: Montemerlo, Thrun, FastSLAM, 2007, chapters 3 and 4; landmarks of ranges as sums of
    Gaussians: Blanco, Fernandez-Madrigal, Gonzalez, IROS 2008.
    """
    s = the_world.scenario
    setup = particles.Setup(
        s.odometry_sigmas,
        s.range_sigma,
        conventions.landmark_prior_sigma,
        float(the_world.ranges.max()),
        settings.start_after,
        settings.resample_below * settings.n_particles,
    )
    n, k, h = settings.n_particles, the_world.n_landmarks, settings.n_hypotheses
    state = particles.empty(n, the_world.n_poses, k, h)
    state.paths[:, 0] = the_world.x0_mean
    particles.run(
        setup, state, the_world.odometry, the_world.pose_of, the_world.label_of,
        the_world.ranges, rng,
    )  # fmt: skip
    weights = np.exp(state.log_weights - state.log_weights.max())
    likeliest = np.argmax(state.shares, axis=2)[:, :, None, None]
    landmarks = np.take_along_axis(state.means, likeliest, axis=2)[:, :, 0]
    wrong = state.counts[:, 1] / np.maximum(state.counts.sum(axis=1), 1)
    return Particles(state.paths, weights / weights.sum(), landmarks, wrong)
