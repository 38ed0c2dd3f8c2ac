"""Notebook 03 on small parameters: what must hold."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import drawn_as_printed, handed_on, quick_config

from sngr_utils import full_sngr
from sngr_utils.metrics.effective_sample_size import effective_sample_size
from sngr_utils.publish import files, latex, report
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.show import full_sngr as show
from sngr_utils.slam import equations
from sngr_utils.sngr import gate

pytestmark = pytest.mark.usefixtures("house_style")


@pytest.fixture(scope="module")
def pipeline():
    config = quick_config("03_full_sngr").model_copy(update={"n_live": 20, "dlogz": 5.0})
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
    presets = full_sngr.run_presets(config, levels)
    assert presets["C"] is levels
    assert list(presets) == ["A", "B", "C"]
    table = show.sngr_table(config, presets).map(str)
    assert table.shape == (8, 6)
    assert table["", "printed"][1] == "3.81"
    assert table["preset", "C"][1] == f"{levels[0.3].pose_rmse:.2f}"
    assert show.gain_table(levels).shape[0] == 1
    gains = show.preset_table(config, presets)
    assert list(gains) == ["", "printed", "preset A", "preset B", "preset C"]
    assert gains["preset C"][0] == len(levels[config.p_diagnosed].windows)
    to = report.Report("x", tmp_path)
    show.record(config, levels, presets, to)
    handed_on(to)
    level = levels[config.p_diagnosed]
    window = full_sngr.example_window(config, level)
    truth, estimate, samples, mean = full_sngr.window_positions(config, level, window, n=50)
    assert truth.shape == estimate.shape == mean.shape == (3, 2)
    assert samples.shape == (50, 3, 2)
    assert 0 < window.expected_loss < 1
    to_marginal, to_conditional = level.spread_ratios(window)
    assert 0 < to_marginal < to_conditional < 1.5
    fig, axes = plt.subplots(1, 6, figsize=(2 * 6, 2.5))
    show.draw_window_samples(axes[0], truth, estimate, samples, mean)
    show.draw_gains(axes[1], show.per_window(config, presets, "delta_logp"))
    show.draw_ess(axes[2], show.per_window(config, presets, "ess_share"))
    show.draw_rmse(axes[3], config.p_levels, show.rmse_series(levels))
    gains = drawn_as_printed(axes[1])
    assert gains["printed peak"] == ([17], [5.04])
    assert gains["printed least"][1] == [1.0, 1.0]
    assert drawn_as_printed(axes[2])["printed"][1] == [0.5, 0.5]
    assert "printed (SNGR)" in drawn_as_printed(axes[3])
    show.draw_losses(axes[4], {10: np.ones(3), 100: np.ones(3)}, 9, 0.001, 40.0)
    show.draw_step_gains(axes[5], [0.1, 2.0], [0.2, 2.5])
    show.draw_step_gains(plt.figure().add_subplot(), [], [])  # where no window fires
    to.figure(fig, "all")


def test_noop_baseline_is_near_its_closed_form(pipeline):
    config, levels = pipeline
    sampled, expected = full_sngr.noop_means(config, levels[config.p_noop])
    assert len(sampled) == len(levels[config.p_noop].windows) > 0
    n = config.noop_samples * len(sampled)  # the quadratic form's relative variance is 2 at most
    assert np.mean(sampled / expected) == pytest.approx(1, abs=5 * np.sqrt(2 / n))


def test_pipeline_without_any_trigger_still_reports(tmp_path):
    config = full_sngr.Config(n_poses=6, tau=9.0, p_levels=[0.3], p_diagnosed=0.3, n_live=20)
    levels = full_sngr.run(config)
    assert levels[0.3].windows == []
    assert np.isnan(levels[0.3].median_gain)
    assert levels[0.3].pose_rmse == pytest.approx(levels[0.3].baseline.pose_rmse)
    to = report.Report("x", tmp_path)
    show.record(config, levels, {"B": levels, "C": levels}, to)
    to.save()
    tex = latex.latex([files.read_json(tmp_path / "x.json")])["values.tex"]
    assert r"\csname res@sngr.gain_max.C\endcsname{--}" in tex
    assert str(show.gain_table(levels)["median"][0]) == "–"


@pytest.mark.parametrize("name", ["p_diagnosed", "p_noop"])
def test_bad_pipeline_names_the_parameter(name):
    with pytest.raises(ValueError, match=name):
        full_sngr.Config(**{name: 0.25})
    with pytest.raises(ValueError, match="p_levels"):
        full_sngr.Config(p_levels=[0.2, 0.3, 0.3])


# --- the gate and Algorithm 1 from scratch -------------------------------------------------------


@pytest.fixture(scope="module")
def compiled():
    """The level that the notebook diagnoses, by the compiled sampler."""
    config = full_sngr.Config(engine="nested")
    return config, full_sngr.run_level(config, config.p_diagnosed)


def test_a_mean_loses_half_its_dimensions_over_its_samples(from_scratch):
    """chi^2_d / 2n: mean and variance, each at five standard errors (6e-7 for both)."""
    d, n, repeats = 9, 20, 4000
    lost = from_scratch["losses"](n, d, repeats, np.random.default_rng(0)) * 2 * n
    assert abs(lost.mean() - d) < 5 * np.sqrt(2 * d / repeats)
    fourth = 12 * d * (d + 4)  # fourth central moment of chi^2_d
    assert abs(lost.var() - 2 * d) < 5 * np.sqrt((fourth - 4 * d**2) / repeats)


def test_the_gate_from_scratch_is_the_librarys(from_scratch):
    def bowl(x):
        return -0.5 * float(x @ x)

    for length in (0.0, 0.04, 0.05):
        mean = np.array([length, 0.0])
        assert from_scratch["passes"](bowl, mean, 1e-3) == gate.passes_gate(bowl(mean), 1e-3)
    weights = np.random.default_rng(0).random(50)
    ours = from_scratch["effective"](weights)
    assert ours == pytest.approx(effective_sample_size(weights / weights.sum()))


def test_algorithm_1_from_scratch_is_the_librarys(from_scratch, compiled):
    config, level = compiled
    base, streams = level.baseline, np.random.default_rng([config.seed, 1]).spawn(28)
    settings = config.part(SamplerSettings)

    def sample(t, log_density, covariance):
        run = engines.sample_window(log_density, covariance, settings, "nested", rng=streams[t])
        return run.samples, run.weights

    refined, fired, accepted = from_scratch["algorithm_1"](
        base.solution.poses, base.covariances, lambda t: full_sngr.likelihood_of(config, level, t),
        sample, config.tau, config.gate_tolerance,
    )  # fmt: skip
    assert fired == [window.t for window in level.windows]
    assert accepted == [window.t for window in level.windows if window.accepted]
    assert np.allclose(refined[:, :2], level.poses[:, :2])
    assert np.allclose(np.exp(1j * refined[:, 2]), np.exp(1j * level.poses[:, 2]))


def test_one_gauss_newton_step_gains_what_sampling_gains_or_more(from_scratch, compiled):
    """The finding of notebook 03, on the world of the paper."""
    config, level = compiled
    solution = level.baseline.solution
    J, right = equations.linearised(solution, solution.estimate)
    ratios = []
    for window in level.windows:
        log_density = full_sngr.likelihood_of(config, level, window.t)
        step = from_scratch["one_step"](J, right, window.t)
        ratios.append(window.delta_logp / (log_density(step) - log_density(np.zeros(9))))
    assert max(ratios) < 1
    assert min(ratios) > 0.4
    assert np.median(ratios) > 0.75
