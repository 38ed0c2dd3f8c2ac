"""What every detector says of every window, and how much of it is true.

The truth enters in two columns only: whether a window failed, and whether one of its ranges has a
wrong label. All scores are computed from data. The summaries go group by group of worlds of one
kind (scenario and case) and detector by detector; every interval draws whole worlds.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from sngr_utils.detection import leverage
from sngr_utils.detection.scores import (
    SCORES,
    disagreement,
    disagreement_sigmas,
    either,
    largest_eigenvalue,
    mirror_weight,
)
from sngr_utils.detection.thresholds import conformal_threshold, surprise
from sngr_utils.experiments.many_worlds import map_rows, map_worlds
from sngr_utils.metrics import cluster_bootstrap
from sngr_utils.robust import em, losses
from sngr_utils.slam import isam2, levenberg_marquardt, selected_inverse
from sngr_utils.slam.conventions import PRESETS, Conventions
from sngr_utils.slam.solution import Solution
from sngr_utils.sngr import failure, trigger, windows
from sngr_utils.world import simulation, variations
from sngr_utils.world.scenario import Scenario

# scenario -> what differs from the paper's
SCENARIOS = {
    "paper": {},
    "radius 3 m": {"radius": 3.0},
    "radius 10 m": {"radius": 10.0},
    "4 landmarks": {"n_landmarks": 4},
    "10 landmarks": {"n_landmarks": 10},
    "range sigma 0.05 m": {"range_sigma": 0.05},
    "range sigma 0.3 m": {"range_sigma": 0.3},
    "100 poses": {"n_poses": 100},
}
CALIBRATED = ("condition", "eigenvalue", "mirror", "disagreement", "disagreement_sigmas")
NULL_PRESETS = ("B", "C")  # iSAM2 relinearises at every update, or at every tenth as A does
GROUPS = ["scenario", "case"]
TRUSTED = 0.5  # responsibility of its label above which a range counts in the covariance


@dataclass(frozen=True)
class Case:
    """One kind of world.

    Attributes
    ----------
    scenario : one of `SCENARIOS`
    p : probability of a wrong label
    burst : poses of the burst that the wrong labels are confined to; 0 for everywhere
    """

    scenario: str
    p: float
    burst: int = 0

    @property
    def name(self) -> str:
        return f"burst, p = {self.p:g}" if self.burst else f"p = {self.p:g}"

    def draw(self, paper: Scenario, seed: int) -> simulation.World:
        """The world of `seed`; the place of a burst and its labels come from a child stream."""
        scenario = paper.model_copy(update=SCENARIOS[self.scenario])
        rng = np.random.default_rng(seed)
        if not self.burst:
            return simulation.simulate(scenario, self.p, rng=rng)
        clean = simulation.simulate(scenario, 0.0, rng=rng)
        (burst_rng,) = rng.spawn(1)
        return variations.burst(clean, self.p, self.burst, rng=burst_rng)


def robust_estimate(the_world: simulation.World, conventions: Conventions) -> em.SoftEstimate:
    """EM over the associations from a grid, no two ranges of a scan from the same landmark."""
    log = the_world.log(conventions.x0_sigmas)
    return em.estimate(log, conventions, "grid", exclusive=True, clutter=False)


def scores(
    the_world: simulation.World, conventions: Conventions, solution: Solution
) -> pd.DataFrame:
    """One row per window, a column per score of `scores.SCORES` except "either".

    And "naive": the robust chi-square as if no range had leverage.
    """
    plain = selected_inverse.covariance(solution, the_world, conventions)
    poses, landmarks = solution.poses, solution.landmarks
    robust = robust_estimate(the_world, conventions)
    reference = robust.poses, robust.landmarks
    own = robust.responsibilities[np.arange(len(the_world.ranges)), the_world.label_of]
    trusted = selected_inverse.covariance_at(*reference, the_world.keep(own > TRUSTED), conventions)
    null = selected_inverse.covariance_at(*reference, the_world, conventions)  # all labels right
    robust_test = leverage.chi_square(the_world, *reference, null)
    return pd.DataFrame({
        "condition": trigger.score(plain.windows),
        "eigenvalue": largest_eigenvalue(plain.windows),
        "chi_square": leverage.chi_square(the_world, poses, landmarks, plain).surprise,
        "chi_square_robust": robust_test.surprise,
        "naive": robust_test.naive_surprise,
        "mirror": mirror_weight(the_world, poses, landmarks),
        "disagreement": disagreement(poses, reference[0]),
        "disagreement_sigmas": disagreement_sigmas(poses, reference[0], trusted),
    })


def wrong_labels(the_world: simulation.World) -> np.ndarray:
    """(T-W+1,) int: ranges with a wrong label in each window. One is enough to contaminate it."""
    wrong = the_world.pose_of[the_world.label_of != the_world.source_of]
    per_pose = np.bincount(wrong, minlength=the_world.n_poses)
    return windows.counts(per_pose)


def window_rows(case: Case, paper: Scenario, conventions: Conventions, seed: int) -> pd.DataFrame:
    """Scores and truth of the windows of one world that may fire.

    Returns
    -------
    one row per window: scenario, case, p, seed, window; error (mean over its poses, [m]),
    failed, contaminated; the scores; oracle (on the paper's scenario: the disagreement with the
    estimate that knows all labels, which no detector has)
    """
    the_world = case.draw(paper, seed)
    solution = isam2.run_isam2(the_world, conventions)
    table = scores(the_world, conventions, solution)
    oracle = np.full_like(solution.poses, np.nan)
    if case.scenario == "paper":
        oracle, _ = losses.estimate(the_world, conventions, "oracle", "first_poses")
    errors = np.linalg.norm((solution.poses - the_world.poses)[:, :2], axis=1)
    truth = {
        "scenario": case.scenario, "case": case.name, "p": case.p, "seed": seed,
        "window": np.arange(len(table)),
        "error": disagreement(solution.poses, the_world.poses),
        "failed": failure.failures(errors),
        "contaminated": wrong_labels(the_world) > 0,
        "oracle": disagreement(solution.poses, oracle),
    }  # fmt: skip
    return table.assign(**truth).iloc[trigger.FIRST_ELIGIBLE :]


def run(
    cases: Sequence[Case],
    paper: Scenario,
    conventions: Conventions,
    seeds: Sequence[int],
    jobs: int,
) -> pd.DataFrame:
    """`window_rows` of all cases and seeds, in their order."""
    worlds = [(case, paper, conventions, seed) for case in cases for seed in seeds]
    return pd.concat(map(pd.DataFrame, map_worlds(_columns, worlds, jobs)), ignore_index=True)


def _columns(*case) -> dict[str, list]:
    """The columns of `window_rows`."""
    return window_rows(*case).to_dict("list")


def with_either(rows: pd.DataFrame, clean: pd.DataFrame) -> pd.DataFrame:
    """The rows with the score "either", its condition number calibrated on the `clean` ones."""
    condition = surprise(rows["condition"], clean["condition"])
    return rows.assign(either=either(condition, rows["chi_square"].to_numpy()))


def thresholds(clean: pd.DataFrame, alpha: float) -> dict[str, float]:
    """Threshold per detector at a nominal rate of false alarms: a null law, or calibration."""
    law = -np.log10(alpha)
    return {
        name: conformal_threshold(clean[name], alpha) if name in CALIBRATED else law
        for name in SCORES
    }


def null_rates(
    scenarios: Sequence[str], paper: Scenario, seeds: Sequence[int], alpha: float, jobs: int
) -> pd.DataFrame:
    """How the chi-square keeps its level on clean data, by preset and by where it is taken.

    Returns
    -------
    one row per scenario, preset, seed and estimate ("iSAM2", or "settled" by batch from there):
    fired (share of the windows that may)
    """
    worlds = [
        (Case(scenario, 0.0), paper, preset, seed, alpha)
        for scenario in scenarios
        for preset in NULL_PRESETS
        for seed in seeds
    ]
    rows = map_rows(_null_rates, worlds, jobs)
    return pd.DataFrame(rows, columns=["scenario", "preset", "seed", "estimate", "fired"])


def _null_rates(case: Case, paper: Scenario, preset: str, seed: int, alpha: float) -> list[tuple]:
    the_world, conventions = case.draw(paper, seed), PRESETS[preset]
    solution, rows = isam2.run_isam2(the_world, conventions), []
    for name, found in (("iSAM2", solution), ("settled", levenberg_marquardt.converge(solution))):
        covariance = selected_inverse.covariance(found, the_world, conventions)
        test = leverage.chi_square(the_world, found.poses, found.landmarks, covariance)
        fired = test.surprise[trigger.FIRST_ELIGIBLE :] > -np.log10(alpha)
        rows.append((case.scenario, preset, seed, name, float(fired.mean())))
    return rows


def ranking(
    rows: pd.DataFrame, names: Sequence[str], truth: str, *, rng: np.random.Generator
) -> pd.DataFrame:
    """How well scores rank windows, whatever the threshold.

    Parameters
    ----------
    names : columns of scores
    truth : "failed" or "contaminated"

    Returns
    -------
    one row per group and score: auc and precision (area under the precision-recall curve) of
    all windows pooled, within (AUC from pairs of the same world), each with _low and _high;
    base_rate, worlds
    """
    found = []
    for keys, group in rows.groupby(GROUPS, sort=False):
        true, worlds = group[truth].to_numpy(), group["seed"].to_numpy()
        for name in names:
            score = group[name].to_numpy()
            within, _ = cluster_bootstrap.within_auc(score, true, worlds, rng=rng)
            found.append({
                **dict(zip(GROUPS, keys, strict=True)), "detector": name, "truth": truth,
                **_ends("auc", cluster_bootstrap.roc_auc(score, true, worlds, rng=rng)),
                **_ends(
                    "precision", cluster_bootstrap.average_precision(score, true, worlds, rng=rng)
                ),
                **_ends("within", within),
                "base_rate": true.mean(), "worlds": len(np.unique(worlds)),
            })  # fmt: skip
    return pd.DataFrame(found)


def decisions(
    rows: pd.DataFrame, thresholds: Mapping[str, float], truth: str, *, rng: np.random.Generator
) -> pd.DataFrame:
    """How well firing above a threshold decides.

    Parameters
    ----------
    thresholds : by column of scores
    truth : "failed" or "contaminated"

    Returns
    -------
    one row per group and score: fired (share), precision, recall, false_alarms (share of the
    windows without `truth` that fire), mcc, each with _low and _high; base_rate, worlds,
    silent (share of the worlds in which nothing fires)
    """
    found = []
    for keys, group in rows.groupby(GROUPS, sort=False):
        true, worlds = group[truth].to_numpy(), group["seed"].to_numpy()
        everything = np.ones(len(group), dtype=bool)
        for name, threshold in thresholds.items():
            fired = group[name].to_numpy() > threshold
            shares = {
                "fired": (fired, everything), "precision": (true, fired), "recall": (fired, true),
                "false_alarms": (fired, ~true),
            }  # fmt: skip
            row = {**dict(zip(GROUPS, keys, strict=True)), "detector": name, "truth": truth}
            for column, (marked, among) in shares.items():
                row |= _ends(column, cluster_bootstrap.share(marked, among, worlds, rng=rng))
            row |= _ends("mcc", cluster_bootstrap.matthews(fired, true, worlds, rng=rng))
            silent = ~group.assign(fired=fired).groupby("seed")["fired"].any()
            row |= {
                "base_rate": true.mean(), "worlds": len(silent), "silent": silent.mean()
            }  # fmt: skip
            found.append(row)
    return pd.DataFrame(found)


def _ends(name: str, interval: cluster_bootstrap.Interval) -> dict[str, float]:
    return {name: interval.value, f"{name}_low": interval.low, f"{name}_high": interval.high}
