import dynesty
import gtsam
import numpy as np
import pytest
from gtsam.symbol_shorthand import L, X
from scipy import stats

from sngr_utils.sampling import dynesty_nested, prior_transform
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.likelihood import LocalLikelihood
from sngr_utils.sngr import closure, refine


def test_settings_are_the_papers():
    """nlive 100, walks max(d, 9), dlogz 0.5, the prior as wide as Sigma_w, half the error()."""
    settings = SamplerSettings()
    assert settings.model_dump() == {
        "n_live": 100, "min_walks": 9, "dlogz": 0.5, "prior_scale": 1.0, "likelihood_factor": 0.5,
    }  # fmt: skip
    assert [settings.walks(d) for d in (2, 9, 27)] == [9, 9, 27]
    assert SamplerSettings(n_live=20, min_walks=1).walks(1) == 1  # the least of either


def test_prior_transform_closed_form():
    """Equation "prior": L Phi^-1(u), L L^T = c Sigma."""
    sigma = np.array([[4.0, 1.0], [1.0, 2.0]])
    transform = prior_transform.prior_transform(sigma, 50.0)
    assert np.allclose(transform(np.array([0.5, 0.5])), 0)
    one_sigma = stats.norm.cdf(1)
    assert np.allclose(transform(np.array([one_sigma, 0.5])), np.linalg.cholesky(50 * sigma)[:, 0])
    with pytest.raises(np.linalg.LinAlgError):
        prior_transform.prior_transform(-sigma, 1.0)


def test_prior_transform_has_the_covariance():
    """Chi-square of 5000 whitened draws. Failure probability 2e-5."""
    sigma = np.array([[4.0, 1.0], [1.0, 2.0]])
    draws = np.array([
        prior_transform.prior_transform(sigma, 2.0)(u)
        for u in np.random.default_rng(0).random((5000, 2))
    ])
    distance = np.sum(draws * np.linalg.solve(2 * sigma, draws.T).T)
    assert 1e-5 < stats.chi2.cdf(distance, 10_000) < 1 - 1e-5


def test_local_likelihood_is_minus_factor_times_gtsam_error(noisy):
    """Equation "ll" against GTSAM on random points, all of the graph against the window's part."""
    rng, solution = np.random.default_rng(0), noisy.solution
    cholesky = np.linalg.cholesky(noisy.covariances[10])
    for factor in (0.5, 1.0):
        likelihood = refine.window_likelihood(solution, 10, factor)
        reference = solution.graph.error(solution.estimate)
        for _ in range(20):
            xi = cholesky @ rng.normal(size=9)
            values = gtsam.Values(solution.estimate)
            for i in range(3):
                pose = solution.estimate.atPose2(X(10 + i)).retract(xi[3 * i : 3 * i + 3])
                values.update(X(10 + i), pose)
            expected = -factor * (solution.graph.error(values) - reference)
            assert likelihood(xi) - likelihood(np.zeros(9)) == pytest.approx(expected, rel=1e-9)


def test_local_likelihood_moves_points_too(noisy):
    solution, keys = noisy.solution, [L(2), X(4)]
    factors = closure.touching_factors(solution.graph, keys)
    likelihood = LocalLikelihood(factors, solution.estimate, keys, 1.0)
    assert likelihood.dimension == 5
    landmark, pose = likelihood.variables(np.array([0.1, -0.2, 0.0, 0.0, 0.0]))
    moved = landmark - solution.estimate.atPoint2(L(2))
    assert np.allclose(moved, [0.1, -0.2])
    assert pose.equals(solution.estimate.atPose2(X(4)), 1e-12)


def test_headings_across_pi_are_no_special_case():
    """A window whose heading straddles +-pi: the likelihood is smooth there."""
    graph, values = gtsam.NonlinearFactorGraph(), gtsam.Values()
    noise = gtsam.noiseModel.Isotropic.Sigma(3, 0.1)
    graph.push_back(gtsam.PriorFactorPose2(X(0), gtsam.Pose2(0, 0, np.pi - 0.01), noise))
    values.insert(X(0), gtsam.Pose2(0, 0, -np.pi + 0.01))
    likelihood = LocalLikelihood(graph, values, [X(0)], 1.0)
    assert likelihood(np.zeros(3)) == pytest.approx(-0.5 * (0.02 / 0.1) ** 2)
    assert likelihood(np.array([0, 0, -0.02])) == pytest.approx(0, abs=1e-12)


def gaussian_evidence(covariance: np.ndarray) -> float:
    """log of the integral of exp(-x^T S^-1 x / 2) under N(0, I)."""
    return -0.5 * np.linalg.slogdet(np.eye(len(covariance)) + np.linalg.inv(covariance))[1]


