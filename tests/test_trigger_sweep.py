"""Notebook 02: what must hold, and what the paper prints."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import drawn_as_printed, handed_on

from sngr_utils import trigger_sweep
from sngr_utils.publish import report
from sngr_utils.show import style
from sngr_utils.show import trigger_sweep as show
from sngr_utils.show import trigger_sweep_pictures as pictures

pytestmark = pytest.mark.usefixtures("house_style")


def test_tau_table_prints_the_paper_beside_every_preset(paper_presets):
    table = show.tau_table(paper_presets).map(str)
    assert list(table["", ""]) == ["p = 0", "", "", "", "p = 0.3", "", "", ""]
    assert list(table["", "printed"]) == ["–", "0", "0", "0", "–", "21", "14", "8"]
    assert list(table["preset", "B"])[:4] == ["4", "0", "0", "0"]
    ours = trigger_sweep.triggers_by_tau(paper_presets["C"], 0.3)
    assert list(table["preset", "C"])[4:] == [str(n) for n in ours]


@pytest.mark.parametrize("preset", ["A", "B"])
def test_choice_of_tau_follows_the_papers_rule(paper_presets, preset):
    sweep = paper_presets[preset]
    chosen, config = trigger_sweep.choose_tau(sweep), sweep.config
    fired = {t: sweep.single(0.0).detection(t).triggered for t in config.tau_grid}
    caught = {t: sweep.single(0.3).detection(t).triggered for t in config.tau_grid}
    assert fired[chosen] == 0
    for tau in config.tau_grid:
        if fired[tau] == 0:
            assert (caught[chosen], chosen) >= (caught[tau], tau)
    loud = trigger_sweep.Sweep(config.model_copy(update={"tau_grid": [3.0]}), sweep.runs)
    assert trigger_sweep.choose_tau(loud) is None


def test_baseline_trends_of_the_paper(paper_sweep):
    """The error and the NEES grow with p on this world."""
    nees = [paper_sweep.single(p).nees for p in paper_sweep.config.p_levels]
    assert nees == sorted(nees)


@pytest.mark.parametrize(("preset", "blind"), [("A", True), ("B", True), ("C", False)])
def test_the_presets_disagree_on_the_blind_spot_and_on_silence(paper_presets, preset, blind):
    """At p = 0.1 A and B fire nowhere while most windows have failed; C fires, on clean data too.

    Exact counts of one world: no chance of error.
    """
    sweep = paper_presets[preset]
    found = sweep.single(0.1).detection(sweep.config.tau)
    assert found.failed > 20
    assert (found.triggered == 0) is blind
    assert (sweep.single(0.0).detection(sweep.config.tau).triggered == 0) is blind
    assert (trigger_sweep.choose_tau(sweep) is None) is not blind


def test_ranking_is_the_area_of_each_world_and_of_all(paper_sweep):
    within, pooled = trigger_sweep.ranking(paper_sweep, 0.3)
    mixed = [run for run in paper_sweep.level(0.3) if 0 < run.failed[2:].mean() < 1]
    assert 0 < len(mixed) < 5
    pairs = [
        np.mean(run.scores[2:][run.failed[2:]][:, None] > run.scores[2:][~run.failed[2:]])
        for run in mixed
    ]
    assert within == pytest.approx(np.mean(pairs))
    assert pooled < within
    short = trigger_sweep.Sweep(
        paper_sweep.config.model_copy(update={"seeds": [0]}), paper_sweep.runs
    )
    assert np.isnan(trigger_sweep.ranking(short, 0.0)).all()  # nothing failed there


def test_sweep_tables(paper_sweep, paper_presets, tmp_path):
    baseline_table = show.baseline_table(paper_presets)
    assert baseline_table.shape == (8 * 5, 6)
    baseline_table = baseline_table.map(str)
    assert list(baseline_table["", "printed"])[:5] == ["0.15", "1.27", "1.64", "1.82", "4.14"]
    assert baseline_table["preset", "C"][10] == f"{paper_sweep.single(0.0).nees:.1f}"
    clean = show.clean_table(paper_presets).map(str)
    assert list(clean.columns.get_level_values(1)) == ["", "seed", "A", "B", "C"]
    assert clean["preset", "B"][10:].tolist() == ["0", "0", "0", "0", "1"]  # one false alarm
    seeds = show.per_seed_table(paper_presets).map(str)
    assert list(seeds["", "printed"])[:5] == ["14", "8", "0", "10", "0"]
    assert show.ranking_table(paper_presets).shape == (2 * 5, 5)
    to = report.Report("x", tmp_path)
    show.record(paper_sweep, paper_presets, to)
    handed_on(to)
    words = show.words_table(paper_presets).map(str)
    assert words["preset B"].tolist()[:4] == ["4 of 5", "1", "0, 23", "3 of 5"]
    assert words["preset C"].tolist()[:4] == ["0 of 5", "89", "22, 23", "1 of 5"]
    base = paper_sweep.single(0.3)
    shift = trigger_sweep.score_in_units(base.covariances[5], 100) - base.scores[5]
    assert shift == pytest.approx(4, abs=0.1)


def test_sweep_figures(paper_sweep, paper_presets):
    fig, axes = plt.subplots(1, 6, figsize=(2 * 6, 2.5))
    base = paper_sweep.single(0.3)
    pictures.draw_ranges(axes[0], base, 3)
    pictures.draw_world(axes[1], base, 3.9)
    edges = [line for line in axes[1].lines if line.get_zorder() == 0]
    assert len(edges) == len(base.world.ranges)  # a factor, an edge
    wrong = [line for line in edges if line.get_color() == style.TRIGGERED]
    assert len(wrong) == np.sum(base.world.label_of != base.world.source_of)
    pictures.draw_scores(axes[2], base, 3.9)
    assert "printed (14)" in drawn_as_printed(axes[1])
    assert len(drawn_as_printed(axes[2])["printed (14)"][1]) == 0  # a count is no score
    show.draw_areas(axes[2:4], show.ranking_table(paper_presets))
    show.draw_score_boxes(axes[4], [0.0, 0.4], [base.scores] * 2, 3.9)
    assert "printed (fire)" in drawn_as_printed(axes[4])
    assert [text.get_text() for text in axes[4].texts] == ["0", "24"]
    show.draw_worlds(axes[5], paper_presets, "clean")
    heights = np.array([bar.get_height() for bar in axes[5].patches])
    fired = [run.detection(3.96).triggered for sweep in paper_presets.values()
             for run in sweep.level(0.0)]  # fmt: skip
    assert heights.sum() == sum(fired)
    fig.canvas.draw()
    captions = [text for text, _ in pictures.film(paper_sweep, 3.96).pictures]
    assert captions[0] == "p = 0: 0 of 28 windows have failed"
    assert len(captions) == len(paper_sweep.config.p_levels)
    plt.close("all")


def test_presets_share_the_data():
    small = trigger_sweep.Config(seeds=[0], p_levels=[0.0, 0.3])
    sweep = trigger_sweep.run(small)
    presets = trigger_sweep.run_presets(small, sweep)
    assert presets["C"] is sweep
    worlds = [sweep.single(0.3).world for sweep in presets.values()]
    assert all(np.array_equal(w.ranges, worlds[0].ranges) for w in worlds)
    table = show.baseline_table(presets).map(str)
    assert list(table["", "p"])[:2] == ["0", "0.3"]
    assert table["preset", "A"][2] == "–"  # one seed has no standard deviation
    changed = small.model_copy(update={"conventions": {"landmark_prior_sigma": 1.0}})
    assert changed.under("C") == small


@pytest.mark.parametrize(
    ("changes", "name"),
    [({"p_levels": [0.0, 0.2]}, "p_noisy"), ({"seeds": [0, 0]}, "seeds"), ({"seeds": []}, "seeds"),
     ({"preset": "Z"}, "preset"), ({"conventions": {"x": 1}}, "x"), ({"tau": -1.0}, "tau"),
     ({"p_levels": [0.0, 0.3, 1.5]}, "p_levels")],
)  # fmt: skip
def test_bad_sweep_names_the_parameter(changes, name):
    with pytest.raises(ValueError, match=name):
        trigger_sweep.Config(**changes)
