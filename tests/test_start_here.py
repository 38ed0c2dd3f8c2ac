"""Notebook 00: what its cells compute, against GTSAM, SciPy and closed forms."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import cells_from_scratch
from scipy import integrate
from stored_results import said

from sngr_utils import paths, start_here
from sngr_utils.publish import files, report
from sngr_utils.show import start_here as show

pytestmark = pytest.mark.usefixtures("house_style")

NAMES = ["x0", "x1", "x2", "x3", "x4", "l1", "l2"]
ORDER = ["x0", "x1", "l1", "x4", "x3", "l2", "x2"]


@pytest.fixture(scope="module")
def lesson():
    """What the cells that are tagged "from-scratch" define, run in order with the parameters."""
    config = start_here.Config(grid_step=0.05)
    made = {"start_here": start_here, "config": config, "drive": config.draw()}
    return cells_from_scratch("00_start_here", **made, **config.model_dump())


@pytest.fixture(scope="module")
def start(lesson):
    return np.concatenate([lesson["drive"].dead_reckoning, [[1.0, 2.0], [7.0, 2.0]]]).ravel()


def test_fused_gaussians_are_the_normalised_product(lesson):
    mean, sigma = lesson["fuse"]([3.0, 4.0], [0.2, 0.4])
    x = np.linspace(2, 5, 31)
    product = lesson["gaussian"](x, 3.0, 0.2) * lesson["gaussian"](x, 4.0, 0.4)
    ratio = product / lesson["gaussian"](x, mean, sigma)
    assert np.allclose(ratio, ratio[0], rtol=1e-10)


def test_the_grid_has_the_mass_that_quadrature_finds(lesson):
    """One dimension by SciPy, the other by the same sum: two ways to the same integral."""
    drive, config = lesson["drive"], lesson["config"]
    ranges, guess = drive.ranges[drive.pose_of == 2], drive.dead_reckoning[2]

    def density(y, x):
        rho = np.linalg.norm(np.array([x, y]) - start_here.LANDMARKS, axis=1)
        squares = np.sum(((rho - ranges) / config.range_sigma) ** 2)
        return np.exp(-0.5 * (squares + np.sum((np.array([x, y]) - guess) ** 2) / 2.0**2))

    below, above = (
        integrate.dblquad(density, 3, 5, low, high, epsabs=1e-5)[0]
        for low, high in ((-1, 2), (3, 6))
    )
    assert lesson["upper_mass"] == pytest.approx(above / (above + below), abs=1e-3)
    assert lesson["posterior"].sum() == pytest.approx(1)


def gtsam_graph(drive, config):
    """The drive as GTSAM has it, with its keys in the order of `NAMES`."""
    import gtsam

    keys = [gtsam.symbol(name[0], int(name[1])) for name in NAMES]
    graph, noise = gtsam.NonlinearFactorGraph(), gtsam.noiseModel.Isotropic.Sigma
    first = noise(2, config.start_sigma)
    graph.add(gtsam.PriorFactorPoint2(keys[0], start_here.POSES[0], first))
    for t, motion in enumerate(drive.odometry):
        step = noise(2, config.odometry_sigma)
        graph.add(gtsam.BetweenFactorPoint2(keys[t], keys[t + 1], motion, step))
    for t, k, z in zip(drive.pose_of, drive.label_of, drive.ranges, strict=True):
        graph.add(gtsam.RangeFactor2(keys[t], keys[5 + k], z, noise(1, config.range_sigma)))
    return graph, keys


@pytest.mark.parametrize("wrong", [None, *range(6)])
def test_a_fitted_drive_is_gtsams(lesson, start, wrong):
    """Estimate, cost and the joint covariance's blocks, with right labels and each wrong one."""
    import gtsam

    drive = lesson["drive"] if wrong is None else lesson["drive"].credited_wrongly(wrong)
    cost, end, covariance = lesson["fit"](drive, start)
    graph, keys = gtsam_graph(drive, lesson["config"])
    values = gtsam.Values()
    for key, place in zip(keys, end.reshape(-1, 2), strict=True):
        values.insert(key, place)
    assert cost == pytest.approx(graph.error(values))
    best = gtsam.LevenbergMarquardtOptimizer(graph, values).optimize()
    marginals = gtsam.Marginals(graph, best)
    for number, key in enumerate(keys):
        block = slice(2 * number, 2 * number + 2)
        assert np.allclose(end[block], best.atPoint2(key), atol=1e-3)
        assert np.allclose(covariance[block, block], marginals.marginalCovariance(key), rtol=0.02)


