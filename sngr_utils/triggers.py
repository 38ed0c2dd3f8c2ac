"""Driver of notebook 06: which trigger sees what, and at which rate of false alarms."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Annotated

from pydantic import Field, model_validator

from sngr_utils.settings import READING, Levels, Positive, Probability, Seed
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.world.scenario import ManyWorlds

# What runs is imported where it runs: a check of all parameters needs no GTSAM and no compiler.
if TYPE_CHECKING:
    import numpy as np
    import pandas as pd

    from sngr_utils.experiments.detector_scores import Case
    from sngr_utils.experiments.detector_study import Study
    from sngr_utils.world.simulation import World

Share = Annotated[float, Field(gt=0, lt=1)]


class Config(ManyWorlds):
    """Parameters of the study of triggers. Worlds are those of seeds first_seed and following.

    n_seeds : worlds of every case on the paper's scenario, and clean ones of every other
    n_calibration : clean worlds of the thresholds, of the seeds after these
    n_shifted : worlds of every shifted scenario with wrong labels
    p_levels : wrong labels everywhere; burst_levels : in a burst of burst_poses poses
    p_shifted : wrong labels on the shifted scenarios
    nominal : rate of false alarms that thresholds are set for
    tau : the paper's threshold on the condition number
    seed_shown, p_shown : the world with a burst of the figure along a trajectory
    """

    first_seed: Seed = 6000
    n_seeds: Annotated[int, Field(ge=2)] = 30
    n_calibration: Annotated[int, Field(ge=1)] = 30
    n_shifted: Annotated[int, Field(ge=2)] = 12
    p_levels: Levels = [0.05, 0.1, 0.2, 0.4]
    burst_levels: Levels = [0.3, 0.6]
    burst_poses: Annotated[int, Field(ge=1)] = 7
    p_shifted: Probability = 0.2
    nominal: Share = 0.05
    tau: Positive = 3.96
    seed_shown: Seed = 102
    p_shown: Probability = 0.6

    @model_validator(mode="after")
    def _consistent(self):
        for name in ("p_levels", "burst_levels"):
            if 0 in getattr(self, name):
                raise ValueError(f"{name} is {getattr(self, name)}: clean worlds are there anyway")
        if self.p_shifted == 0:
            raise ValueError("p_shifted is 0: clean worlds are there anyway")
        if self.burst_poses > self.n_poses:
            raise ValueError(f"burst_poses is {self.burst_poses}: there are {self.n_poses} poses")
        return self

    def worlds(self, cases: Sequence[Case], seeds: Sequence[int]) -> pd.DataFrame:
        """All windows of these cases, see `detector_scores.window_rows`."""
        from sngr_utils.experiments import detector_scores

        return detector_scores.run(cases, self.scenario, PRESETS[READING], seeds, self.jobs)


def run(config: Config) -> Study:
    """Calibrate on clean worlds, then score every window of all others."""
    from sngr_utils.experiments import detector_study
    from sngr_utils.experiments.detector_scores import Case

    last = config.first_seed + config.n_seeds
    cases = [Case("paper", p) for p in (0.0, *config.p_levels)]
    cases += [Case("paper", p, config.burst_poses) for p in config.burst_levels]
    shifted = [(0.0, config.seeds(config.n_seeds)),
               (config.p_shifted, config.seeds(config.n_shifted))]  # fmt: skip
    return detector_study.run(
        config.worlds, cases, config.seeds(config.n_seeds),
        range(last, last + config.n_calibration), shifted, config.nominal,
    )  # fmt: skip


def run_null(config: Config) -> pd.DataFrame:
    """The level of the chi-square by preset, and by where the residuals are taken."""
    from sngr_utils.experiments import detector_scores, detector_study

    return detector_scores.null_rates(
        detector_study.NULL_SCENARIOS, config.scenario, config.seeds(config.n_seeds),
        config.nominal, config.jobs,
    )  # fmt: skip


def run_shown(config: Config) -> pd.DataFrame:
    """All windows of one world with a burst, and the wrong labels of each."""
    from sngr_utils.experiments import detector_scores
    from sngr_utils.sngr.trigger import FIRST_ELIGIBLE

    case = detector_scores.Case("paper", config.p_shown, config.burst_poses)
    wrong = detector_scores.wrong_labels(case.draw(config.scenario, config.seed_shown))
    return config.worlds([case], [config.seed_shown]).assign(wrong=wrong[FIRST_ELIGIBLE:])


def run_example(config: Config) -> tuple[World, np.ndarray, np.ndarray]:
    """A clean world, and the poses and landmarks of its robust estimate."""
    from sngr_utils.experiments import detector_scores

    the_world = detector_scores.Case("paper", 0.0).draw(config.scenario, config.seed_shown)
    found = detector_scores.robust_estimate(the_world, PRESETS[READING])
    return the_world, found.poses, found.landmarks
