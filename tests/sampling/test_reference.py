"""Small posteriors and their references, against closed forms and independent integration."""

import math
from dataclasses import replace

import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import X
from helpers import SIGMAS, WEAK, a_world, anchors, window
from scipy import integrate, stats

from sngr_utils.sampling.modes import find_modes, laplace_draws, ring_starts
from sngr_utils.sampling.reference import Reference, landmark_reference, window_reference
from sngr_utils.sampling.targets import ambiguous_window, landmark
from sngr_utils.slam.factors import odometry_factor, pose_prior
from sngr_utils.world import dead_reckoning

# --- targets --------------------------------------------------------------------------------


def test_noises_of_a_window_are_the_residuals_of_gtsams_factors():
    """Half their squares is the error of the x0 prior and the odometry, to the turn's curvature."""
    target, rng = window(), np.random.default_rng(1)
    noises = 0.3 * rng.standard_normal(9)
    start = dead_reckoning.dead_reckoning(target.x0_mean, [noises[:3] * target.x0_sigmas])[-1]
    moved = target.odometry + noises[3:].reshape(2, 3) * target.odometry_sigmas
    poses = dead_reckoning.dead_reckoning(start, moved)
    np.testing.assert_allclose(target.positions(noises[None])[0], poses[:, :2], atol=1e-12)
    factors, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    factors.push_back(pose_prior(target.x0_mean, list(target.x0_sigmas)))
    for t, motion in enumerate(target.odometry):
        factors.push_back(odometry_factor(t, motion, WEAK))
    for t, pose in enumerate(poses):
        values.insert(X(t), gtsam.Pose2(*pose))
    assert factors.error(values) == pytest.approx(0.5 * noises @ noises, abs=5e-3)


@pytest.mark.parametrize("n", [2, 4])
def test_integrating_poses_out_to_first_order_is_accurate(n):
    """Against a Monte Carlo mean over the poses, at places drawn from the posterior: to 5 %. A
    false alarm is a deviation of five more standard errors at one of six places: less than 1e-5."""
    the_world, rng = a_world(), np.random.default_rng(2)
    target = landmark.landmark_of(the_world, SIGMAS, 5.0, 0, n)
    reference = landmark_reference(target)
    places = reference.samples[rng.choice(len(reference.samples), 3, p=reference.weights)]
    mine = np.flatnonzero(the_world.label_of == 0)[:n]
    chain = replace(
        ambiguous_window.window_of(the_world, SIGMAS, 0.0, 1),
        odometry=the_world.odometry[: n - 1], pose_of=np.arange(n), ranges=the_world.ranges[mine],
        log_shares=np.zeros((n, 1)),
    )  # fmt: skip
    noises = rng.standard_normal((200_000, chain.dimension))
    prior = stats.multivariate_normal(target.centre, 25 * np.eye(2))
    for place in places:
        given = replace(chain, landmarks=place[None])
        density = np.exp(given.log_likelihoods(noises, 0, n)) * prior.pdf(place)
        error = density.std() / math.sqrt(len(density))
        exact = math.exp(target(place[None])[0])
        assert abs(density.mean() - exact) < 5 * error + 0.05 * exact


def test_a_landmark_that_a_range_cannot_belong_to_does_not_count():
    """With p = 0 the mixture is the one Gaussian of the attached landmark."""
    the_world = a_world()
    target = ambiguous_window.window_of(the_world, SIGMAS, 0.0, 2)
    noises = 0.1 * np.random.default_rng(8).standard_normal((3, 90))
    where = target.positions(noises)[:, target.pose_of]
    distances = np.linalg.norm(where - the_world.landmarks[np.tile([0, 1], 30)], axis=2)
    each = stats.norm.logpdf(target.ranges, distances, 0.1).sum(axis=1)
    np.testing.assert_allclose(target.log_likelihoods(noises, 0, 30), each)


def test_landmark_of_needs_a_range_from_every_pose():
    with pytest.raises(ValueError, match="n is 31"):
        landmark.landmark_of(a_world(), SIGMAS, 5.0, 0, 31)


