"""The four drivers on small parameters: what must hold, and what the paper prints."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sngr_utils import bimodal, cost, full_sngr, paths, trigger_sweep
from sngr_utils.metrics import standard_error
from sngr_utils.publish import files, latex, parameters, report
from sngr_utils.show import bimodal as show_bimodal
from sngr_utils.show import cost as show_cost
from sngr_utils.show import full_sngr as show_full_sngr
from sngr_utils.show import style
from sngr_utils.show import trigger_sweep as show_trigger_sweep


@pytest.fixture(autouse=True)
def _close_figures():
    style.use_style()
    yield
    plt.close("all")


def quick(module, name):
    return module.Config(**parameters.read_params(name, paths.PARAMS / "quick"))


# --- 01 ---


@pytest.fixture(scope="module")
def bimodal_result():
    return bimodal.run(bimodal.Config(n_repeats=20))


def test_saddle_log_likelihoods_in_both_conventions():
    """-12.50 as printed and -25.0 in the correct convention, by formula and by GTSAM."""
    for factor, expected in ((0.5, -12.5), (1.0, -25.0)):
        config = bimodal.Config(likelihood_factor=factor)
        assert show_bimodal.profile(config, np.array(0.0), factor) == pytest.approx(expected)
        estimate = bimodal.run_isam2(config, config.saddle)
        likelihood = bimodal.log_likelihood(config, estimate)
        assert likelihood(np.zeros(2)) == pytest.approx(expected, abs=1e-6)


def test_printed_gain_follows_from_the_weak_prior():
    """+12.49 is 12.5 less half of the prior's error of 10 m at the mode."""
    config = bimodal.Config()
    at_mode = -0.5 * 0.5 * 5 / 10**2
    likelihood = bimodal.log_likelihood(config, bimodal.run_isam2(config, config.saddle))
    mode = config.modes[0] - config.saddle
    assert likelihood(mode) == pytest.approx(at_mode, abs=1e-6)
    gain = likelihood(mode) - likelihood(np.zeros(2))
    assert round(gain, 2) == report.printed_values()["bimodal"]["delta_logp"]


def test_hessians_against_finite_differences():
    config, h = bimodal.Config(likelihood_factor=1.0), 1e-4
    likelihood = bimodal.log_likelihood(config, bimodal.run_isam2(config, config.saddle))
    for at in (config.saddle, config.modes[0], np.array([1.0, 1.5])):
        offset = at - config.saddle
        numeric = np.zeros((2, 2))
        for i in range(2):
            for j in range(2):
                e, f = h * np.eye(2)[i], h * np.eye(2)[j]
                numeric[i, j] = -(
                    likelihood(offset + e + f) - likelihood(offset + e - f)
                    - likelihood(offset - e + f) + likelihood(offset - e - f)
                ) / (4 * h * h)  # fmt: skip
        assert np.allclose(bimodal.full_hessian(config, at), numeric, atol=1e-3)


def test_isam2_stays_at_the_saddle_and_leaves_any_other_start():
    config = bimodal.Config()
    stays = bimodal.run_isam2(config, config.saddle).atPoint2(bimodal.LANDMARK)
    assert np.allclose(stays, config.saddle, atol=1e-9)
    leaves = bimodal.run_isam2(config, np.array([2.0, -0.5])).atPoint2(bimodal.LANDMARK)
    assert np.allclose(leaves, config.modes[1], atol=0.01)


def test_both_modes_found_with_half_the_mass_each(bimodal_result):
    """The run's mass at 4 of its standard errors, the mean of 20 at 5 of theirs.

    The standard errors are themselves estimated from 20 runs (t law, 19 degrees): failure
    probabilities 8e-4 and 8e-5.
    """
    masses = bimodal_result.upper_masses
    assert abs(masses[0] - 0.5) < 4 * bimodal_result.upper_mass_error
    assert abs(masses.mean() - 0.5) < 5 * standard_error.standard_error(masses)
    assert ((masses > 0.05) & (masses < 0.95)).all()


def test_masses_are_of_the_modes_wherever_isam2_ended():
    """From a start off the saddle the prior is centred on a mode; y > 0 still means that mode.

    Quadrature puts the other mode's mass at half a per cent, far from the 0.2 allowed.
    """
    config = bimodal.Config(n_repeats=2, n_live=50)
    upper = bimodal.run(config, at=np.array([2.0, 0.5]))
    lower = bimodal.run(config, at=np.array([2.0, -0.5]))
    assert (upper.upper_masses > 0.8).all()
    assert (lower.upper_masses < 0.2).all()


