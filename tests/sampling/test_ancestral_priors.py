"""Ancestral priors: drawn as they are weighed, and the evidence they lead to."""

import math

import numpy as np
import pytest
from helpers import SIGMAS, a_world, anchors, window
from scipy import stats

from sngr_utils.sampling import ancestral_priors
from sngr_utils.sampling.modes import find_modes, ring_starts
from sngr_utils.sampling.reference import landmark_reference, window_reference
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets import compiled, landmark

SETTINGS = SamplerSettings(n_live=200, min_walks=25)


def test_a_ring_is_drawn_as_it_is_weighed():
    """The mean of f over the prior is the integral of f, for a Gaussian f: 1. Without the factor
    1 / (2 pi r) it would not be. Five standard errors: one false alarm in two million."""
    prior, rng = ancestral_priors.ring(anchors(measured=1.0, sigma=0.5)), np.random.default_rng(0)
    points = prior.draw(20_000, rng=rng)
    f = stats.multivariate_normal([0.3, 0.2], 0.2 * np.eye(2)).logpdf(points)
    ratio = np.exp(f - prior.log_density(points))
    error = ratio.std() / math.sqrt(len(ratio))
    assert abs(ratio.mean() - 1) < 5 * error < 0.1
    flat = np.exp(f - prior.log_density(points) - np.log(np.hypot(*points.T)))
    assert abs(flat.mean() - 1) > 10 * error


def test_a_gaussian_prior_is_drawn_as_it_is_weighed():
    mean, covariance = np.array([1.0, -2.0]), np.array([[2.0, 0.5], [0.5, 1.0]])
    prior = ancestral_priors.gaussian(mean, covariance, 3.0)
    draws = prior.draw(4000, rng=np.random.default_rng(1))
    law = stats.multivariate_normal(mean, 3 * covariance)
    np.testing.assert_allclose(prior.log_density(draws[:50]), law.logpdf(draws[:50]))
    np.testing.assert_allclose(np.cov(draws.T), 3 * covariance, atol=0.6)


@pytest.mark.parametrize("n", [0, 2, 3])
def test_evidence_and_masses_of_a_landmark(n):
    """From the ring, against quadrature: four of the run's own errors, and masses to 0.15, some
    four standard deviations at 200 live points."""
    target = landmark.landmark_of(a_world(), SIGMAS, 5.0, 0, n) if n else anchors()
    reference = landmark_reference(target)
    modes = find_modes(target, ring_starts(target))
    run = ancestral_priors.sample(
        target, ancestral_priors.ring(target), SETTINGS, rng=np.random.default_rng(n)
    )
    assert abs(run.log_evidence - reference.log_evidence) < 4 * run.log_evidence_error
    exact = reference.masses(modes.label(reference.samples), len(modes.places))
    found = np.bincount(modes.label(run.samples), run.weights, minlength=len(exact))
    np.testing.assert_allclose(found, exact, atol=0.15)


@pytest.mark.parametrize("kind", ["window", "gaussian", "ring"])
def test_the_compiled_sampler_sees_the_same_density(kind):
    rng = np.random.default_rng(4)
    target = window(2) if kind == "window" else landmark.landmark_of(
        a_world(), SIGMAS, 5.0, 0, 3
    )  # fmt: skip
    d = target.dimension
    spread, mean = rng.standard_normal((d, d)) / 9 + np.eye(d), rng.standard_normal(d)
    prior = ancestral_priors.gaussian(mean, spread @ spread.T, 1.0)
    if kind == "ring":
        prior = ancestral_priors.ring(target)
    normals = rng.standard_normal((20, d))
    energies = [
        compiled.energy_at(prior.factors(target), prior.lower @ z) for z in normals
    ]  # fmt: skip
    points = np.array([prior.push(z) for z in normals])
    np.testing.assert_allclose(energies, prior.log_density(points) - target(points), atol=1e-9)


@pytest.mark.parametrize("n_ranges", [1, 3])
def test_evidence_and_masses_of_a_window(n_ranges):
    """The tree and a wide Gaussian, compiled, against particle filters: four errors of both, and
    0.1 for what walks of fifty steps leave."""
    target, rng = window(n_ranges), np.random.default_rng(5)
    reference = window_reference(target, 5000, rng=rng)
    settings = SamplerSettings(n_live=400, min_walks=50)
    tree = ancestral_priors.tree(target)
    modes = find_modes(target, tree.draw(16, rng=rng))
    exact = reference.masses(modes.label(reference.samples), len(modes.places))
    run = ancestral_priors.sample(target, tree, settings, rng=rng)
    error = math.hypot(run.log_evidence_error, reference.log_evidence_error)
    assert abs(run.log_evidence - reference.log_evidence) < 4 * error + 0.1
    found = np.bincount(modes.label(run.samples), run.weights, minlength=len(exact))
    np.testing.assert_allclose(found, exact, atol=0.15)
