"""Compile everything that is compiled, once, before notebooks and tests run side by side.

``python -m sngr_utils compile``; seconds if an earlier run has done it.
"""

import gc
from collections.abc import Callable

import gtsam
import joblib
import numpy as np

from sngr_utils.detection import leverage, mirror_image
from sngr_utils.experiments import estimators, one_range, sampler_contest
from sngr_utils.online import estimator, window
from sngr_utils.robust import louis_covariance
from sngr_utils.sampling import engines
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.slam import chain_problem, chain_solver, conventions
from sngr_utils.slam.selected_inverse import covariance_at
from sngr_utils.world import scenario, simulation


def compile_all(jobs: int = 2) -> None:
    """Call every compiled function with arguments of the types that it is used with.

    In two processes, whose parts share hardly a function: what both call is compiled twice.
    """
    parts = (compile_estimators, compile_samplers)
    joblib.Parallel(n_jobs=jobs)(joblib.delayed(_uncollected)(part) for part in parts)


def _uncollected(part: Callable[[], None]) -> None:
    """Call without looking for cycles of garbage: a tenth of the time, and nearly all stays."""
    gc.disable()
    try:
        part()
    finally:
        gc.enable()


def compile_samplers() -> None:
    """Nested samplers of windows, and the samplers of small posteriors."""
    _sample("nested")
    sampler_contest.compile_all()


def compile_estimators() -> None:
    """The online estimator, what it is made of, the batch estimates, and marginals of windows."""
    log, places = _small().log(conventions.PRESETS["C"].x0_sigmas), _small().landmarks
    settings, rng = estimator.Settings(), np.random.default_rng(0)
    estimator.run(log, conventions.PRESETS["C"], settings, rng=rng)
    chain = chain_problem.of_log(log, places, 1.0)  # what a longer log would ask for
    at = chain_solver.state_of(chain, _small().poses, places)
    window.marginalise(chain, window.nothing(len(places)), at)
    for method in ("em", "em_exclusive", "gnc_tls", "switchable", "max_mixture_all", "fastslam"):
        _estimate(method)
    _sample("fast")
    mirror_image.mirror_test(np.zeros((1, 2)), np.ones(1), np.ones(1), np.ones(2))
    mirror_image.gaps(np.zeros((1, 2)), np.ones(1), np.ones(1), np.ones(2), np.ones(1, int))
    louis_covariance.times(np.ones((1, 3, 3)), np.ones((1, 3, 5)), np.eye(5), np.ones((5, 1)))
    one_range.kernels(np.zeros(1), scenario.Scenario())
    at = _small().poses, places
    covariance = covariance_at(*at, _small(), conventions.PRESETS["C"])
    leverage.chi_square(_small(), *at, covariance)


def _estimate(method: str) -> None:
    """Run one of the batch estimates on a small world."""
    rng = np.random.default_rng(0)
    estimators.estimate(_small(), conventions.PRESETS["C"], method, "grid", rng=rng)


def _sample(engine: str) -> None:
    """Sample one point with a prior by one of the compiled engines."""
    factors = compiled.flatten(gtsam.NonlinearFactorGraph(), gtsam.Values(), [], 1.0)._replace(
        points=np.zeros((1, 2)), counts=np.array([0, 1, 0, 0, 1, 0, 0]),
        of=np.zeros((1, 2), dtype=np.uint64), measured=np.array([[0.0] * 5 + [1.0, 1.0, 0.0]]),
    )  # fmt: skip
    settings, rng = SamplerSettings(n_live=20), np.random.default_rng(0)
    engines.sample_factors(factors, np.eye(2), settings, engine, rng=rng)
    compiled.log_likelihoods(factors, np.zeros((1, 2)))


def _small() -> simulation.World:
    return simulation.simulate(scenario.Scenario(n_poses=12), 0.2, rng=np.random.default_rng(0))
