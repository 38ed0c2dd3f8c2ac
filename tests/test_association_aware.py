import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
import pytest
from helpers import handed_on

from sngr_utils import association_aware
from sngr_utils.experiments import estimators, online_variants, studies
from sngr_utils.publish import report
from sngr_utils.robust import association, em
from sngr_utils.show import association_aware as show
from sngr_utils.show import association_pictures as pictures
from sngr_utils.show import style
from sngr_utils.slam import conventions
from sngr_utils.world import simulation

CONFIG = association_aware.Config(
    n_seeds=2,
    p_levels=[0.0, 0.4],
    p_peers=[0.4],
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
    assert goal.iloc[1][show.KINDS["ratio"]] == f"{ours['ratio'].median():.2f}"
    detail = show.detail_table(runs).map(str)
    assert detail.iloc[1]["p, estimated"] == f"{ours['p_found'].mean():.2f}"
    assert len(show.test_table(runs)) == runs["method"].nunique() - 2 - len(association_aware.SLOW)
    counts = show.counts_table(runs, 14).map(str)
    share = 100 * (ours["position samples"] + ours["landmark samples"]).mean() / 14
    assert counts.iloc[1]["nested sampling", "% of windows"] == f"{share:.1f}"
    asked = ours["landmark questions"].mean()
    assert counts.iloc[1]["many starts", "landmark"] == f"{asked:.1f}"


def test_a_world_far_off_moves_no_median():
    """The interval runs from the second of ten to the ninth."""
    ratio = [*range(1, 10), 1000.0]
    world = pd.DataFrame({"p": 0.4, "ratio": ratio, "pose_rmse": ratio, "landmark_rmse": ratio})
    parts = [world.assign(method=m, nets=n) for m in online_variants.PARTS for n in (True, False)]
    table = show.ablation_table(pd.concat(parts)).map(str)
    assert table.shape == (len(online_variants.PARTS), 5)
    assert (table["p = 0.4, without", "median"] == "5.50 [2.00, 9.00]").all()
    assert (table["p = 0.4, without", "worst"] == "1000.00").all()
    slips = show.slip_table(world.assign(method="oracle")).map(str).iloc[0]
    assert slips["RMSE [m]"] == slips["over the oracle's"] == "5.50 [2.00, 9.00]"
    assert (slips["landmarks [m]"], slips["lost"]) == ("5.50", "9 of 10")


def test_like_is_compared_with_like(runs):
    """The oracle is at one in every kind; a filtered pose is worse than a smoothed one."""
    oracle = runs[(runs["method"] == "oracle") & (runs["p"] == CONFIG.p_film)]
    assert np.allclose(oracle[["ratio", "landmark_ratio", "filtered"]], 1)
    ours = runs[runs["method"] == online_variants.NAME]
    at = oracle.set_index("seed").loc[ours["seed"]]
    assert np.allclose(ours["filtered"] * at["filtered_rmse"].to_numpy(), ours["filtered_rmse"])
    assert np.allclose(ours["graph"] * ours["oracle_rmse"], ours["graph_rmse"])
    batch = runs[(runs["method"] == estimators.BATCH) & (runs["p"] == CONFIG.p_film)]
    assert batch["filtered"].notna().all()


def test_p_values_are_those_of_the_paired_test_and_never_smaller(runs):
    """Of all tests the largest p-value is as it was (Benjamini and Hochberg)."""
    table = show.test_table(runs).set_index(("", "method"))
    (p,) = [p for p in dict.fromkeys(runs.loc[runs["method"] == "huber", "p"]) if p > 0]
    found = table[f"p = {p:g}", "p-value"].map(lambda cell: cell.numbers[0])
    peers = [m for m in estimators.METHODS if m not in ("oracle", *association_aware.SLOW)]
    chosen = runs[runs["p"] == p]
    raw = [estimators.paired(chosen, m, online_variants.NAME)["p_value"].iloc[0] for m in peers]
    assert (found >= np.array(raw) * (1 - 1e-12)).all()
    assert found.max() == pytest.approx(max(raw))


def test_figures_draw_every_method_variant_and_range(runs, ablation, from_scratch):
    series = show.summary_series(runs)
    assert len(series) == runs["method"].nunique() - 1
    fig, axes = style.panels(7, 3, 5)
    show.draw_summary(axes[:2], series, fig)
    assert all(len(ax.containers) == len(series) for ax in axes[:2])
    show.draw_ablation(axes[:2], ablation)
    show.draw_kinds(axes[2], runs[runs["p"] == 0.4])
    assert len(axes[2].lines) == 4 * len(show.KINDS) - 2 + 1  # no graph of EM in batch; the oracle
    scan = association_aware.ambiguous(CONFIG)
    pictures.draw_scan(axes[3], scan)
    pictures.draw_shares(axes[4], from_scratch["alone"](of_scan(scan, from_scratch)), scan)
    assert len(axes[4].texts) >= len(scan.ranges)
    plt.close(fig)


# --- associations and EM from scratch ------------------------------------------------------------


def of_scan(scan, names):
    at = scan.position, scan.landmarks, (scan.ranges, scan.labels)
    return names["joint"](*at, scan.wrong, CONFIG.range_sigma)


def test_the_open_range_is_divided_and_belongs_to_its_scan():
    scan = association_aware.ambiguous(CONFIG)
    assert len(scan.ranges) == len(scan.labels) == len(scan.sources) == CONFIG.n_landmarks
    assert len(set(scan.sources)) == CONFIG.n_landmarks  # each landmark is seen once


def test_alone_the_true_source_is_ahead_and_exclusion_favours_a_swap(from_scratch):
    scan = association_aware.ambiguous(association_aware.Config())
    weights = of_scan(scan, from_scratch)
    true = scan.sources[scan.open]
    assert from_scratch["alone"](weights)[scan.open].argmax() == true
    found = from_scratch["exclusive"](weights)
    got = found[scan.open].argmax()
    assert got != true
    assert found[scan.open, got] > 0.5
    other = list(scan.sources).index(got)
    assert found[other].argmax() == true


def test_from_labels_a_metre_off_em_finds_landmarks_and_the_drawn_share(from_scratch):
    drawn = association_aware.first_world(association_aware.Config())
    positions, mine = drawn.poses[drawn.pose_of, :2], np.eye(drawn.n_landmarks)[drawn.label_of]
    centre = positions.mean(axis=0)
    start = np.array([from_scratch["fit"](positions, drawn.ranges, own, centre) for own in mine.T])
    assert 0.8 < np.linalg.norm(start - drawn.landmarks, axis=1).mean() < 1.2  # m
    landmarks, p, _ = from_scratch["em"](drawn, 0.1, start, from_scratch["alone"])
    assert np.linalg.norm(landmarks - drawn.landmarks, axis=1).max() < 0.1
    assert p == pytest.approx(np.mean(drawn.label_of != drawn.source_of), abs=0.02)


@pytest.mark.parametrize("exclusive", [False, True])
def test_associations_from_scratch_are_those_of_the_library(from_scratch, exclusive):
    drawn = association_aware.first_world(CONFIG)
    log = drawn.log(conventions.PRESETS["C"].x0_sigmas)
    shares = association.Shares(0.3, 0.0)
    library = association.responsibilities(
        log, drawn.poses, drawn.landmarks, shares, 1.0, exclusive
    )
    assert library[:, -1] == pytest.approx(0)
    for t in (0, 7):
        here = drawn.pose_of == t
        scan = drawn.ranges[here], drawn.label_of[here]
        weights = from_scratch["joint"](drawn.poses[t, :2], drawn.landmarks, scan, 0.3, 0.1)
        found = from_scratch["exclusive" if exclusive else "alone"](weights)
        assert found == pytest.approx(library[here, :-1], abs=1e-9)


def test_em_from_scratch_is_that_of_the_library(from_scratch):
    """Poses that are known to a hundredth of a millimetre leave the landmarks to be estimated."""
    exact = {"odometry_sigma_xy": 1e-5, "odometry_sigma_theta": 1e-5}
    scenario = CONFIG.scenario.model_copy(update=exact)
    drawn = simulation.simulate(scenario, 0.4, rng=np.random.default_rng(100))
    nearly = conventions.PRESETS["C"].model_copy(update={"landmark_prior_sigma": 1e3})
    start = drawn.landmarks + 0.3
    library = em.fit(
        drawn.log(np.full(3, 1e-5)), nearly, (drawn.poses, start), exclusive=True, clutter=False
    )
    found, p, _ = from_scratch["em"](drawn, 0.1, start, from_scratch["exclusive"])
    assert found == pytest.approx(library.landmarks, abs=2e-3)
    assert p == pytest.approx(library.shares.wrong, abs=2e-3)


@pytest.fixture(scope="module")
def ablation(runs):
    """As if every variant did what the whole method does; the runs themselves take long."""
    ours = runs[(runs["method"] == online_variants.NAME) & (runs["p"] == 0.4)]
    parts = [(name, nets) for name in online_variants.PARTS for nets in (True, False)]
    return pd.concat([ours.assign(method=name, nets=nets) for name, nets in parts])


def test_no_world_without_a_part_lies_beyond_the_axes():
    rows = studies.committed("ablation")
    fig, axes = style.panels(7, 3, 2)
    show.draw_ablation(axes, rows)
    for ax in axes:
        low, high = ax.get_xlim()
        assert low < rows["ratio"].min()
        assert rows["ratio"].max() < high
    plt.close(fig)


def test_what_is_recorded_is_what_was_run(runs, ablation, tmp_path):
    slips = association_aware.run_slips(CONFIG)
    paper = report.Report("08_association_aware", tmp_path)
    show.record(CONFIG, runs, ablation, slips, paper)
    handed = handed_on(paper)
    ours = runs[(runs["method"] == online_variants.NAME) & (runs["p"] == 0.4)]
    assert handed["online.p0.4.ratio"]["value"] == pytest.approx(ours["ratio"].mean())
    lost = (slips.loc[slips["method"] == online_variants.NAME, "ratio"] > 1.5).sum()
    assert handed["online.slip.online.lost"]["value"] == lost
    assert all(np.isfinite(entry["value"]) for entry in handed.values())


def test_bad_parameters_are_named():
    for change, name in (
        ({"p_peers": [0.3]}, "p_peers"), ({"p_film": 0.2}, "p_film"),
        ({"p_levels": [0.1, 0.1]}, "p_levels"), ({"p_peers": [0.0], "p_film": 0.0}, "p_peers"),
        ({"slip_steps": 30}, "slip_steps"), ({"n_poses": 10}, "n_poses"), ({"n_slip": 1}, "n_slip"),
        ({"n_landmarks": 9}, "n_landmarks"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=name):
            association_aware.Config(**{**CONFIG.model_dump(), **change})