def test_one_run_cannot_know_its_own_mass_error(bimodal_result):
    """The spread of 20 runs exceeds the resampled error; the ratio is near 3.5.

    Under equality of the two, 20 runs exceed twice the error with probability below 1e-6.
    """
    assert bimodal_result.upper_mass_error > 2 * bimodal_result.resampled_error


def test_bimodal_moments(bimodal_result):
    """sigma_y near the half distance of the modes, whatever the mass; coefficient near one."""
    height = bimodal_result.config.modes[0, 1]
    assert 0.8 * height < bimodal_result.sigma_y < 1.15 * height
    assert bimodal_result.bimodality > 0.9
    assert bimodal.mode_width(bimodal_result) < 0.5


def test_bimodal_tables_and_figures(bimodal_result, tmp_path):
    table = show_bimodal.comparison_table(bimodal_result)
    assert set(table["printed"]) >= {"−12.50", "12.49", "2.21", "0.62"}
    assert list(table["ours"])[2] == "−12.50"
    assert show_bimodal.hessian_table(bimodal_result.config)["smallest"][1].startswith("−")
    to = report.Report("x", tmp_path)
    show_bimodal.record(bimodal_result, to)
    config = bimodal_result.config
    fig, axes = plt.subplots(1, 6, figsize=(2 * 6, 2.5))
    show_bimodal.draw_circles(axes[0], config.anchors, 3.0, {"modes": config.modes})
    show_bimodal.draw_profile(axes[1], np.arange(3.0), {"a": np.arange(3.0)})
    points = {"iSAM2": bimodal_result.map, "modes": config.modes}
    show_bimodal.draw_samples(axes[2], bimodal_result.samples, bimodal_result.weights, points)
    show_bimodal.draw_histogram(
        axes[3], bimodal_result.samples[:, 1], bimodal_result.weights, [0.0]
    )
    show_bimodal.draw_repeated_masses(axes[4], bimodal_result.upper_masses, 0.1, 0.2)
    show_bimodal.draw_live_points(axes[5], np.arange(3.0), np.arange(3.0))
    to.figure(fig, "all", png=True)
    assert show_bimodal.run_plot(bimodal_result.run) is not None
    assert (tmp_path / "x_all.pdf").exists()
    assert (tmp_path / "x_all.png").exists()


def test_circles_that_do_not_cross_are_refused():
    with pytest.raises(ValueError, match=r"measured_range is 1\.9"):
        bimodal.Config(measured_range=1.9)


# --- 02 ---


def test_tau_table_prints_both(paper_sweep):
    table = show_trigger_sweep.tau_table(paper_sweep)
    assert list(table["p = 0", "ours"]) == ["4", "0", "0", "0"]
    assert list(table["p = 0.3", "printed"]) == ["–", "21", "14", "8"]


def test_choice_of_tau_follows_the_papers_rule(paper_sweep):
    chosen, config = trigger_sweep.choose_tau(paper_sweep), paper_sweep.config
    fired = {t: paper_sweep.single(0.0).detection(t).triggered for t in config.tau_grid}
    caught = {t: paper_sweep.single(0.3).detection(t).triggered for t in config.tau_grid}
    assert fired[chosen] == 0
    for tau in config.tau_grid:
        if fired[tau] == 0:
            assert (caught[chosen], chosen) >= (caught[tau], tau)
    loud = trigger_sweep.Sweep(config.model_copy(update={"tau_grid": [3.0]}), paper_sweep.runs)
    assert trigger_sweep.choose_tau(loud) is None


def test_baseline_trends_of_the_paper(paper_sweep):
    """The error and the NEES grow with p on this world; at p = 0.1 it is blind."""
    nees = [paper_sweep.single(p).nees for p in paper_sweep.config.p_levels]
    assert nees == sorted(nees)
    blind = paper_sweep.single(0.1).detection(paper_sweep.config.tau)
    assert blind.triggered == 0
    assert blind.failed > 20


