"""Driver of notebook 06: which trigger sees what, and at which rate of false alarms."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field, model_validator

from sngr_utils.detection import scores, thresholds
from sngr_utils.experiments import detector_scores, detector_summary
from sngr_utils.experiments.detector_scores import Case
from sngr_utils.metrics import cluster_bootstrap
from sngr_utils.settings import READING, Positive, Probability, Seed
from sngr_utils.slam.conventions import PRESETS
from sngr_utils.sngr import failure, trigger
from sngr_utils.world.scenario import ManyWorlds

NULL_SCENARIOS = ("radius 3 m", "100 poses")  # where the estimate that is tested matters
EVERY_P = "all p"
AT_LIMIT = {"disagreement": failure.FAILURE_ERROR}  # its threshold is what failure means

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
    p_levels: Annotated[list[Probability], Field(min_length=1)] = [0.05, 0.1, 0.2, 0.4]
    burst_levels: Annotated[list[Probability], Field(min_length=1)] = [0.3, 0.6]
    burst_poses: Annotated[int, Field(ge=1)] = 7
    p_shifted: Probability = 0.2
    nominal: Share = 0.05
    tau: Positive = 3.96
    seed_shown: Seed = 102
    p_shown: Probability = 0.6

    @model_validator(mode="after")
    def _consistent(self):
        for name in ("p_levels", "burst_levels"):
            values = getattr(self, name)
            if len(set(values)) < len(values) or 0 in values:
                raise ValueError(f"{name} is {values}: it must not repeat a value, nor hold 0")
        if self.burst_poses > self.n_poses:
            raise ValueError(f"burst_poses is {self.burst_poses}: there are {self.n_poses} poses")
        return self

    def worlds(self, cases: list[Case], seeds: Sequence[int]) -> pd.DataFrame:
        """All windows of these cases, see `detector_scores.window_rows`."""
        conventions = PRESETS[READING]
        return detector_scores.run(cases, self.scenario, conventions, seeds, self.jobs)


@dataclass(frozen=True)
class Study:
    """Windows with their scores and their truth, and the thresholds.

    Attributes
    ----------
    calibration : windows of the clean worlds that the thresholds come from
    rows : windows of the paper's scenario: clean, wrong labels everywhere, bursts
    shifted : windows of the shifted scenarios, clean and with wrong labels
    thresholds : per detector, at the nominal rate
    """

    calibration: pd.DataFrame
    rows: pd.DataFrame
    shifted: pd.DataFrame
    thresholds: dict[str, float]

    @property
    def clean(self) -> pd.DataFrame:
        """The clean windows of all scenarios, none of them used for calibration."""
        return pd.concat([self.rows.query("p == 0"), self.shifted.query("p == 0")])

    @property
    def noisy(self) -> pd.DataFrame:
        """Windows of the paper's scenario with wrong labels, and all levels of p as one case."""
        noisy = self.rows.query("p > 0")
        everywhere = noisy[noisy["case"].str.startswith("p =")]
        return pd.concat([noisy, everywhere.assign(case=EVERY_P)])


def run(config: Config) -> Study:
    """Calibrate on clean worlds, then score every window of all others."""
    last = config.first_seed + config.n_seeds
    clean = config.worlds([Case("paper", 0.0)], range(last, last + config.n_calibration))
    cases = [Case("paper", p) for p in (0.0, *config.p_levels)]
    cases += [Case("paper", p, config.burst_poses) for p in config.burst_levels]
    others = [name for name in detector_scores.SCENARIOS if name != "paper"]
    shifted = [
        config.worlds([Case(name, p) for name in others], config.seeds(n))
        for p, n in ((0.0, config.n_seeds), (config.p_shifted, config.n_shifted))
    ]
    rows = config.worlds(cases, config.seeds(config.n_seeds))
    tables = [clean, rows, pd.concat(shifted, ignore_index=True)]
    tables = [detector_scores.with_either(table, clean) for table in tables]
    return Study(*tables, detector_scores.thresholds(tables[0], config.nominal))


