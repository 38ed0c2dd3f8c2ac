import numpy as np
import pytest
from helpers import handed_on

from sngr_utils import association_aware
from sngr_utils.experiments import estimators, online_variants
from sngr_utils.publish import report
from sngr_utils.show import association_aware as show
from sngr_utils.show import style

CONFIG = association_aware.Config(
    n_seeds=2,
    p_levels=[0.0, 0.4],
    p_peers=[0.4],
    n_ablation=2,
    n_slip=2,
    jobs=1,
    n_poses=16,
)


@pytest.fixture(scope="module")
def runs():
    return association_aware.run(CONFIG)


def test_all_meet_the_same_worlds(runs):
    """Peers at their levels only, ours, EM and the oracle at all."""
    counts = runs.groupby(["method", "p"]).size().unstack()
    assert (counts[0.4] == 2).all()
    kept = set(counts.index[counts[0.0].notna()])
    assert kept == {online_variants.NAME, estimators.BATCH, "oracle"}
    assert (runs.loc[runs["method"] == "oracle", "ratio"] == 1).all()


def test_tables_hold_what_the_frame_holds(runs):
    goal = show.goal_table(runs).map(str)
    ours = runs[(runs["method"] == online_variants.NAME) & (runs["p"] == 0.4)]
    assert goal.iloc[1]["online: ratio"] == f"{ours['ratio'].mean():.3f}"
    assert len(show.test_table(runs)) == runs["method"].nunique() - 2  # ours, the oracle
    counts = show.counts_table(runs, 14).map(str)
    share = 100 * (ours["position samples"] + ours["landmark samples"]).mean() / 14
    assert counts.iloc[1]["nested sampling", "% of windows"] == f"{share:.1f}"
    asked = ours["landmark questions"].mean()
    assert counts.iloc[1]["many starts", "landmark"] == f"{asked:.1f}"


def test_p_values_are_those_of_the_paired_test_and_never_smaller(runs):
    """Of all tests the largest p-value is as it was (Benjamini and Hochberg)."""
    table = show.test_table(runs).set_index(("", "method"))
    (p,) = [p for p in dict.fromkeys(runs.loc[runs["method"] == "huber", "p"]) if p > 0]
    found = table[f"p = {p:g}", "p-value"].map(lambda cell: cell.numbers[0])
    peers = [m for m in estimators.METHODS if m != "oracle"]
    chosen = runs[runs["p"] == p]
    raw = [estimators.paired(chosen, m, online_variants.NAME)["p_value"].iloc[0] for m in peers]
    assert (found >= np.array(raw) * (1 - 1e-12)).all()
    assert found.max() == pytest.approx(max(raw))


def test_summary_draws_every_method(runs):
    series = show.summary_series(runs)
    assert len(series) == runs["method"].nunique() - 1
    assert set(show.NAMED) <= set(series)
    _, ax = style.figure()
    show.draw_summary(ax, series)
    assert len(ax.containers) == len(show.NAMED)
    grey = len(series) - len(show.NAMED)
    assert show.FORGETTING.startswith({7: "seven", 8: "eight", 9: "nine"}[grey])


def test_few_poses_are_many_places_and_more_are_one():
    masses = [panel[-1] for panel in association_aware.few_poses(association_aware.Config())]
    assert masses[0] < 0.7
    assert masses[-1] > 0.9


def test_what_is_recorded_is_what_was_run(runs, tmp_path):
    slips = association_aware.run_slips(CONFIG)
    paper = report.Report("08_association_aware", tmp_path)
    show.record(CONFIG, runs, slips, paper)
    handed = handed_on(paper)
    ours = runs[(runs["method"] == online_variants.NAME) & (runs["p"] == 0.4)]
    assert handed["online.p0.4.ratio"]["value"] == pytest.approx(ours["ratio"].mean())
    lost = (slips.loc[slips["method"] == online_variants.NAME, "ratio"] > 1.5).sum()
    assert handed["online.slip.online.lost"]["value"] == lost
    assert all(np.isfinite(entry["value"]) for entry in handed.values())


def test_bad_parameters_are_named():
    for change, name in (
        ({"p_peers": [0.3]}, "p_peers"), ({"p_levels": [0.1, 0.1]}, "p_levels"),
        ({"slip_steps": 30}, "slip_steps"), ({"n_poses": 10}, "n_poses"), ({"n_slip": 1}, "n_slip"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=name):
            association_aware.Config(**{**CONFIG.model_dump(), **change})
