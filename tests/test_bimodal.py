"""Notebook 01: what must hold, and what the paper prints."""

import matplotlib.pyplot as plt
import numpy as np
import pytest
from helpers import drawn_as_printed, handed_on

from sngr_utils import bimodal, paths
from sngr_utils.metrics import standard_error
from sngr_utils.publish import contradictions, dependencies, notebooks, report
from sngr_utils.sampling.targets import two_anchors
from sngr_utils.show import bimodal as show
from sngr_utils.world.two_anchors import TwoAnchors

pytestmark = pytest.mark.usefixtures("house_style")


@pytest.fixture(scope="module")
def bimodal_result():
    return bimodal.run(bimodal.Config(n_repeats=20))


def test_saddle_log_likelihoods_in_both_conventions():
    """-12.50 as printed and -25.0 in the correct convention, by formula and by GTSAM."""
    for factor, expected in ((0.5, -12.5), (1.0, -25.0)):
        config = bimodal.Config(likelihood_factor=factor)
        assert config.profile(np.array(0.0), factor) == pytest.approx(expected)
        estimate = two_anchors.run_isam2(config, config.saddle)
        likelihood = two_anchors.log_likelihood(config, estimate, config.likelihood_factor)
        assert likelihood(np.zeros(2)) == pytest.approx(expected, abs=1e-6)


def test_printed_gain_follows_from_the_weak_prior():
    """+12.49 is 12.5 less half of the prior's error of 10 m at the mode."""
    config = bimodal.Config()
    at_mode = -0.5 * 0.5 * 5 / 10**2
    estimate = two_anchors.run_isam2(config, config.saddle)
    likelihood = two_anchors.log_likelihood(config, estimate, config.likelihood_factor)
    mode = config.modes[0] - config.saddle
    assert likelihood(mode) == pytest.approx(at_mode, abs=1e-6)
    gain = likelihood(mode) - likelihood(np.zeros(2))
    assert round(gain, 2) == report.printed_values()["bimodal"]["delta_logp"]


def test_hessians_against_finite_differences():
    config, h = bimodal.Config(likelihood_factor=1.0), 1e-4
    estimate = two_anchors.run_isam2(config, config.saddle)
    likelihood = two_anchors.log_likelihood(config, estimate, config.likelihood_factor)
    for at in (config.saddle, config.modes[0], np.array([1.0, 1.5])):
        offset = at - config.saddle
        numeric = np.zeros((2, 2))
        for i in range(2):
            for j in range(2):
                e, f = h * np.eye(2)[i], h * np.eye(2)[j]
                numeric[i, j] = -(
                    likelihood(offset + e + f) - likelihood(offset + e - f)
                    - likelihood(offset - e + f) + likelihood(offset - e - f)
                ) / (4 * h * h)  # fmt: skip
        assert np.allclose(config.full_hessian(at), numeric, atol=1e-3)


def test_isam2_stays_at_the_saddle_and_leaves_any_other_start():
    config = bimodal.Config()
    stays = two_anchors.run_isam2(config, config.saddle).atPoint2(two_anchors.LANDMARK)
    assert np.allclose(stays, config.saddle, atol=1e-9)
    leaves = two_anchors.run_isam2(config, np.array([2.0, -0.5])).atPoint2(two_anchors.LANDMARK)
    assert np.allclose(leaves, config.modes[1], atol=0.01)


def test_both_modes_found_with_half_the_mass_each(bimodal_result):
    """The run's mass at 4 of its standard errors, the mean of 20 at 5 of theirs.

    The standard errors are themselves estimated from 20 runs (t law, 19 degrees): failure
    probabilities 8e-4 and 8e-5.
    """
    masses = bimodal_result.upper_masses
    assert abs(masses[0] - 0.5) < 4 * bimodal_result.upper_mass_error
    assert abs(masses.mean() - 0.5) < 5 * standard_error.standard_error(masses)
    assert ((masses > 0.05) & (masses < 0.95)).all()


def test_masses_are_of_the_modes_wherever_isam2_ended():
    """From a start off the saddle the prior is centred on a mode; y > 0 still means that mode.

    Quadrature puts the other mode's mass at half a per cent, far from the 0.2 allowed.
    """
    config = bimodal.Config(n_repeats=2, n_live=50)
    upper = bimodal.run(config, at=np.array([2.0, 0.5]))
    lower = bimodal.run(config, at=np.array([2.0, -0.5]))
    assert (upper.upper_masses > 0.8).all()
    assert (lower.upper_masses < 0.2).all()