def test_sampler_on_an_analytic_gaussian_in_nine_dimensions():
    """log Z, mean and covariance of six runs. Failure probability below 1e-4.

    The mean of six log Z is compared at 4 of its standard errors (two-sided 6e-5 for normal
    errors of dynesty's stated size) with room for a bias of 0.1, dynesty's at 50 steps; the
    mean of the posterior at 4.5 standard errors in each of nine coordinates (6e-5); and the
    geometric mean variance within 15 %, its standard error being 4 %.
    """
    rng = np.random.default_rng(0)
    factor = rng.normal(size=(9, 9))
    covariance = factor @ factor.T / 9 + 0.1 * np.eye(9)
    precision = np.linalg.inv(covariance)
    transform = prior_transform.prior_transform(np.eye(9), 1.0)
    settings = SamplerSettings(min_walks=50)
    runs = [
        dynesty_nested.run_nested(
            lambda x: -0.5 * x @ precision @ x, transform, 9, settings, rng=stream
        )
        for stream in rng.spawn(6)
    ]
    errors = [run.log_evidence - gaussian_evidence(covariance) for run in runs]
    standard_error = np.sqrt(np.mean([run.log_evidence_error**2 for run in runs]) / len(runs))
    assert abs(np.mean(errors)) < 4 * standard_error + 0.1
    posterior = np.linalg.inv(precision + np.eye(9))
    effective = sum(run.ess_share * len(run.samples) for run in runs)
    mean = np.mean([run.mean for run in runs], axis=0)
    assert np.all(np.abs(mean) < 4.5 * np.sqrt(np.diag(posterior) / effective))
    pooled = np.mean([run.covariance for run in runs], axis=0)
    ratio = np.exp(np.mean(np.log(np.diag(pooled) / np.diag(posterior))))
    assert 0.85 < ratio < 1.15


def test_same_generator_same_run_and_summary():
    def sample(seed):
        return dynesty_nested.run_nested(
            lambda x: -0.5 * x @ x,
            prior_transform.prior_transform(np.eye(2), 4.0),
            2,
            SamplerSettings(n_live=50),
            rng=np.random.default_rng(seed),
        )

    first, again, other = sample(1), sample(1), sample(2)
    assert np.array_equal(first.samples, again.samples)
    assert first.log_evidence != other.log_evidence
    assert first.weights.sum() == pytest.approx(1)
    assert np.allclose(first.mean, first.weights @ first.samples)
    assert np.allclose(first.covariance, np.cov(first.samples.T, aweights=first.weights, ddof=0))
    assert first.calls >= len(first.samples)
    assert np.array_equal(first.best, first.samples[np.argmax(first.results.logl)])


def test_dynesty_is_given_the_settings(monkeypatch):
    """Live points, steps and stopping rule arrive, and the last error of the evidence is kept."""
    seen = {}

    def watched(*arguments, **named):
        sampler = dynesty.NestedSampler(*arguments, **named)
        run = sampler.run_nested
        monkeypatch.setattr(sampler, "run_nested", lambda **how: (seen.update(how), run(**how)))
        seen.update(named)
        return sampler

    monkeypatch.setattr(dynesty_nested, "NestedSampler", watched)
    settings = SamplerSettings(n_live=25, min_walks=4, dlogz=3.0)
    found = dynesty_nested.run_nested(
        lambda x: -0.5 * x @ x, prior_transform.prior_transform(np.eye(2), 4.0), 2, settings,
        rng=np.random.default_rng(0),
    )  # fmt: skip
    assert (seen["nlive"], seen["dlogz"], seen["print_progress"]) == (25, 3.0, False)
    assert seen["sample"].sampler_kwargs["walks"] == 4
    errors, values = found.results.logzerr, found.results.logz
    assert found.log_evidence_error == errors[-1] != errors[-2]
    assert found.log_evidence == values[-1] != values[-2]
    assert found.calls == found.results.ncall.sum()


def test_canonical_walk_ignores_the_sign_and_rotation_of_the_axes():
    """The same ellipsoid, however described, gives the same proposals."""
    rng = np.random.default_rng(0)
    axes = rng.normal(size=(4, 4))
    rotation, _ = np.linalg.qr(rng.normal(size=(4, 4)))
    flips = np.diag([1.0, -1.0, 1.0, -1.0])
    walk = dynesty_nested.CanonicalWalk(walks=9, ndim=4)

    def prepared(matrix):
        (argument,) = walk.prepare_sampler(
            loglstar=0.0, points=[np.full(4, 0.5)], axes=[matrix], seeds=[1]
        )
        return argument.axes

    reference = prepared(axes)
    assert np.allclose(reference @ reference.T, axes @ axes.T)
    assert np.allclose(prepared(axes @ flips), reference)
    assert np.allclose(prepared(axes @ rotation), reference)


@pytest.mark.parametrize(
    ("name", "value"),
    [("n_live", 19), ("n_live", 100.0), ("dlogz", 0.0), ("prior_scale", -1.0),
     ("likelihood_factor", 0.0), ("min_walks", 0)],
)  # fmt: skip
def test_bad_settings_name_the_parameter(name, value):
    with pytest.raises(ValueError, match=name):
        SamplerSettings(**{name: value})
