"""Driver of notebook 07: what a wrong association does, and every method that doubts it."""

from dataclasses import dataclass
from typing import Annotated

import gtsam
import numpy as np
import pandas as pd
from pydantic import Field, model_validator
from scipy import stats

from sngr_utils.experiments import estimators
from sngr_utils.robust import (
    association,
    em,
    fastslam,
    graduated_non_convexity,
    max_mixtures,
    switchable_constraints,
)
from sngr_utils.robust.losses import GNC_SQUARED
from sngr_utils.settings import READING, Probability, Seed
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world import simulation
from sngr_utils.world.scenario import ManyWorlds, Scenario

Levels = Annotated[list[Probability], Field(min_length=1)]
BEST = "em_exclusive"  # what the others are tested against
N_RIGHT, N_WRONG, WRONG_BY = 7, 3, 1.0  # ranges of the first example, and an error of [m]


class Config(ManyWorlds):
    """Parameters of the comparison. Worlds are those of seeds first_seed, first_seed + 1, ...

    n_seeds : worlds
    p_levels : shares of wrong associations
    p_starts : levels, among p_levels, at which the starts are compared
    n_particles : of FastSLAM
    """

    first_seed: Seed = 6000
    n_seeds: Annotated[int, Field(ge=2)] = 15
    p_levels: Levels = [0.0, 0.2, 0.4]
    p_starts: Levels = [0.4]
    n_particles: Annotated[int, Field(ge=2)] = 300

    @model_validator(mode="after")
    def _consistent(self):
        if len(set(self.p_levels)) < len(self.p_levels):
            raise ValueError(f"p_levels is {self.p_levels}: it must not repeat a value")
        if max(self.p_levels) == 0:
            raise ValueError("p_levels is [0.0]: nothing there to doubt")
        if not set(self.p_starts) <= set(self.p_levels):
            raise ValueError(f"p_starts is {self.p_starts}: all must be among p_levels")
        return self


def run(config: Config) -> pd.DataFrame:
    """All methods on all worlds from the grid; at `p_starts` from the first poses too.

    Returns
    -------
    the table of `estimators.compare` with the column ratio, see `relative_to_oracle`
    """
    particles = fastslam.Settings(n_particles=config.n_particles)
    by_start = {"grid": config.p_levels, "first_poses": config.p_starts}
    started = [name for name in estimators.METHODS if name not in estimators.WITHOUT_START]
    methods = {"grid": list(estimators.METHODS), "first_poses": started}
    seeds = config.seeds(config.n_seeds)
    tables = [
        estimators.compare(
            config.scenario, PRESETS[READING], levels, seeds, methods[start],
            [start], particles, config.jobs,
        )
        for start, levels in by_start.items()
    ]  # fmt: skip
    return estimators.relative_to_oracle(pd.concat(tables, ignore_index=True))


def kernels(residuals: np.ndarray, scenario: Scenario) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Loss [nats] and weight of a whitened residual, method -> two (N,) arrays.

    The weight is that of the range in the least-squares problem whose minimum is the same.
    GTSAM's own, where it has them; the null hypothesis is as wide as the landmarks' square.
    """
    estimators_of = gtsam.noiseModel.mEstimator
    losses = {
        "huber": estimators_of.Huber.Create(graduated_non_convexity.HUBER_K),
        "cauchy": estimators_of.Cauchy.Create(graduated_non_convexity.CAUCHY_K),
        "dcs": estimators_of.DCS.Create(graduated_non_convexity.DCS_PHI),
        "geman_mcclure": estimators_of.GemanMcClure.Create(graduated_non_convexity.GEMAN_MCCLURE_C),
        "switchable": estimators_of.GemanMcClure.Create(1 / switchable_constraints.SWITCH_SIGMA),
    }
    square = 0.5 * residuals**2
    found = {"least_squares": (square, np.ones(len(residuals)))}
    for name, loss in losses.items():
        found[name] = tuple(np.array([f(r) for r in residuals]) for f in (loss.loss, loss.weight))
    inside = residuals**2 < GNC_SQUARED
    found["gnc_tls"] = np.minimum(square, GNC_SQUARED / 2), inside.astype(float)
    ratio = scenario.landmark_half_width / scenario.range_sigma
    null = square / ratio**2 + np.log(ratio)
    found["max_mixture_null"] = np.minimum(square, null), np.where(square < null, 1, ratio**-2)
    return found


def pull(config: Config, distances: np.ndarray) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Ten ranges to a landmark 3 m away, three of them another one's, and the cost of a distance.

    The ranges are quantiles of their law, so that nothing here is random.

    Returns
    -------
    ranges : (10,) [m], the wrong ones last
    costs : method -> (N,) total loss at the (N,) distances, over its range, in [0, 1]
    """
    quantiles = stats.norm.ppf((np.arange(N_RIGHT) + 0.5) / N_RIGHT)
    ranges = 3 + config.range_sigma * quantiles
    ranges = np.append(ranges, np.median(ranges) + WRONG_BY + config.range_sigma * quantiles[2:5])
    residuals = (ranges[:, None] - distances) / config.range_sigma
    costs = {}
    for name, (loss, _) in kernels(residuals.ravel(), config.scenario).items():
        total = loss.reshape(residuals.shape).sum(axis=0)
        costs[name] = (total - total.min()) / np.ptp(total)
    return ranges, costs


@dataclass(frozen=True)
class Ambiguous:
    """One range that several landmarks explain.

    Attributes
    ----------
    position : (2,) where it was taken, estimated, [m]
    landmarks : (K, 2) estimated, [m]
    distance : the range, [m]
    label, source : landmark it is attached to, and came from
    beliefs : name -> (K,) how much of the range each landmark gets
    """

    position: np.ndarray
    landmarks: np.ndarray
    distance: float
    label: int
    source: int
    beliefs: dict[str, np.ndarray]


def ambiguous(config: Config) -> Ambiguous:
    """The range of the first world whose source EM is least sure of, as each mixture sees it."""
    p, conventions = config.p_starts[0], PRESETS[READING]
    the_world = simulation.simulate(
        config.scenario, p, rng=np.random.default_rng(config.first_seed)
    )
    found = em.estimate(the_world, conventions, "grid", exclusive=False)
    at = the_world, found.poses, found.landmarks
    alone, scan = (
        association.responsibilities(*at, found.p, 1.0, exclusive)[:, :-1]
        for exclusive in (False, True)
    )
    m = int(np.argmax(stats.entropy(alone, axis=1)))
    best, _ = max_mixtures.choose_landmark(*at)
    prior = np.exp(association.log_prior(the_world.label_of, the_world.n_landmarks, found.p))
    hard = np.eye(the_world.n_landmarks)
    beliefs = {
        "label": hard[the_world.label_of[m]], "prior": prior[m],
        "max_mixture_all": hard[best[m]], "em": alone[m], "em_exclusive": scan[m],
    }  # fmt: skip
    return Ambiguous(
        found.poses[the_world.pose_of[m], :2], found.landmarks, float(the_world.ranges[m]),
        int(the_world.label_of[m]), int(the_world.source_of[m]), beliefs,
    )  # fmt: skip