def test_sweep_tables(paper_sweep, tmp_path):
    baseline_table = show_trigger_sweep.baseline_table(paper_sweep)
    assert baseline_table.shape == (5, 14)
    assert show_trigger_sweep.clean_table(paper_sweep).shape == (5, 5)
    seeds = show_trigger_sweep.per_seed_table(paper_sweep)
    assert list(seeds["triggered", "printed"]) == ["14", "8", "0", "10", "0"]
    to = report.Report("x", tmp_path)
    show_trigger_sweep.record(paper_sweep, to)
    fig, axes = plt.subplots(1, 5, figsize=(2 * 5, 2.5))
    base = paper_sweep.single(0.3)
    show_trigger_sweep.draw_ranges(axes[0], base, 3)
    show_trigger_sweep.draw_world(axes[1], base, 3.9)
    show_trigger_sweep.draw_scores(axes[2], base, 3.9)
    show_trigger_sweep.draw_nees(axes[3], [0.0, 0.1], [1.0, 2.0], [None, 3.0])
    show_trigger_sweep.draw_score_boxes(axes[4], [0.0], [base.scores], 3.9)
    to.figure(fig, "all")
    covariance = base.covariances[5]
    shift = trigger_sweep.score_in_units(covariance, 100) - base.scores[5]
    assert shift == pytest.approx(4, abs=0.1)


def test_presets_share_the_data():
    small = trigger_sweep.Config(seeds=[0], p_levels=[0.0, 0.3])
    presets = trigger_sweep.run_presets(small)
    worlds = [sweep.single(0.3).world for sweep in presets.values()]
    assert all(np.array_equal(w.ranges, worlds[0].ranges) for w in worlds)
    table = show_trigger_sweep.preset_table(presets)
    assert list(table["p"]) == ["0", "0.3"]
    assert "–" in table["preset A"][0]  # one seed has no standard deviation


@pytest.mark.parametrize(
    ("changes", "name"),
    [({"p_levels": [0.0, 0.2]}, "p_noisy"), ({"seeds": [0, 0]}, "seeds"), ({"seeds": []}, "seeds"),
     ({"preset": "Z"}, "preset"), ({"conventions": {"x": 1}}, "x"), ({"tau": -1.0}, "tau"),
     ({"p_levels": [0.0, 0.3, 1.5]}, "p_levels")],
)  # fmt: skip
def test_bad_sweep_names_the_parameter(changes, name):
    with pytest.raises(ValueError, match=name):
        trigger_sweep.Config(**changes)


# --- 03 ---


@pytest.fixture(scope="module")
def pipeline():
    config = quick(full_sngr, "03_full_sngr").model_copy(update={"n_live": 20, "dlogz": 5.0})
    return config, full_sngr.run(config)


def test_pipeline_applies_only_what_the_gate_accepts(pipeline):
    config, levels = pipeline
    for level in levels.values():
        touched = np.zeros(level.baseline.world.n_poses, dtype=bool)
        for window in level.windows:
            if window.accepted:
                touched[window.t : window.t + 3] = True
        moved = np.abs(level.poses - level.baseline.solution.poses).max(axis=1) > 0
        assert np.array_equal(moved, touched)
        assert [w.t for w in level.windows] == list(
            np.flatnonzero(level.baseline.fired(config.tau))
        )


def test_pipeline_tables_and_figures(pipeline, tmp_path):
    config, levels = pipeline
    other = config.model_copy(update={"engine": "nested"})
    presets = full_sngr.run_presets(other, levels)
    assert show_full_sngr.sngr_table(config, levels).shape == (1, 15)
    assert show_full_sngr.gain_table(levels).shape[0] == 1
    assert list(show_full_sngr.preset_table(presets)["preset"]) == ["printed", "A", "B", "C"]
    to = report.Report("x", tmp_path)
    show_full_sngr.record(config, levels, presets, to)
    level = levels[config.p_diagnosed]
    window = full_sngr.example_window(config, level)
    truth, estimate, samples, mean = full_sngr.window_positions(config, level, window, n=50)
    assert truth.shape == estimate.shape == mean.shape == (3, 2)
    assert samples.shape == (50, 3, 2)
    assert 0 < full_sngr.mean_cost(window) < 1
    to_marginal, to_conditional = full_sngr.spread_ratios(level, window)
    assert 0 < to_marginal < to_conditional < 1.5
    fig, axes = plt.subplots(1, 4, figsize=(2 * 4, 2.5))
    show_full_sngr.draw_window_samples(axes[0], truth, estimate, samples, mean)
    show_full_sngr.draw_gains(axes[1], show_full_sngr.per_window(presets, "delta_logp"))
    show_full_sngr.draw_ess(axes[2], show_full_sngr.per_window(presets, "ess_share"))
    show_full_sngr.draw_rmse(axes[3], config.p_levels, show_full_sngr.rmse_series(levels))
    to.figure(fig, "all")


def test_noop_baseline_is_near_its_closed_form(pipeline):
    config, levels = pipeline
    sampled = full_sngr.noop_mean_log_weights(config, levels[config.p_noop])
    expected = full_sngr.noop_expected(config, levels[config.p_noop])
    assert len(sampled) == len(levels[config.p_noop].windows) > 0
    assert np.allclose(sampled, expected, rtol=6 * np.sqrt(2 / config.noop_samples))


