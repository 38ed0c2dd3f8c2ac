import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import handed_on

from sngr_utils import paths, peers
from sngr_utils.experiments import estimators, one_range
from sngr_utils.publish import cells, parameters, report
from sngr_utils.robust import losses
from sngr_utils.show import peers as show
from sngr_utils.show import style
from sngr_utils.slam import conventions, range_loss
from sngr_utils.world import simulation


@pytest.fixture(scope="module")
def quick():
    given = parameters.read_params("07_peers", paths.PARAMS / "quick")
    return peers.Config(**{**given, "jobs": 1, "n_seeds": 2, "n_poses": 15})


@pytest.fixture(scope="module")
def runs(quick):
    return peers.run(quick)


def test_every_method_from_every_start_it_has(quick, runs):
    n = len(quick.p_levels) * quick.n_seeds
    assert (runs[runs["start"] != "first_poses"].groupby("method").size() == n).all()
    other = runs[runs["start"] == "first_poses"]
    assert not set(other["method"]) & set(estimators.WITHOUT_START)
    assert set(other["p"]) == set(quick.p_starts)


def test_losses_and_weights_fit_each_other():
    """w(r) = rho'(r) / r for every kernel, away from the kinks of the truncated ones."""
    r, h = np.array([0.3, 0.8, 1.2, 2.0, 4.0, 5.5]), 1e-5
    scenario = peers.Config().scenario
    up, at, down = (one_range.kernels(r + step, scenario) for step in (h, 0.0, -h))
    assert len(at) == 8
    for name, (_, weight) in at.items():
        slope = (up[name][0] - down[name][0]) / (2 * h)
        assert np.allclose(slope / r, weight, atol=1e-4), name


def test_the_square_settles_where_no_range_is_and_the_others_among_most():
    x = np.linspace(2.6, 4.4, 1801)
    ranges, costs = peers.pull(peers.Config(), x)
    best = {name: x[np.argmin(cost)] for name, cost in costs.items()}
    assert best.pop("least_squares") == pytest.approx(ranges.mean(), abs=1e-3)
    assert np.abs(ranges - ranges.mean()).min() > 0.1
    for name, place in best.items():
        assert abs(place - 3) < (0.1 if name == "huber" else 0.05), name


def test_convex_losses_have_one_minimum_and_those_that_forget_a_second_at_the_wrong_group():
    x = np.linspace(2.6, 4.4, 361)
    _, costs = peers.pull(peers.Config(), x)
    for name, cost in costs.items():
        found = x[1:-1][(cost[1:-1] < cost[:-2]) & (cost[1:-1] <= cost[2:])]
        assert len(found) == 1 + (name not in ("least_squares", "huber", "cauchy")), name
        assert len(found) == 1 or abs(found[1] - 4) < 0.1


@pytest.mark.parametrize("method", ["cauchy", "gnc_tls"])
def test_reweighting_from_scratch_is_that_of_the_library(from_scratch, method):
    """Poses that are known to a hundredth of a millimetre leave the landmarks to be estimated."""
    exact = {"odometry_sigma_xy": 1e-5, "odometry_sigma_theta": 1e-5}
    scenario = peers.Config().scenario.model_copy(update=exact)
    drawn = simulation.simulate(scenario, 0.4, rng=np.random.default_rng(100))
    nearly = conventions.PRESETS["C"].model_copy(update={"landmark_prior_sigma": 1e3})
    start = np.tile(drawn.poses[:, :2].mean(axis=0), (drawn.n_landmarks, 1))
    if method == "cauchy":  # which has several minima, and the first round of ours chooses
        start = drawn.landmarks
    log = drawn.log(np.full(3, 1e-5))
    library = losses.solve(log, nearly, method, (drawn.poses, start)).landmarks
    for k in range(drawn.n_landmarks):
        mine = drawn.label_of == k
        data = drawn.poses[drawn.pose_of[mine], :2], drawn.ranges[mine], scenario.range_sigma
        weigh = from_scratch["cauchy"]
        if method == "gnc_tls":
            weigh = from_scratch["truncated"](data, start[0])
        place, _ = from_scratch["reweight"](data, start[0], weigh)
        assert place == pytest.approx(library[k], abs=1e-3), k


