"""Notebook 03 on small parameters: what must hold."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import handed_on, quick_config

from sngr_utils import full_sngr
from sngr_utils.publish import files, latex, report
from sngr_utils.show import full_sngr as show

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
    fig, axes = plt.subplots(1, 4, figsize=(2 * 4, 2.5))
    show.draw_window_samples(axes[0], truth, estimate, samples, mean)
    show.draw_gains(axes[1], show.per_window(config, presets, "delta_logp"))
    show.draw_ess(axes[2], show.per_window(config, presets, "ess_share"))
    show.draw_rmse(axes[3], config.p_levels, show.rmse_series(levels))
    to.figure(fig, "all")


def test_noop_baseline_is_near_its_closed_form(pipeline):
    config, levels = pipeline
    sampled, expected = full_sngr.noop_means(config, levels[config.p_noop])
    assert len(sampled) == len(levels[config.p_noop].windows) > 0
    assert np.allclose(sampled, expected, rtol=6 * np.sqrt(2 / config.noop_samples))


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
