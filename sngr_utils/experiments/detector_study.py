"""Every detector on clean worlds, on wrong labels and on other scenarios, and what that says.

The thresholds come from clean worlds of their own. Intervals draw whole worlds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils.detection import scores
from sngr_utils.experiments import detector_scores
from sngr_utils.experiments.detector_scores import Case
from sngr_utils.sngr import failure

NULL_SCENARIOS = ("radius 3 m", "100 poses")  # where the estimate that is tested matters
EVERY_P = "all p"
AT_LIMIT = {"disagreement": failure.FAILURE_ERROR}  # its threshold is what failure means


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


def run(
    worlds: Callable[[Sequence[Case], Sequence[int]], pd.DataFrame],
    cases: Sequence[Case],
    seeds: Sequence[int],
    calibration: Sequence[int],
    shifted: Sequence[tuple[float, Sequence[int]]],
    nominal: float,
) -> Study:
    """Calibrate on clean worlds, then score every window of all others.

    Parameters
    ----------
    worlds : all windows of cases and seeds, see `detector_scores.window_rows`
    cases, seeds : kinds of worlds of the paper's scenario, and their seeds
    calibration : seeds of the clean worlds that the thresholds come from
    shifted : p and seeds of the worlds of all other scenarios
    nominal : rate of false alarms that the thresholds are set for
    """
    clean = worlds([Case("paper", 0.0)], calibration)
    others = [name for name in detector_scores.SCENARIOS if name != "paper"]
    elsewhere = [worlds([Case(name, p) for name in others], few) for p, few in shifted]
    tables = [clean, worlds(cases, seeds), pd.concat(elsewhere, ignore_index=True)]
    tables = [detector_scores.with_either(table, clean) for table in tables]
    return Study(*tables, detector_scores.thresholds(tables[0], nominal))


def levels(study: Study, *, rng: np.random.Generator) -> pd.DataFrame:
    """Every detector at its nominal rate on the clean worlds of all scenarios.

    And "at_limit": the disagreement at the failure limit, whose false alarms are those among the
    windows that did not fail.
    """
    clean = study.clean.assign(at_limit=study.clean["disagreement"])
    rules = {**study.thresholds, "at_limit": failure.FAILURE_ERROR}
    return detector_scores.decisions(clean, rules, "failed", rng=rng)


def rankings(study: Study, truth: str, *, rng: np.random.Generator) -> pd.DataFrame:
    """How well every score ranks windows by `truth`, and the disagreement with the oracle."""
    names = [*scores.SCORES, "oracle"]
    return detector_scores.ranking(study.noisy, names, truth, rng=rng)


def decisions(study: Study, *, rng: np.random.Generator) -> pd.DataFrame:
    """Failure, by every detector at its threshold; the disagreement's is the failure limit."""
    rules = {**study.thresholds, **AT_LIMIT}
    return detector_scores.decisions(study.noisy, rules, "failed", rng=rng)


def claims(study: Study, tau: float, *, rng: np.random.Generator) -> pd.DataFrame:
    """The paper's score at its threshold and at ours, beside two others, from p = 0 on."""
    rules = {
        "condition": tau, "calibrated": study.thresholds["condition"],
        "chi_square": study.thresholds["chi_square"], **AT_LIMIT,
    }  # fmt: skip
    everywhere = study.rows[study.rows["case"].str.startswith("p =")]
    everywhere = everywhere.assign(calibrated=everywhere["condition"])
    return detector_scores.decisions(everywhere, rules, "failed", rng=rng)


def shifted(study: Study, *, rng: np.random.Generator) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Ranking by failure, and decisions at the failure limit, on shifted scenarios."""
    rows = study.shifted.query("p > 0")
    names = ["condition", "chi_square", "disagreement", "disagreement_sigmas"]
    return (
        detector_scores.ranking(rows, names, "failed", rng=rng),
        detector_scores.decisions(rows, AT_LIMIT, "failed", rng=rng),
    )
