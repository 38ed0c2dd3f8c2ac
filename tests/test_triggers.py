"""The driver of notebook 06, its tables and its figures, on a few small worlds."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import handed_on
from scipy import stats

from sngr_utils import paths, triggers
from sngr_utils.detection import leverage, scores
from sngr_utils.experiments import detector_study
from sngr_utils.publish import parameters, report
from sngr_utils.show import style, triggers_figures
from sngr_utils.show import triggers as show
from sngr_utils.slam import selected_inverse
from sngr_utils.slam.conventions import PRESETS


@pytest.fixture(scope="module")
def config():
    quick = parameters.read_params("06_triggers", paths.PARAMS / "quick")
    few = {"jobs": 1, "n_poses": 12, "n_seeds": 2, "n_calibration": 2, "p_levels": [0.2]}
    return triggers.Config(**{**quick, **few})


@pytest.fixture(scope="module")
def study(config):
    return triggers.run(config)


def test_calibration_worlds_are_used_for_nothing_else(config, study):
    ours = set(study.calibration["seed"])
    assert len(ours) == config.n_calibration
    assert not ours & (set(study.rows["seed"]) | set(study.shifted["seed"]))
    assert (study.calibration["p"] == 0).all()
    assert not study.clean["contaminated"].any()


def test_all_levels_of_p_are_one_case_without_bursts(study):
    noisy = study.noisy
    pooled = noisy[noisy["case"] == detector_study.EVERY_P]
    assert len(pooled) == len(noisy[noisy["case"].str.startswith("p =")]) > 0
    assert noisy["case"].str.startswith("burst").any()


def test_tables_and_what_is_handed_on(config, study, tmp_path):
    rng = np.random.default_rng(0)
    clean, decided = detector_study.levels(study, rng=rng), detector_study.decisions(study, rng=rng)
    failed, wrong = (detector_study.rankings(study, x, rng=rng) for x in ("failed", "contaminated"))
    cases, scenarios = 3, 8
    assert show.level_table(clean).shape == (scenarios, 2 + len(scores.SCORES))
    for table, column in ((failed, "auc"), (wrong, "precision"), (failed, "within")):
        assert show.case_table(table, column).shape == (
            2 + len(scores.SCORES),
            1 + cases,
        )
    assert len(show.case_table(decided, "mcc")) == 1 + len(scores.SCORES)
    every = detector_study.EVERY_P
    whole = show.summary_table(failed, wrong, decided, clean, every)
    assert whole.shape == (len(scores.SCORES), 6)
    mark = show.best_of(whole)
    fewest = [row["false alarms [%]"].numbers[1] for _, row in whole.iterrows()]
    marked = [mark(row, "false alarms [%]") for _, row in whole.iterrows()]
    assert marked == [most == min(fewest) for most in fewest]
    assert not any(mark(row, "score") for _, row in whole.iterrows())
    claims = detector_study.claims(study, config.tau, rng=rng)
    assert len(show.claims_table(claims, config.tau)) == 4 * 2
    assert len(show.shifted_table(*detector_study.shifted(study, rng=rng))) == scenarios - 1
    assert len(show.null_table(triggers.run_null(config))) == 2 * 2
    to = report.Report("06_triggers", tmp_path)
    show.record(failed, wrong, decided, clean, to)
    values = handed_on(to)
    for key in ("auc.failed.disagreement.all_p", "auc.contaminated.chi_square_robust.all_p",
                "mcc.condition.all_p", "level.failed.100_poses",
                "level.condition.radius_3_m"):  # fmt: skip
        assert f"triggers.{key}" in values


def test_figures_show_what_they_are_given(config, study):
    rng, shown = np.random.default_rng(0), triggers.run_shown(config)
    assert shown["wrong"].sum() > 0
    assert ((shown["wrong"] > 0) == shown["contaminated"]).all()
    fig, axes = style.panels(7, 3, 5)
    panels = {"condition": ("score", 4.0), "disagreement": ("[m]", 0.5)}
    triggers_figures.draw_along(axes[:2], shown, panels)
    assert np.array_equal(axes[1].lines[0].get_ydata(), shown["disagreement"])
    triggers_figures.draw_states(axes[2], study.rows, (1.3, 0.5))
    assert sum(len(line.get_xdata()) for line in axes[2].lines[:3]) == len(study.rows)
    laws = {"a": study.rows["naive"].to_numpy(), "b": study.rows["chi_square"].to_numpy()}
    triggers_figures.draw_p_values(axes[3], laws)
    found = detector_study.rankings(study, "failed", rng=rng)
    series = triggers_figures.auc_series(found, {"condition": "c", "disagreement": "d"})
    triggers_figures.draw_aucs(axes[4], series, "x", True)
    plt.close(fig)
    fig, ax = style.figure()
    clean = detector_study.levels(study, rng=rng)
    triggers_figures.draw_levels(ax, clean, {"chi_square": "chi-square"})
    assert len(ax.texts) == 2 * clean["scenario"].nunique()
    plt.close(fig)


def test_leverage_from_scratch_is_the_librarys(from_scratch):
    """To half a per cent: what bends an odometry residual that is not zero is left out."""
    preset = PRESETS["C"]
    world, poses, landmarks = triggers.run_example(triggers.Config())
    covariance = selected_inverse.covariance_at(poses, landmarks, world, preset)
    theirs = leverage.chi_square(world, poses, landmarks, covariance)
    jacobian = from_scratch["whitened_jacobian"](
        world, poses, landmarks, preset.x0_sigmas, preset.landmark_prior_sigma
    )
    distances = np.linalg.norm(landmarks[world.label_of] - poses[world.pose_of, :2], axis=1)
    residuals = (world.ranges - distances) / world.scenario.range_sigma
    for t in range(len(theirs.rank)):
        mine = np.flatnonzero((world.pose_of >= t) & (world.pose_of < t + 3))
        rows = len(jacobian) - len(residuals) + mine
        q, degrees = from_scratch["leverage_test"](jacobian, rows, residuals[mine])
        assert degrees == theirs.rank[t]
        assert q == pytest.approx(theirs.statistic[t], rel=0.005)


@pytest.mark.parametrize("degrees", [1, 2, 3, 10, 17])
def test_tail_from_scratch_is_scipys(from_scratch, degrees):
    for q in (0.1, 3.0, 40.0):
        assert from_scratch["tail"](q, degrees) == pytest.approx(stats.chi2.sf(q, degrees))


@pytest.mark.parametrize(
    ("name", "value"),
    [("p_levels", [0.1, 0.1]), ("p_levels", [0.0, 0.1]), ("burst_levels", []),
     ("burst_poses", 31), ("p_shifted", 0.0), ("nominal", 0.0), ("n_seeds", 1), ("first_seed", -1)],
)  # fmt: skip
def test_bad_parameters_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        triggers.Config(**{name: value})
