"""Sentences of notebook 01 about signs and orders, on its stored table."""

import re

import numpy as np
from helpers import cells_from_scratch, read_notebook
from stored_results import entry, said, value

from sngr_utils import bimodal
from sngr_utils.world.two_anchors import TwoAnchors

PRINTED, OURS = 2, 3  # columns; the rows are those of the whole table


def test_likelihoods_gain_and_spread_agree_and_the_coefficient_does_not():
    for row, tolerance in ((3, 0.01), (4, 0.02), (5, 0.02), (6, 0.001), (8, 0.1)):
        assert abs(entry("bimodal", row, OURS) - entry("bimodal", row, PRINTED)) < tolerance
    assert entry("bimodal", 9, OURS) > 0.9 > 0.7 > entry("bimodal", 9, PRINTED)


def test_the_printed_distance_is_the_error_in_y_alone():
    x, y = (entry("bimodal", 2, PRINTED, part) for part in (1, 2))
    in_y = abs(abs(y) - np.sqrt(5))  # the modes stand at (2, ±√5)
    assert abs(in_y - entry("bimodal", 7, PRINTED)) < 0.0005
    assert np.hypot(x - 2, in_y) > 3 * in_y


def test_one_run_knows_less_than_the_runs_scatter_and_their_mean_is_one_half():
    mean, error = (entry("bimodal", 11, OURS, part) for part in (1, 2))
    assert entry("bimodal", 10, OURS, 2) > 2 * value("bimodal.resampled_error")
    assert abs(mean - 0.5) < 2 * error


def test_an_uneven_split_has_the_printed_coefficient_and_not_the_printed_spread():
    """Two Gaussians, 994 to 6, as wide as a mode is under the printed factor."""
    share, apart, width = 0.006, 2 * np.sqrt(5), 1 / np.sqrt(0.5 * 2 * 5 / 9 / 0.04)
    ends = np.array([0, apart]) - share * apart
    weights = np.array([1 - share, share])
    variance = weights @ (ends**2 + width**2)
    skewness = weights @ (ends**3 + 3 * ends * width**2) / variance**1.5
    kurtosis = weights @ (ends**4 + 6 * ends**2 * width**2 + 3 * width**4) / variance**2
    assert abs((1 + skewness**2) / kurtosis - entry("bimodal", 9, PRINTED)) < 0.02
    assert np.sqrt(variance) < 0.5


def density_in_the_plane(c):
    """Heights (N,) of a grid, and shares under N(upper mode, c Sigma) and the printed factor."""
    world = TwoAnchors()
    x, y = np.meshgrid(np.linspace(0, 4, 201), np.linspace(-4, 4, 401))
    away = np.stack([x, y], axis=-1).reshape(-1, 2)
    lengths = np.linalg.norm(away[:, None] - world.anchors, axis=2)
    cost = 0.5 * np.sum((lengths - world.measured_range) ** 2, axis=1) / world.range_sigma**2
    step = away - world.modes[0]
    information = world.gauss_newton_hessian(world.modes[0]) / c
    density = np.exp(-0.5 * cost - 0.5 * np.einsum("ni,ij,nj->n", step, information, step))
    return away[:, 1], density / density.sum()


def test_a_mode_is_seen_through_a_prior_a_hundred_times_as_wide_and_not_through_the_papers():
    """Exercise 3: what it expects, by quadrature, and four runs (4 of their sigmas: 6e-5 each)."""
    cells = [cell for cell in read_notebook("01_bimodal").cells if cell.cell_type == "code"]
    said = next(c.outputs[0].text for c in cells if "off_saddle" in c.source)
    found = re.findall(r"c = +(\d+), .*other mode ([\d.]+), expected ([\d.]+); (\d+) calls", said)
    assert len(found) == 3
    spread = entry("bimodal", 10, OURS, 2)
    for c, mass, expected, _ in found:
        heights, density = density_in_the_plane(float(c))
        share = density[heights < 0].sum()
        assert abs(float(expected) - share) < 0.01
        assert abs(float(mass) - share) < 4 * spread / np.sqrt(4)
    (_, least, _, few), *_, (_, most, _, many) = found
    assert float(least) < 0.01
    assert 0.4 < float(most) < 0.5
    assert 1.5 < float(many) / float(few) < 2.5


def test_the_condition_number_sees_a_free_direction_and_no_second_mode():
    """Of four eigenvalues that are smallest: tiny and positive, negative, and twice the same."""
    world = TwoAnchors()
    at_saddle, at_mode = world.modes.mean(axis=0), world.modes[0]
    tangent, full = world.gauss_newton_hessian, world.full_hessian
    assert np.linalg.eigvalsh(full(at_saddle))[0] < 0 < np.linalg.eigvalsh(tangent(at_saddle))[0]
    assert np.linalg.cond(tangent(at_saddle)) > 1000 > 2 > np.linalg.cond(tangent(at_mode))
    assert np.allclose(tangent(at_mode), full(at_mode), rtol=0.01)


class Starts:
    """A generator of random numbers that keeps which live point each walk begins at."""

    def __init__(self, rng):
        self.rng, self.drawn = rng, []

    def integers(self, *ends):
        self.drawn.append(self.rng.integers(*ends))
        return self.drawn[-1]

    def __getattr__(self, name):
        return getattr(self.rng, name)


def test_from_scratch_the_volume_wanders_and_clusters_part_when_four_in_ten_steps_are_done():
    """The runs of the notebook's own cells, with its random numbers."""
    config, cells = bimodal.Config(), cells_from_scratch("01_bimodal")
    rng = Starts(np.random.default_rng([config.seed, 1]))
    ends = np.array([-5.0]), np.array([5.0])
    line = lambda point: float(config.profile(point[0], 1.0))  # noqa: E731
    _, heights, _ = cells["nested_sampling"](line, *ends, 100, 700, rng)
    on_grid = config.profile(np.linspace(-5, 5, 20001), 1.0)
    left = np.log([np.mean(on_grid > height) for height in heights[:650]])
    strays = left - cells["weigh"](heights, 100)[2][:650]
    assert -0.5 < strays.min() < -0.05 < 0.15 < strays.max() < 0.5

    def height(point):
        lengths = np.linalg.norm(point - config.anchors, axis=1)
        return -0.5 * np.sum(((lengths - config.measured_range) / config.range_sigma) ** 2)

    rng.drawn = []
    corners = config.saddle - 8, config.saddle + 8
    points, heights, history = cells["nested_sampling"](height, *corners, 100, 1000, rng)
    ys = [live[:, 1] for live in history]
    assert min(np.abs(y).min() for y in ys[:300:100]) < 0.2  # no gap yet
    assert min(np.abs(y).min() for y in ys[400:]) > 1  # m
    for step in range(400, 999):
        worst = np.argmin([height(point) for point in history[step]])
        came_from = ys[step][(worst + rng.drawn[step]) % 100]
        assert came_from * ys[step + 1][worst] > 0  # on its own side
    upper = cells["weigh"](heights, 100)[1][points[:, 1] > 0].sum()
    assert round(upper, 2) == said("01_bimodal", "draw_live_panels")[1]


def test_what_is_printed_of_the_evidence_and_of_exercises_1_and_2():
    log_z, error, exact = said("01_bimodal", "draw_weights")
    assert abs(log_z - exact) < 3 * error
    gain, before, narrower = said("01_bimodal", "correct = bimodal.run")
    assert abs(gain / before - 2) < 0.01
    assert abs(narrower - np.sqrt(2)) < 0.15
    assert said("01_bimodal", "touching = bimodal.run")[-1] < 0.555