@pytest.mark.parametrize("wrong", [None, 0, 5])
@pytest.mark.parametrize("order", [ORDER, NAMES, NAMES[::-1]])
def test_elimination_and_bayes_tree_are_gtsams(lesson, start, wrong, order):
    """The separators of its conditionals, and the sets of variables that are cliques.

    Which of two cliques with the same separator becomes the root is a matter of taste.
    """
    import gtsam

    drive = lesson["drive"] if wrong is None else lesson["drive"].credited_wrongly(wrong)
    graph, keys = gtsam_graph(drive, lesson["config"])
    name_of = dict(zip(keys, NAMES, strict=True))
    values = gtsam.Values()
    for key, place in zip(keys, start.reshape(-1, 2), strict=True):
        values.insert(key, place)
    ordering = gtsam.Ordering()
    for name in order:
        ordering.push_back(keys[NAMES.index(name)])
    linear = graph.linearize(values)
    net = linear.eliminateSequential(ordering)
    separators = lesson["eliminate"](drive.factors, order)
    conditionals = [list(map(name_of.get, net.at(n).keys())) for n in range(net.size())]
    assert {variable: set(others) for variable, *others in conditionals} == separators
    cliques = lesson["bayes_tree"](separators)
    tree = linear.eliminateMultifrontal(ordering)
    theirs = {frozenset(map(name_of.get, tree[key].conditional().keys())) for key in keys}
    assert theirs == {frozenset(variables | separator) for variables, separator, _ in cliques}
    assert sorted(name for variables, *_ in cliques for name in variables) == sorted(NAMES)
    for _, separator, parent in cliques[1:]:
        assert separator <= cliques[parent][0] | cliques[parent][1]


def test_what_a_new_measurement_touches_ends_at_the_root(lesson):
    tree = lesson["bayes_tree"](lesson["eliminate"](lesson["drive"].factors, ORDER))
    for name in NAMES:
        *_, root = way = lesson["up_to_the_root"](tree, name)
        assert name in tree[way[0]][0]
        assert root == 0
        assert tree[0][2] is None
    assert {tree[n][2] for n in lesson["up_to_the_root"](tree, "x4")} == {0, None}


def test_what_the_chapter_says_of_its_stored_numbers():
    """Sure and wrong: the sigma stays, the error is many sigmas, the cost tells of it."""
    stored = files.read_json(paths.REFERENCE / "00_start_here.json")
    value = {key.removeprefix("start."): entry["value"] for key, entry in stored.items()}
    assert 0.02 < value["upper_mass"] < 0.2
    assert value["one_wrong.sigma"] < 1.01 * value["right.sigma"]
    assert value["right.error"] < value["right.sigma"]
    assert 4.5 < value["one_wrong.error"] / value["one_wrong.sigma"] < 5.5
    assert value["right.cost"] < 3
    assert value["one_wrong.cost"] > 30


def test_the_wrong_labels_of_the_middle_do_no_harm(lesson, start):
    """Exercise 3: equally far from both landmarks, they fit; those of the ends do most harm.

    Harm and visibility have the same order.
    """
    fits = [lesson["fit"](lesson["drive"].credited_wrongly(n), start) for n in range(6)]
    errors = [show.last_place(end, covariance)[1] for _, end, covariance in fits]
    costs = [cost for cost, *_ in fits]
    assert set(np.argsort(errors)[:2]) == set(np.argsort(costs)[:2]) == {2, 3}
    assert set(np.argsort(errors)[4:]) == set(np.argsort(costs)[4:]) == {0, 5}
    assert (np.argsort(errors) == np.argsort(costs)).all()
    unspoilt, unspoilt_end, covariance = lesson["fit"](lesson["drive"], start)
    assert max(costs[2:4]) <= unspoilt
    assert max(errors[2:4]) < 1.2 * show.last_place(unspoilt_end, covariance)[1]


