"""Driver of notebook 09: where a posterior has several places, who notices, who samples them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from sngr_utils.settings import Distinct, Positive, Seed
from sngr_utils.world.scenario import ManyWorlds

# What runs is imported where it runs: a check of all parameters needs no GTSAM and no compiler.
if TYPE_CHECKING:
    import pandas as pd

    from sngr_utils.experiments.multimodality import View, WindowKind
    from sngr_utils.sampling.targets.landmark import Landmark

Counts = Annotated[list[Annotated[int, Field(ge=1)]], Field(min_length=1), Distinct]
Poses = Annotated[list[Annotated[int, Field(ge=2)]], Field(min_length=1), Distinct]


class Config(ManyWorlds):
    """Parameters of the study. Worlds are those of seeds first_seed, first_seed + 1, ...

    n_seeds : worlds
    poses_seen : numbers of poses after which a landmark is looked at
    poses_sampled : those after which samplers are compared
    n_sampled : worlds whose windows are sampled, the costly part
    p : probability of a wrong association in the windows
    weak : factor on the odometry's sigmas in the windows
    ranges_per_pose : numbers of ranges that each pose of a window keeps
    kl_limit : divergence of one Gaussian above which it is called wrong, [nats]
    gap_limit : the mirror test fires if the gap is below this, [nats]; 3 is an image of 5 % mass
    tau : threshold of the paper's score
    n_live_landmark, n_live_window : live points
    n_particles : of each of ten filters, more where their evidences or masses do not agree
    """

    n_poses: Annotated[int, Field(ge=6)] = 30  # the first figure looks after six
    first_seed: Seed = 6000
    n_seeds: Annotated[int, Field(ge=2)] = 10
    poses_seen: Poses = [2, 3, 4, 5, 6, 8]
    poses_sampled: Poses = [2, 3, 8]
    n_sampled: Annotated[int, Field(ge=2)] = 4
    p: Annotated[float, Field(ge=0, lt=1)] = 0.4
    weak: Annotated[float, Field(ge=0.01, le=100)] = 10.0
    ranges_per_pose: Counts = [1, 2, 3, 6]
    kl_limit: Positive = 1.0
    gap_limit: Positive = 3.0
    tau: Positive = 3.96
    n_live_landmark: Annotated[int, Field(ge=20)] = 600
    n_live_window: Annotated[int, Field(ge=20)] = 500
    n_particles: Annotated[int, Field(ge=100)] = 6_000

    @model_validator(mode="after")
    def _consistent(self):
        if max(self.poses_seen + self.poses_sampled) > self.n_poses:
            raise ValueError(f"poses_seen is {self.poses_seen}: there are {self.n_poses} poses")
        if max(self.ranges_per_pose) > self.n_landmarks:
            raise ValueError(
                f"ranges_per_pose is {self.ranges_per_pose}: a pose sees {self.n_landmarks}"
            )
        if self.n_sampled > self.n_seeds:
            raise ValueError(f"n_sampled is {self.n_sampled}: it must not exceed n_seeds")
        return self

    @property
    def windows(self) -> WindowKind:
        """The windows that are sampled."""
        from sngr_utils.experiments.multimodality import WindowKind

        return WindowKind(self.scenario, self.p, self.weak, self.n_particles)


def view(config: Config, label: int, n: int) -> View:
    """A landmark of the first world after n poses."""
    from sngr_utils.experiments import multimodality

    return multimodality.view(config.scenario, config.first_seed, label, n)


def landmark(config: Config, label: int, n: int) -> Landmark:
    """Posterior of a landmark of the first world after n poses."""
    from sngr_utils.experiments import multimodality

    return multimodality.world_landmark(config.scenario, config.first_seed, label, n)


def run_landmarks(config: Config) -> pd.DataFrame:
    """Every landmark of every world after its first poses; see `multimodality.run_landmarks`."""
    from sngr_utils.experiments import multimodality

    seeds = config.seeds(config.n_seeds)
    return multimodality.run_landmarks(config.scenario, config.poses_seen, seeds, config.jobs)


def run_windows(config: Config) -> pd.DataFrame:
    """Every window: what a single Gaussian misses; see `multimodality.run_windows`."""
    from sngr_utils.experiments import multimodality

    seeds = config.seeds(config.n_seeds)
    return multimodality.run_windows(config.windows, config.ranges_per_pose, seeds, config.jobs)


def run_samplers(config: Config) -> pd.DataFrame:
    """All methods on the two anchors, on landmarks after their first poses, and on windows.

    Returns
    -------
    one row per case, size (poses, or ranges per pose), seed and method: the errors of
    `sampler_contest.judge`
    """
    import pandas as pd

    from sngr_utils.experiments import multimodality, two_anchors

    seeds, few = config.seeds(config.n_seeds), config.seeds(config.n_sampled)
    n_live = config.n_live_landmark
    tables = [
        multimodality.run_window_samplers(
            config.windows, config.n_live_window, config.ranges_per_pose, few, config.jobs
        ),
        two_anchors.run(n_live, seeds, config.jobs),
        multimodality.run_landmark_samplers(
            config.scenario, n_live, config.poses_sampled, seeds, config.jobs
        ),
    ]
    return pd.concat(tables, ignore_index=True)
