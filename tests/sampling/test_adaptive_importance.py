"""Importance sampling from a fitted mixture, against closed forms, quadrature and filters."""

import math

import numpy as np
import pytest
from helpers import anchors, window

from sngr_utils.experiments import sampler_contest
from sngr_utils.metrics import effective_sample_size
from sngr_utils.numerics import linalg
from sngr_utils.sampling import adaptive_importance
from sngr_utils.sampling.modes import Modes, find_modes, ring_starts
from sngr_utils.sampling.reference import landmark_reference


def a_mixture():
    return adaptive_importance.Mixture(
        np.array([0.3, 0.7]), np.array([[0.0, 0.0], [2.0, 1.0]]),
        np.array([[[1.0, 0.4], [0.4, 0.5]], [[0.3, 0.0], [0.0, 0.8]]]),
    )  # fmt: skip


def test_a_mixture_is_drawn_as_it_is_weighed():
    """The mean of f / q over draws of q is the integral of f, for a narrow Gaussian: 1, to five
    standard errors: one false alarm in two million."""
    mixture, rng = a_mixture(), np.random.default_rng(0)
    points = mixture.draw(20_000, rng=rng)
    f = -0.5 * np.sum((points - [1.0, 0.5]) ** 2, axis=1) / 0.2 - math.log(2 * math.pi * 0.2)
    ratio = np.exp(f - adaptive_importance.log_sum(mixture.each(points)[0]))
    error = ratio.std() / math.sqrt(len(ratio))
    assert abs(ratio.mean() - 1) < 5 * error < 0.1


def test_a_mixture_fitted_to_its_own_draws_stays():
    """Maximum likelihood is consistent: 50 000 draws, each number to some five standard errors."""
    mixture, rng = a_mixture(), np.random.default_rng(1)
    points = mixture.draw(50_000, rng=rng)
    fitted = mixture.fitted(points, np.full(len(points), 1 / len(points)), mixture.each(points))
    np.testing.assert_allclose(fitted.shares, mixture.shares, atol=0.015)
    np.testing.assert_allclose(fitted.places, mixture.places, atol=0.06)
    np.testing.assert_allclose(fitted.covariances, mixture.covariances, atol=0.06)


def test_a_component_that_stands_for_nothing_is_left_out():
    mixture = a_mixture()
    points = mixture.places[0] + 0.1 * np.random.default_rng(2).standard_normal((500, 2))
    away = adaptive_importance.Mixture(
        mixture.shares, mixture.places + np.array([[0, 0], [50, 0]]), mixture.covariances
    )
    fitted = away.fitted(points, np.full(500, 1 / 500), away.each(points))
    assert len(fitted.shares) == 1


def test_a_place_that_no_start_found_is_found_from_the_root():
    """One of the two places of two anchors is given. Masses to 0.05, at 4000 effective draws some
    six standard errors."""
    target, rng = anchors(), np.random.default_rng(3)
    both = find_modes(target, ring_starts(target))
    one = Modes(both.places[:1], both.covariances[:1], both.heights[:1], both.calls)
    run = adaptive_importance.draws(target, one, 4000, rng=rng)
    masses = np.bincount(both.label(run.samples), run.weights)
    np.testing.assert_allclose(masses, [0.5, 0.5], atol=0.05)
    exact = landmark_reference(target).log_evidence
    assert run.log_evidence == pytest.approx(exact, abs=0.1)


@pytest.mark.parametrize("n_ranges", [1, 3])
def test_bent_modes_of_a_window(n_ranges):
    """Masses to 0.05 and evidence to 0.1, where 4000 effective draws and the reference leave 0.01
    and 0.03: some four standard errors."""
    target, rng = window(n_ranges, seed=101), np.random.default_rng(4)
    reference, modes = sampler_contest.window_truth(target, 6000, rng=rng)
    own = find_modes(target, rng.standard_normal((100, 9)))
    run = adaptive_importance.draws(target, own, 10_000, rng=rng)
    assert (
        effective_sample_size.effective_sample_size(run.weights) > 0.7 * adaptive_importance.ENOUGH
    )
    assert run.weights.sum() == pytest.approx(1)
    exact = reference.masses(modes.label(reference.samples), len(modes.places))
    found = np.bincount(modes.label(run.samples), run.weights, minlength=len(exact))
    np.testing.assert_allclose(found, exact, atol=0.05)
    assert abs(run.log_evidence - reference.log_evidence) < 0.1


@pytest.mark.parametrize("n", [0, 1, 3, 4, 6])
def test_distances_are_those_of_each_point_alone(n):
    rng = np.random.default_rng(n)
    points, places = rng.standard_normal((n, 3)), rng.standard_normal((2, 3))
    inverses = np.tril(rng.standard_normal((2, 3, 3)))
    whitened = np.einsum("kij,nkj->nki", inverses, points[:, None] - places)
    np.testing.assert_allclose(
        linalg.distances(points, places, inverses), np.sum(whitened**2, axis=2), rtol=1e-12
    )
