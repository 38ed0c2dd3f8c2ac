"""Six methods on one small posterior, and their errors against a reference.

One Gaussian at the MAP (Laplace), nested sampling inside N(MAP, c Sigma) with the paper's two c and
inside the ancestral prior, all with equally many live points; importance sampling about the places
that the ancestral run has found; and the same about those of optimisation from many starts. All are
told the same target; they differ in where they look.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from sngr_utils.sampling import adaptive_importance, ancestral_priors
from sngr_utils.sampling.modes import Modes, find_modes, laplace_draws, ring_starts
from sngr_utils.sampling.reference import Reference, landmark_reference, window_reference
from sngr_utils.sampling.settings import SamplerSettings
from sngr_utils.sampling.targets.ambiguous_window import Window
from sngr_utils.sampling.targets.landmark import Landmark
from sngr_utils.sampling.weighted_samples import WeightedSamples

METHODS = ("one Gaussian", "c = 1", "c = 50", "ancestral", "ancestral, reweighted", "many starts")
SCALES = {"c = 1": 1.0, "c = 50": 50.0}  # of the Gaussian priors, the paper's
PLANE_WALKS, WINDOW_WALKS = 25, 50  # steps; shorter walks bias the evidence
EVIDENCE_ERROR, MASS_ERROR = 0.1, 0.01  # [nats] and of a mode, largest of a reference
N_STARTS = 100  # of the methods, in a window
TRUTH_STARTS = 16  # from the prior, and from the posterior, for the modes of the reference
PLANE_DRAWS, WINDOW_DRAWS = 4_000, 10_000  # in a round


def plane_runs(
    target: Landmark, start: np.ndarray, covariance: np.ndarray, n_live: int,
    *, rng: np.random.Generator,
) -> dict[str, WeightedSamples]:  # fmt: skip
    """Every method on a landmark, the Gaussian priors being N(start, c covariance)."""
    modes, settings = find_modes(target, ring_starts(target)), _plane_settings(n_live)
    priors = plane_priors(target, start, covariance)
    return _runs(target, modes, priors, settings, PLANE_DRAWS, rng)


def plane_nested(
    target: Landmark, start: np.ndarray, covariance: np.ndarray, n_live: int,
    *, rng: np.random.Generator,
) -> dict[str, WeightedSamples]:  # fmt: skip
    """The same, nested sampling only."""
    return _nested(target, plane_priors(target, start, covariance), _plane_settings(n_live), rng)


def plane_priors(
    target: Landmark, start: np.ndarray, covariance: np.ndarray
) -> dict[str, ancestral_priors.Prior]:
    """The priors of nested sampling on a landmark."""
    priors = {name: ancestral_priors.gaussian(start, covariance, c) for name, c in SCALES.items()}
    return {**priors, "ancestral": ancestral_priors.ring(target)}


def _plane_settings(n_live: int) -> SamplerSettings:
    return SamplerSettings(n_live=n_live, min_walks=PLANE_WALKS)


def window_runs(
    target: Window, n_live: int, *, rng: np.random.Generator
) -> dict[str, WeightedSamples]:  # fmt: skip
    """Every method on a window, the Gaussian priors about the best of the modes found."""
    tree = ancestral_priors.tree(target)
    modes = find_modes(target, tree.draw(N_STARTS, rng=rng))
    settings = SamplerSettings(n_live=n_live, min_walks=WINDOW_WALKS)
    best = modes.places[0], modes.covariances[0]
    priors = {name: ancestral_priors.gaussian(*best, c) for name, c in SCALES.items()}
    return _runs(target, modes, {**priors, "ancestral": tree}, settings, WINDOW_DRAWS, rng)


def _runs(target, modes, priors, settings, draws, rng) -> dict[str, WeightedSamples]:
    nested = _nested(target, priors, settings, rng)
    return {
        "one Gaussian": laplace_draws(modes, PLANE_DRAWS, rng=rng),
        **nested,
        "ancestral, reweighted": _reweighted(target, nested["ancestral"], draws, rng),
        "many starts": adaptive_importance.draws(target, modes, draws, rng=rng),
    }


def _nested(target, priors, settings, rng) -> dict[str, WeightedSamples]:
    return {
        name: ancestral_priors.sample(target, prior, settings, rng=rng)
        for name, prior in priors.items()
    }


def _reweighted(target, run, draws, rng) -> WeightedSamples:
    """Importance sampling about the places that a run's draws climb to.

    Live points drift between places that are far apart, and the masses of nested sampling with
    them. Importance weights know nothing of that: the run need only have found every place.
    """
    starts = run.samples[rng.choice(len(run.samples), N_STARTS // 2, p=run.weights)]
    modes = find_modes(target, starts)
    again = adaptive_importance.draws(target, modes, draws, rng=rng)
    return replace(again, calls=again.calls + run.calls)


def window_truth(
    target: Window, n_particles: int, mass_error: float = MASS_ERROR, *, rng: np.random.Generator
) -> tuple[Reference, Modes]:
    """A window's reference and its modes, from starts drawn from prior and posterior alike.

    Four times as many particles, and again, until evidence and masses are known to
    `EVIDENCE_ERROR` and `mass_error`; 64 times as many at most.
    """
    for more in (1, 4, 16, 64):
        reference = window_reference(target, more * n_particles, n_particles, rng=rng)
        chosen = rng.choice(len(reference.samples), TRUTH_STARTS, p=reference.weights)
        drawn = ancestral_priors.tree(target).draw(TRUTH_STARTS, rng=rng)
        starts = np.concatenate([drawn, reference.samples[chosen]])
        modes = find_modes(target, starts)
        error = reference.mass_error(modes.label(reference.samples), len(modes.places))
        if reference.log_evidence_error <= EVIDENCE_ERROR and error <= mass_error:
            break
    return reference, modes


def judge(reference: Reference, modes: Modes) -> Callable[[WeightedSamples], dict[str, float]]:
    """run -> its mass_error (largest over the modes), evidence_error [nats], calls."""
    exact = reference.masses(modes.label(reference.samples), len(modes.places))

    def errors(run: WeightedSamples) -> dict[str, float]:
        masses = np.bincount(modes.label(run.samples), run.weights, minlength=len(exact))
        return {
            "mass_error": float(abs(masses - exact).max()),
            "evidence_error": run.log_evidence - reference.log_evidence,
            "calls": run.calls,
        }

    return errors


def compile_all() -> None:
    """Compile the targets and the sampler for them, or load what an earlier run has compiled."""
    rng, settings = np.random.default_rng(0), SamplerSettings(n_live=20)
    window = Window(
        np.zeros(3), np.ones(3), np.zeros((0, 3)), np.ones(3), np.zeros(1, int), np.ones(1),
        np.zeros((1, 1)), np.zeros((1, 2)), 1.0,
    )  # fmt: skip
    landmark = Landmark(
        np.array([[0.0, 0.0], [1.0, 0.0]]), np.zeros((4, 4)), np.ones(2), 1.0, np.zeros(2), 1.0
    )  # fmt: skip
    window_reference(window, 10, rng=rng)
    landmark_reference(landmark, 4, 4)
    for target, prior in (
        (window, ancestral_priors.tree(window)),
        (landmark, ancestral_priors.ring(landmark)),
    ):
        ancestral_priors.sample(target, prior, settings, rng=rng)
        modes = find_modes(target, rng.standard_normal((9, target.dimension)))
        adaptive_importance.draws(target, modes, 100, rng=rng)