def test_where_the_descent_ends_depends_on_its_start_and_its_sigma_does_not(lesson):
    starts = (1.0, -1.5), (8.0, 1.0), (3.0, 6.0)  # below, right, above
    ends = [lesson["gauss_newton"](lesson["two_rings"], start)[-1] for start in starts]
    below = [end[1] < start_here.LANDMARKS[0, 1] for end in ends]
    assert below == [True, True, False]
    for start, end in zip(starts, ends, strict=True):
        path = lesson["gauss_newton"](lesson["two_rings"], start, n_steps=6)
        assert np.linalg.norm(path[-1] - end) < 0.01  # few steps are enough
    jacobians = [lesson["two_rings"](end)[1] for end in ends]
    sigmas = [np.sqrt(np.diag(np.linalg.inv(J.T @ J))) for J in jacobians]
    assert np.allclose(sigmas, sigmas[0], rtol=0.05)
    assert 4 < ends[2][1] - ends[0][1] < 5  # metres between the modes


def test_dead_reckoning_leaves_the_way_a_little_now_more_and_now_less(lesson):
    away = np.linalg.norm(lesson["drive"].dead_reckoning - start_here.POSES, axis=1)
    assert 0.1 < away.max() < 0.2  # m
    assert set(np.sign(np.diff(away))) == {-1, 1}


def test_gauss_newton_agrees_with_the_grid_but_for_the_bend_of_the_spot(lesson):
    """Moments of the lower spot, as the cell takes them: some centimetres in y alone."""
    x, y = lesson["grid_x"], lesson["grid_y"]
    lower = np.where(y < start_here.LANDMARKS[0, 1], lesson["posterior"], 0)
    lower = lower / lower.sum()
    mean = np.array([(lower * x).sum(), (lower * y).sum()])
    spread = np.sqrt([(lower * (x - mean[0]) ** 2).sum(), (lower * (y - mean[1]) ** 2).sum()])
    end = lesson["gauss_newton"](lesson["two_rings"], (1.0, -1.5))[-1]
    jacobian = lesson["two_rings"](end)[1]
    assert np.allclose(np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian))), spread, rtol=0.05)
    assert abs(mean[0] - end[0]) < 0.01 < abs(mean[1] - end[1]) < 0.05


def test_a_landmarks_mirror_image_fits_almost_as_well(lesson, start):
    """On the other side of the way; half of a squared residual of one is 0.5."""
    best = lesson["fit"](lesson["drive"], start)[0]
    for landmark in (10, 12):
        mirrored = start.copy()
        mirrored[landmark + 1] *= -1
        cost, end, _ = lesson["fit"](lesson["drive"], mirrored)
        assert end[landmark + 1] < -1
        assert best < cost < best + 1


def test_a_wrong_label_makes_a_chain_of_the_tree_and_asks_for_less_than_half_the_way(lesson):
    mistaken = lesson["drive"].credited_wrongly(lesson["wrong"])
    trees = [
        lesson["bayes_tree"](lesson["eliminate"](drive.factors, ORDER))
        for drive in (lesson["drive"], mistaken)
    ]
    branches = [[parent for *_, parent in tree].count(0) for tree in trees]
    parents = [parent for *_, parent in trees[1]]
    assert branches == [2, 1]
    assert len(set(parents)) == len(parents)  # no clique has two below it
    asked = mistaken.ranges[lesson["wrong"]]
    true = np.linalg.norm(start_here.POSES[4] - start_here.LANDMARKS[0])
    assert 2.5 < asked < 3.5 < 7 < true < 7.5  # m


def test_a_third_ring_leaves_nothing_of_the_upper_spot():
    (share,) = said("00_start_here", "with_third = posterior")
    assert share < 1e-20


def test_only_the_landmark_that_lost_a_range_is_known_less_well(lesson, start):
    drives = lesson["drive"], lesson["drive"].credited_wrongly(lesson["wrong"])
    covariances = [lesson["fit"](drive, start)[2] for drive in drives]
    right, wrong = (np.sqrt(np.diag(c).reshape(7, 2).sum(axis=1)) for c in covariances)
    assert [NAMES[n] for n in np.flatnonzero(wrong > 1.1 * right)] == ["l2"]