def test_weights_from_scratch_are_those_of_the_library(from_scratch):
    r = np.array([-7.0, -2.0, 0.1, 1.0, 3.0, 20.0])
    library = [range_loss.weight(losses.LOSSES["cauchy"], x) for x in r]
    assert from_scratch["cauchy"](r, 0) == pytest.approx(library)


def test_cauchy_settles_in_rounds_and_stays_soft_and_gnc_takes_many_and_decides(from_scratch):
    config = peers.Config()
    rng = np.random.default_rng(config.first_seed)
    drawn = simulation.simulate(config.scenario, max(config.p_levels), rng=rng)
    mine = drawn.label_of == 0
    data = drawn.poses[drawn.pose_of[mine], :2], drawn.ranges[mine], config.range_sigma
    start, wrong = drawn.poses[:, :2].mean(axis=0), drawn.source_of[mine] != 0
    scratch = from_scratch
    _, soft = scratch["reweight"](data, start, scratch["cauchy"])
    _, hard = scratch["reweight"](data, start, scratch["truncated"](data, start))
    assert np.abs(soft[8] - soft[-1]).max() < 0.01
    assert np.any((soft[-1][wrong] > 0.1) & (soft[-1][wrong] < 0.9))
    assert (hard[1] < 0.1).mean() > 0.9
    assert np.abs(hard[20] - hard[-1]).max() > 0.4
    kept = (soft[-1][wrong] > 0.9) & (hard[-1][wrong] == 1)
    assert kept.sum() == 1


def test_peer_tables_figures_and_values(quick, runs, tmp_path):
    n_methods, n_levels = len(estimators.METHODS), len(quick.p_levels)
    assert show.by_method(runs, "ratio").shape == (n_methods, 1 + n_levels)
    assert show.start_table(runs).shape == (
        n_methods - len(estimators.WITHOUT_START),
        1 + 2 * len(quick.p_starts),
    )
    table = show.test_table(runs, peers.BEST)
    assert table.shape == (n_methods, 1 + 4)  # one level above zero
    assert (table.iloc[:, 2] == cells.NONE).sum() == 1
    assert len(show.time_table(runs)) == n_methods
    to = report.Report("x", tmp_path)
    show.record(quick, runs, to)
    saved = handed_on(to)
    assert saved["peers.cauchy.grid.p0.4.ratio"]["value"] >= 1
    assert saved["peers.em.first_poses.p0.4.lost"]["unit"] == "%"
    some = show.medians_of(runs, "nees", ["huber", "oracle"])
    oracle = runs.query("method == 'oracle' and p == 0")["nees"]
    assert some.iloc[1, 1].numbers[0] == oracle.median()
    style.use_style()
    x = np.linspace(2, 4, 11)
    fig, axes = style.panels(10, 2.5, 5)
    ranges, costs = peers.pull(quick, x)
    show.draw_pull(axes[0], ranges, one_range.N_WRONG, x, costs)
    show.draw_curves(axes[1], x, costs, xlabel="x")
    show.legend_right(axes[1])
    show.draw_weights(axes[2], np.array([[1.0, 1.0], [1.0, 0.0]]), np.array([False, True]))
    show.draw_ratios(axes[3], show.ratio_series(runs, "landmark_ratio"), of="landmark")
    show.draw_starts(axes[4], runs)
    to.figure(fig, "all")
    plt.close(fig)


@pytest.mark.parametrize(
    ("name", "value"),
    [("n_seeds", 1), ("p_starts", [0.15]), ("p_levels", [0.2, 0.2]), ("n_particles", 1),
     ("p_levels", [0.0]), ("jobs", 0)],
)  # fmt: skip
def test_bad_parameters_are_named(name, value):
    with pytest.raises(ValueError, match=name):
        peers.Config(**{name: value})