def test_pipeline_without_any_trigger_still_reports(tmp_path):
    config = full_sngr.Config(n_poses=6, tau=9.0, p_levels=[0.3], p_diagnosed=0.3, n_live=20)
    levels = full_sngr.run(config)
    assert levels[0.3].windows == []
    assert np.isnan(levels[0.3].median_gain)
    assert levels[0.3].pose_rmse == pytest.approx(levels[0.3].baseline.pose_rmse)
    to = report.Report("x", tmp_path)
    show_full_sngr.record(config, levels, {"A": levels[0.3]}, to)
    to.save()
    tex = latex.latex([files.read_json(tmp_path / "x.json")])["values.tex"]
    assert r"\csname res@sngr.gain_max.A\endcsname{--}" in tex
    assert show_full_sngr.gain_table(levels)["median"][0] == "–"


@pytest.mark.parametrize("name", ["p_diagnosed", "p_noop"])
def test_bad_pipeline_names_the_parameter(name):
    with pytest.raises(ValueError, match=name):
        full_sngr.Config(**{name: 0.25})
    with pytest.raises(ValueError, match="p_levels"):
        full_sngr.Config(p_levels=[0.2, 0.3, 0.3])


# --- 04 ---


@pytest.fixture(scope="module")
def costs():
    config = quick(cost, "04_cost").model_copy(update={"n_poses": 8})
    return config, cost.run(config)


def test_saving_is_total_over_selected(costs):
    _, levels = costs
    for level in levels.values():
        assert level.fired.any()
        n, k = len(level.calls), int(level.fired.sum())
        assert level.saving_calls == pytest.approx(n / k, rel=0.2)
        ran = np.isfinite(level.calls)
        assert ran[level.fired].all()
        assert ran.sum() == k + -(-(n - k) // cost.EVERY)
        assert (level.seconds[ran] > 0).all()
        known = np.where(ran, np.where(level.fired, 2.0, 3.0), np.nan)
        assert level.exhaustive(known) == 2 * k + 3 * (n - k)


def test_selective_windows_are_those_of_the_pipeline():
    """Notebook 04 times the very runs of notebook 03: same streams, same calls."""
    changes = {"n_poses": 8, "p_levels": [0.3], "tau": 3.0, "n_live": 20, "dlogz": 5.0}
    pipeline = full_sngr.run(full_sngr.Config(p_diagnosed=0.3, p_noop=0.3, **changes))[0.3]
    timed = cost.run(cost.Config(**changes))[0.3]
    assert len(pipeline.windows) > 0
    for window in pipeline.windows:
        assert timed.calls[window.t] == window.run.calls


def test_three_ways_to_write_the_closure_agree(costs, tmp_path):
    config, levels = costs
    level = levels[config.p_levels[0]]
    closure = cost.closure_cost(
        config, level, cost.middle_window(levels), rng=np.random.default_rng(0)
    )
    assert closure.largest_difference < 1e-8
    assert closure.all_factors == level.baseline.solution.graph.size()
    assert closure.window_factors == 22
    to = report.Report("x", tmp_path)
    show_cost.record(config, levels, closure, to)
    to.table("cost", show_cost.cost_table(levels), timing=True)
    to.save()
    assert (tmp_path / "x.timings.json").exists()
    assert show_cost.closure_table(levels, closure).shape == (3, 6)
    assert show_cost.calls_table(levels).shape == (1, 6)
    fig, axes = plt.subplots(1, 2, figsize=(2 * 2, 2.5))
    show_cost.draw_saving(axes[0], {"ours": ([4], [2.5]), "printed": ([], [])}, 10)
    to.figure(fig, "all")


def test_more_live_points_cost_more(costs):
    config, levels = costs
    t = cost.middle_window(levels)
    small, large = (
        cost.single_window(config.model_copy(update={"n_live": n}), t) for n in (20, 80)
    )
    assert large.calls > 2 * small.calls
    assert large.log_evidence_error < small.log_evidence_error


def test_bad_cost_names_the_parameter():
    with pytest.raises(ValueError, match="timing_calls"):
        cost.Config(timing_calls=1)
    with pytest.raises(ValueError, match="p_levels"):
        cost.Config(p_levels=[0.1, 0.1])


def test_saving_without_triggers_is_not_a_number():
    assert np.isnan(cost.saving(10.0, 0.0))