def test_ellipses_cover_the_truth_with_right_labels_and_from_the_second_place_not_with_a_wrong_one(
    lesson, start
):
    """Two standard deviations; the last place is drawn towards the first landmark."""
    covered, apart = [], []
    for drive in (lesson["drive"], lesson["drive"].credited_wrongly(lesson["wrong"])):
        _, end, covariance = lesson["fit"](drive, start)
        offsets = end[:10].reshape(5, 2) - start_here.POSES
        blocks = [covariance[2 * n : 2 * n + 2, 2 * n : 2 * n + 2] for n in range(5)]
        squares = [e @ np.linalg.solve(block, e) for e, block in zip(offsets, blocks, strict=True)]
        covered.append([bool(square < 2**2) for square in squares])
        apart.append(np.linalg.norm(end[8:10] - end[10:12]))
    assert covered == [[True] * 5, [True] + [False] * 4]
    assert apart[1] < apart[0] - 1  # m


def test_weak_odometry_lets_a_wrong_label_pass_for_less():
    """Exercise 3: the cost of the wrong label falls, and the error of the last place grows."""
    costs, errors = [], []
    for sigma in (0.1, 0.5, 2.0):
        config = start_here.Config(odometry_sigma=sigma)
        drive = config.draw()
        made = {"start_here": start_here, "config": config, "drive": drive}
        cells = cells_from_scratch("00_start_here", **made, **config.model_dump())
        first = np.concatenate([drive.dead_reckoning, [[1.0, 2.0], [7.0, 2.0]]]).ravel()
        cost, end, covariance = cells["fit"](drive.credited_wrongly(config.wrong), first)
        costs.append(cost)
        errors.append(show.last_place(end, covariance)[1])
    assert (np.diff(costs) < 0).all()
    assert (np.diff(errors) > 0).all()


@pytest.mark.parametrize("bad", [{"wrong": 6}, {"grid_step": 0.001}, {"range_sigma": -0.1}])
def test_parameters_that_cannot_be_are_refused_by_name(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        start_here.Config(**bad)


def test_a_label_is_exchanged_and_nothing_else():
    drive = start_here.Config().draw()
    other = drive.credited_wrongly(5)
    assert np.flatnonzero(drive.label_of != other.label_of).tolist() == [5]
    assert drive.factors[10] == ("x4", "l2")
    assert other.factors[10] == ("x4", "l1")
    assert np.array_equal(drive.ranges, other.ranges)


def test_tables_figures_and_record(lesson, start, tmp_path):
    fitted = lesson["fit"](lesson["drive"], start)
    table = show.label_table({"all right": fitted})
    assert list(table.columns)[-1] == "error / σ"
    assert show.spot_table({"grid": (np.zeros(2), np.ones(2))}).iloc[0, 3] == "1.00"
    to = report.Report("x", tmp_path)
    show.record({"right": fitted}, 0.1, to)
    fig, axes = plt.subplots(1, 6, figsize=(12, 2.5))
    x = np.arange(3.0)
    show.draw_scene(axes[0], lesson["drive"])
    show.draw_densities(axes[1], x, {"a": x})
    show.draw_grids([axes[2]], x, x, {"a": np.ones((3, 3))})
    show.draw_descents(axes[3], (1.0, 2.0), {"a": np.ones((4, 2))}, (x[:2], np.eye(2)))
    show.draw_patterns([axes[4]], {"J": np.eye(4)}, {"J": ["x0", "l1"]})
    show.draw_fits([axes[5]], {"a": fitted[1:]})
    to.figure(fig, "all")
    to.save()
    assert (tmp_path / "x_all.pdf").exists()


@pytest.mark.parametrize(
    "asked", [{"range_sigma": 11.0}, {"start_sigma": 1e-4}, {"prior_sigma": 0.04}]
)
def test_what_the_cells_cannot_compute_is_refused_by_name(asked):
    with pytest.raises(ValueError, match=next(iter(asked))):
        start_here.Config(**asked)