def run_null(config: Config) -> pd.DataFrame:
    """The level of the chi-square by preset, and by where the residuals are taken."""
    return detector_scores.null_rates(
        NULL_SCENARIOS, config.scenario, config.seeds(config.n_seeds), config.nominal, config.jobs
    )


def run_shown(config: Config) -> pd.DataFrame:
    """All windows of one world with a burst, and the wrong labels of each."""
    case = Case("paper", config.p_shown, config.burst_poses)
    the_world = case.draw(config.scenario, config.seed_shown)
    rows = config.worlds([case], range(config.seed_shown, config.seed_shown + 1))
    wrong = detector_scores.wrong_labels(the_world)[trigger.FIRST_ELIGIBLE :]
    return rows.assign(wrong=wrong)


def calibration_rows(study: Study, config: Config, *, rng: np.random.Generator) -> pd.DataFrame:
    """The calibrated thresholds, and two intervals for the quantile they estimate.

    Returns
    -------
    one row per calibrated detector: threshold; low, high by order statistics, as if windows
    were independent; worlds_low, worlds_high, with whole worlds drawn
    """
    clean, rows = study.calibration, []
    for name in detector_scores.CALIBRATED:
        low, high = thresholds.quantile_interval(clean[name], config.nominal)
        drawn = cluster_bootstrap.quantile(
            clean[name].to_numpy(), 1 - config.nominal, clean["seed"].to_numpy(), rng=rng
        )
        rows.append({
            "detector": name, "threshold": study.thresholds[name], "low": low, "high": high,
            "worlds_low": drawn.low, "worlds_high": drawn.high,
        })  # fmt: skip
    return pd.DataFrame(rows)


def levels(study: Study, *, rng: np.random.Generator) -> pd.DataFrame:
    """Every detector at its nominal rate on the clean worlds of all scenarios.

    And "at_limit": the disagreement at the failure limit, whose false alarms are those among the
    windows that did not fail.
    """
    clean = study.clean.assign(at_limit=study.clean["disagreement"])
    rules = {**study.thresholds, "at_limit": failure.FAILURE_ERROR}
    return detector_summary.decisions(clean, rules, "failed", rng=rng)


def rankings(study: Study, truth: str, *, rng: np.random.Generator) -> pd.DataFrame:
    """How well every score ranks windows by `truth`, and the disagreement with the oracle."""
    names = [*scores.SCORES, "oracle"]
    return detector_summary.ranking(study.noisy, names, truth, rng=rng)


def decisions(study: Study, *, rng: np.random.Generator) -> pd.DataFrame:
    """Failure, by every detector at its threshold; the disagreement's is the failure limit."""
    rules = {**study.thresholds, **AT_LIMIT}
    return detector_summary.decisions(study.noisy, rules, "failed", rng=rng)


def claims(study: Study, config: Config, *, rng: np.random.Generator) -> pd.DataFrame:
    """The paper's score at its threshold and at ours, beside two others, from p = 0 on."""
    rules = {
        "condition": config.tau, "calibrated": study.thresholds["condition"],
        "chi_square": study.thresholds["chi_square"], **AT_LIMIT,
    }  # fmt: skip
    everywhere = study.rows[study.rows["case"].str.startswith("p =")]
    everywhere = everywhere.assign(calibrated=everywhere["condition"])
    return detector_summary.decisions(everywhere, rules, "failed", rng=rng)


def shifted(study: Study, *, rng: np.random.Generator) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Ranking by failure, and decisions at the failure limit, on shifted scenarios."""
    rows = study.shifted.query("p > 0")
    names = ["condition", "chi_square", "disagreement", "disagreement_sigmas"]
    return (
        detector_summary.ranking(rows, names, "failed", rng=rng),
        detector_summary.decisions(rows, AT_LIMIT, "failed", rng=rng),
    )