def test_the_points_alive_at_the_end_carry_a_third_and_the_last_weighs_most(bimodal_result):
    """Where a run stops is a rule in nats, so the share hardly depends on the run."""
    weights, n_live = bimodal_result.run.weights, bimodal_result.config.n_live
    assert weights[-n_live:].sum() == pytest.approx(1 / 3, abs=0.03)
    assert weights.argmax() >= len(weights) - n_live


def test_at_the_saddle_the_wide_prior_only_lengthens_the_run(bimodal_result):
    """At c = 1 both modes are found as well: the covariance there is as wide as the weak prior.

    Four runs each between 0.1 and 0.9; a mass scatters by 0.09 (4 of its sigmas: 5e-4 for all).
    """
    config = bimodal_result.config
    assert np.sqrt(bimodal_result.covariance[1, 1]) == pytest.approx(config.landmark_prior_sigma)
    plain = bimodal.run(config.model_copy(update={"prior_scale": 1.0, "n_repeats": 4}))
    assert ((plain.upper_masses > 0.1) & (plain.upper_masses < 0.9)).all()
    calls = [np.mean([one.calls for one in found.runs]) for found in (plain, bimodal_result)]
    assert calls[0] < 0.8 * calls[1]


def test_one_run_cannot_know_its_own_mass_error(bimodal_result):
    """The spread of 20 runs exceeds the resampled error; the ratio is near 3.5.

    Under equality of the two, 20 runs exceed twice the error with probability below 1e-6.
    """
    assert bimodal_result.upper_mass_error > 2 * bimodal_result.resampled_error


def test_bimodal_moments(bimodal_result):
    """sigma_y near the half distance of the modes, whatever the mass; coefficient near one."""
    height = bimodal_result.config.modes[0, 1]
    assert 0.8 * height < bimodal_result.sigma_y < 1.15 * height
    assert bimodal_result.bimodality > 0.9
    assert bimodal.mode_width(bimodal_result) < 0.5


def test_bimodal_tables_and_figures(bimodal_result, tmp_path):
    table = show.comparison_table(bimodal_result).map(str)
    assert set(table["printed"]) >= {"−12.50", "12.49", "2.21", "0.62"}
    assert list(table["ours"])[2] == "−12.50"
    assert str(show.hessian_table(bimodal_result.config)["smallest"][1]).startswith("−")
    to = report.Report("x", tmp_path)
    show.record(bimodal_result, to)
    handed_on(to)
    config = bimodal_result.config
    fig, axes = plt.subplots(1, 6, figsize=(2 * 6, 2.5))
    show.draw_circles(axes[0], config.anchors, 3.0, {"modes": config.modes})
    show.draw_profile(axes[1], np.arange(3.0), {"a": np.arange(3.0)})
    points = {"iSAM2": bimodal_result.map, "modes": config.modes}
    show.draw_samples(axes[2], bimodal_result.samples, bimodal_result.weights, points)
    show.draw_histogram(axes[3], bimodal_result.samples[:, 1], bimodal_result.weights, [0.0])
    assert drawn_as_printed(axes[2]) == {"printed best": ([1.984], [-2.232])}
    ((ends, _),) = drawn_as_printed(axes[3]).values()
    assert ends == [-2.21, 2.21]
    show.draw_repeated_masses(axes[4], bimodal_result.upper_masses, 0.1, 0.2)
    show.draw_live_points(axes[5], np.arange(3.0), np.arange(3.0))
    show.draw_shrinkage(axes[0], -np.arange(3.0), -np.arange(3.0))
    show.draw_weights(axes[1], np.arange(3.0), -np.arange(3.0), np.arange(1.0, 4.0))
    show.draw_live_panels(axes[2:4], [config.modes, config.modes], (0, 1), config)
    played = show.live_film([config.modes] * 30, config).pictures
    assert next(played)[0] == "0 points discarded"
    assert [plt.close(drawn) or text for text, drawn in played][-1] == "29 points discarded"
    to.figure(fig, "all", png=True)
    assert show.run_plot(bimodal_result.run) is not None
    assert (tmp_path / "x_all.pdf").exists()
    assert (tmp_path / "x_all.png").exists()


def test_circles_that_do_not_cross_are_refused():
    with pytest.raises(ValueError, match=r"measured_range is 1\.9"):
        bimodal.Config(measured_range=1.9)
    TwoAnchors(range_sigma=9.9)  # the curvatures 2 (1 - z / rho) / sigma^2 and 1 / 10^2 balance
    with pytest.raises(ValueError, match="landmark_prior_sigma"):  # at 10
        TwoAnchors(range_sigma=10.1)