def test_window_of_names_what_is_wrong():
    with pytest.raises(ValueError, match="p is 1"):
        ambiguous_window.window_of(a_world(), SIGMAS, 1.5, 1)
    with pytest.raises(ValueError, match="n_ranges"):
        ambiguous_window.window_of(a_world(), SIGMAS, 0.4, 0)


# --- quadrature -----------------------------------------------------------------------------


def test_evidence_of_one_range_is_a_radial_integral():
    """The prior is centred on the only position, so what is left is one integral over radii."""
    target = landmark.Landmark(
        np.zeros((1, 2)), np.zeros((2, 2)), np.array([3.0]), 0.1, np.zeros(2), 5.0
    )
    exact = integrate.quad(
        lambda r: r / 25 * math.exp(-0.5 * (r / 5) ** 2) * stats.norm.pdf(3, r, 0.1), 2, 4
    )[0]
    found = landmark_reference(target)
    assert found.log_evidence == pytest.approx(math.log(exact), abs=1e-10)
    assert found.log_evidence_error < 1e-8


def test_quadrature_agrees_with_an_independent_grid_and_knows_its_error():
    target = anchors()
    axis = np.arange(-8, 8, 0.02)
    plane = np.stack(np.meshgrid(axis + 2, axis), axis=-1).reshape(-1, 2)
    independent = np.logaddexp.reduce(target(plane)) + 2 * math.log(0.02)
    fine = landmark_reference(target)
    assert fine.log_evidence == pytest.approx(independent, abs=1e-6)
    coarse = landmark_reference(target, 8, 40)
    assert 1e-4 < abs(coarse.log_evidence - independent) < 3 * coarse.log_evidence_error
    upper, error = fine.expectation((fine.samples[:, 1] > 0).astype(float))
    assert upper == pytest.approx(0.5, abs=0.01)
    assert error < 0.01


def test_grids_that_cannot_be_halved_are_refused():
    with pytest.raises(ValueError, match="n_angles"):
        landmark_reference(anchors(), 8, 41)


def gaussian_reference(mean, covariance):
    """A fine grid of a Gaussian, as a reference."""
    axis = np.arange(-8, 8, 0.1)
    points = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    log_density = stats.multivariate_normal(mean, covariance).logpdf(points)
    weights = np.exp(log_density) * 0.01
    return Reference(
        points, weights / weights.sum(), log_density, 0.0, 0.0, len(points),
        part=np.arange(len(points)) % 2,
    )  # fmt: skip


def test_divergence_and_moments_of_gaussians_have_closed_forms():
    covariance, other = np.array([[1.0, 0.3], [0.3, 0.5]]), np.diag([0.8, 0.6])
    reference = gaussian_reference([0.2, -0.1], covariance)
    law = stats.multivariate_normal([0.5, 0.4], other)
    shift = np.array([0.3, 0.5])
    exact = 0.5 * (
        np.trace(np.linalg.solve(other, covariance)) + shift @ np.linalg.solve(other, shift) - 2
        + np.linalg.slogdet(other)[1] - np.linalg.slogdet(covariance)[1]
    )  # fmt: skip
    assert reference.divergence(law.logpdf)[0] == pytest.approx(exact, abs=1e-6)
    mean, spread = reference.mean, reference.covariance
    np.testing.assert_allclose(mean, [0.2, -0.1], atol=1e-6)
    np.testing.assert_allclose(spread, covariance, atol=1e-5)


# --- particle filters -----------------------------------------------------------------------


def test_filters_agree_with_quadrature_of_one_pose():
    """Evidence of one pose: a mixture likelihood over a Gaussian position. Five standard errors
    of ten filters: a false alarm in one of 1500."""
    full = window(2)
    target = replace(
        full, odometry=full.odometry[:0], pose_of=full.pose_of[:2], ranges=full.ranges[:2],
        log_shares=full.log_shares[:2],
    )  # fmt: skip
    axis = np.arange(-6, 6, 0.02)
    noises = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    noises = np.column_stack([noises, np.zeros(len(noises))])
    exact = (
        np.logaddexp.reduce(target(noises)) + 2 * math.log(0.02) + 0.5 * ambiguous_window.LOG_TAU
    )
    found = window_reference(target, 5000, rng=np.random.default_rng(3))
    assert found.log_evidence_error < 0.05
    assert abs(found.log_evidence - exact) < 5 * found.log_evidence_error


