"""Notebook 02: what must hold, and what the paper prints."""

import matplotlib.pyplot as plt
import numpy as np
import pytest

from sngr_utils import trigger_sweep
from sngr_utils.publish import report
from sngr_utils.show import trigger_sweep as show

pytestmark = pytest.mark.usefixtures("house_style")


def test_tau_table_prints_both(paper_sweep):
    table = show.tau_table(paper_sweep)
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
    baseline_table = show.baseline_table(paper_sweep)
    assert baseline_table.shape == (5, 14)
    assert show.clean_table(paper_sweep).shape == (5, 5)
    seeds = show.per_seed_table(paper_sweep)
    assert list(seeds["triggered", "printed"]) == ["14", "8", "0", "10", "0"]
    to = report.Report("x", tmp_path)
    show.record(paper_sweep, to)
    fig, axes = plt.subplots(1, 5, figsize=(2 * 5, 2.5))
    base = paper_sweep.single(0.3)
    show.draw_ranges(axes[0], base, 3)
    show.draw_world(axes[1], base, 3.9)
    show.draw_scores(axes[2], base, 3.9)
    show.draw_nees(axes[3], [0.0, 0.1], [1.0, 2.0], [None, 3.0])
    show.draw_score_boxes(axes[4], [0.0], [base.scores], 3.9)
    to.figure(fig, "all")
    covariance = base.covariances[5]
    shift = trigger_sweep.score_in_units(covariance, 100) - base.scores[5]
    assert shift == pytest.approx(4, abs=0.1)


def test_presets_share_the_data():
    small = trigger_sweep.Config(seeds=[0], p_levels=[0.0, 0.3])
    presets = trigger_sweep.run_presets(small)
    worlds = [sweep.single(0.3).world for sweep in presets.values()]
    assert all(np.array_equal(w.ranges, worlds[0].ranges) for w in worlds)
    table = show.preset_table(presets)
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