def test_places_that_no_sampler_finds_are_refused():
    bimodal.Config(range_sigma=7.0)  # two ranges err by 1 m at the saddle: half of 1 / sigma^2
    with pytest.raises(ValueError, match=r"range_sigma is 7\.1.*0.0099 nats"):
        bimodal.Config(range_sigma=7.1)
    with pytest.raises(ValueError, match=r"landmark_prior_sigma is 10\.0.*at 150 m"):
        bimodal.Config(measured_range=150.0)


def test_the_modes_are_those_the_printed_numbers_are_held_against():
    assert np.allclose(TwoAnchors().modes[0], contradictions.MODE, rtol=1e-15)


def test_the_notebook_depends_on_nothing_it_does_not_show():
    """No room of the library but those of the lesson: a plot of another study leaves it fresh."""
    cells = notebooks.sources("01_bimodal", code_only=True)  # fmt: skip
    files = dependencies.imported_files("01_bimodal", cells)
    rooms = {path.relative_to(paths.PACKAGE).parts[0] for path in files}
    assert not rooms & {"sngr", "detection", "online", "robust", "experiments"}
    with_gtsam = {path.stem for path in files if "import gtsam" in path.read_text()}
    assert with_gtsam == {"bimodal", "likelihood", "two_anchors"}


# --- nested sampling from scratch ---------------------------------------------------------------


PLANE = bimodal.Config()  # made once: the likelihood is asked a hundred thousand times


def plane_log_likelihood(point):
    """The ranges of notebook 01 at a place (..., 2), [nats]."""
    distances = np.linalg.norm(np.asarray(point)[..., None, :] - PLANE.anchors, axis=-1)
    return -0.5 * np.sum(((distances - PLANE.measured_range) / PLANE.range_sigma) ** 2, axis=-1)


CORNERS = np.array([[-6.0, -8.0], [10.0, 8.0]])


def test_evidence_from_scratch_is_that_of_a_grid(from_scratch):
    """One and two dimensions, six runs each: their mean at 4.5 of its stated standard errors (7e-6
    a side and dimension, if the stated errors are right; the test of the spread is dynesty's)."""
    config, n_live = bimodal.Config(), 50
    line = (lambda point: float(config.profile(point[0], 1.0)), [[-5.0], [5.0]], 350)
    for log_likelihood, corners, steps in (line, (plane_log_likelihood, CORNERS, 500)):
        low, high = np.array(corners)
        axes = [np.linspace(a, b, 801) for a, b in zip(low, high, strict=True)]
        grid = np.stack(np.meshgrid(*axes), axis=-1)
        values = config.profile(grid[..., 0], 1.0) if len(low) == 1 else log_likelihood(grid)
        exact = np.logaddexp.reduce(values, axis=None) - np.log(values.size)
        found = []
        for rng in np.random.default_rng(7).spawn(6):
            _, heights, _ = from_scratch["nested_sampling"](
                log_likelihood, low, high, n_live, steps, rng
            )
            log_z, weights, _ = from_scratch["weigh"](heights, n_live)
            found.append((log_z - exact, weights @ (heights - log_z) / n_live))
        errors, variances = np.transpose(found)
        assert abs(errors.mean()) < 4.5 * np.sqrt(variances.sum()) / len(errors)


def test_evidence_from_scratch_is_dynestys(from_scratch):
    """Same likelihood and prior; at 4.5 of both stated errors together (7e-6)."""
    from dynesty import NestedSampler

    low, high = CORNERS
    sampler = NestedSampler(
        plane_log_likelihood, lambda u: low + u * (high - low), 2, nlive=100, sample="rwalk",
        rstate=np.random.default_rng(0),
    )  # fmt: skip
    sampler.run_nested(dlogz=0.1, print_progress=False)
    theirs = sampler.results
    rng = np.random.default_rng(0)
    _, heights, _ = from_scratch["nested_sampling"](plane_log_likelihood, low, high, 100, 1000, rng)
    log_z, weights, _ = from_scratch["weigh"](heights, 100)
    error = np.hypot(theirs["logzerr"][-1], np.sqrt(weights @ (heights - log_z) / 100))
    assert abs(log_z - theirs["logz"][-1]) < 4.5 * error


def test_weights_from_scratch_add_up_and_volumes_shrink_by_their_law(from_scratch):
    heights = np.sort(np.random.default_rng(0).normal(size=150))
    log_z, weights, log_volume = from_scratch["weigh"](heights, 50)
    assert weights.sum() == pytest.approx(1)
    assert np.allclose(np.diff(log_volume), -1 / 50)
    assert len(log_volume) == 101
    assert heights.min() < log_z < heights.max()
    constant = from_scratch["weigh"](np.full(150, 3.0), 50)[0]
    assert constant == pytest.approx(3.0)  # a constant likelihood is its own evidence