def test_filters_agree_with_plain_draws_from_the_prior():
    """Wide ranges, so that plain Monte Carlo does: evidence and mean of the last position, five
    standard errors of ten filters each."""
    target, rng = window(2, range_sigma=0.5), np.random.default_rng(4)
    noises = rng.standard_normal((200_000, 9))
    likelihood = np.exp(target.log_likelihoods(noises, 0, 3))
    found = window_reference(target, 5000, rng=rng)
    plain = likelihood.std() / likelihood.mean() / math.sqrt(len(noises))
    error = math.hypot(found.log_evidence_error, plain)
    assert abs(found.log_evidence - math.log(likelihood.mean())) < 5 * error
    last = target.positions(noises)[:, -1, 0]
    mean, spread = found.expectation(target.positions(found.samples)[:, -1, 0])
    assert abs(mean - likelihood @ last / likelihood.sum()) < 5 * spread + 0.01


def test_what_is_kept_of_the_particles_stands_for_all():
    """The evidence is that of all particles; the mean of the last position, within five standard
    errors of ten filters each."""
    target = window(2, range_sigma=0.5)
    runs = [
        window_reference(target, 4000, kept, rng=np.random.default_rng(9)) for kept in (None, 1000)
    ]
    assert [len(run.samples) for run in runs] == [40_000, 10_000]
    means = [run.expectation(target.positions(run.samples)[:, -1, 0]) for run in runs]
    away = abs(means[0][0] - means[1][0])
    assert away < 5 * math.hypot(means[0][1], means[1][1]) + 0.01
    labels = (runs[0].samples[:, 0] > 0).astype(int)
    assert runs[0].mass_error(labels, 2) == runs[0].expectation(labels.astype(float))[1]


# --- many starts ----------------------------------------------------------------------------


def test_many_starts_find_both_places_of_a_landmark():
    target, rng = anchors(), np.random.default_rng(6)
    modes = find_modes(target, ring_starts(target))
    np.testing.assert_allclose(sorted(modes.places[:, 1]), [-math.sqrt(5), math.sqrt(5)], atol=0.01)
    assert modes.log_masses[0] == pytest.approx(modes.log_masses[1], abs=1e-3)
    reference = landmark_reference(target)
    one = laplace_draws(modes, 100, rng=rng)
    assert set(modes.label(one.samples)) == {0}
    assert one.log_evidence == pytest.approx(reference.log_evidence - math.log(2), abs=0.1)


def test_heights_and_calls_of_an_ascent():
    """A window's modes are where its gradient vanishes, and no start ends higher."""
    target, rng = window(2), np.random.default_rng(7)
    modes = find_modes(target, rng.standard_normal((20, 9)))
    np.testing.assert_allclose(modes.heights, target(modes.places))
    assert (np.diff(modes.heights) <= 0).all()
    for place in modes.places:
        slopes = (target(place + 1e-4 * np.eye(9)) - target(place - 1e-4 * np.eye(9))) / 2e-4
        assert abs(slopes).max() < 0.01
    assert modes.calls > 20 * 19


def test_the_labels_of_points_are_those_of_the_likeliest_gaussian():
    target, rng = window(1), np.random.default_rng(8)
    modes = find_modes(target, rng.standard_normal((20, 9)))
    points = modes.places[rng.integers(len(modes.places), size=50)] + rng.standard_normal((50, 9))
    laws = [
        stats.multivariate_normal(*m) for m in zip(modes.places, modes.covariances, strict=True)
    ]
    each = [mass + law.logpdf(points) for mass, law in zip(modes.log_masses, laws, strict=True)]
    np.testing.assert_array_equal(modes.label(points), np.argmax(each, axis=0))


def test_no_maximum_is_an_error():
    """By symmetry an ascent from the line of two anchors stays on it, and ends at the saddle."""
    with pytest.raises(ValueError, match="none of 1 starts"):
        find_modes(anchors(), np.array([[2.0, 0.0]]))
