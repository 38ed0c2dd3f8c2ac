"""Five methods on one small posterior, and their errors against a reference.

One Gaussian at the MAP (Laplace), nested sampling inside N(MAP, c Sigma) with the paper's two c,
nested sampling inside the ancestral prior, and optimisation from many starts with importance
sampling. All are told the same target; they differ in where they look.
"""

from collections.abc import Callable

import numpy as np

from sngr_utils import ancestral, brute_force, many_starts
from sngr_utils.landmark_target import Landmark
from sngr_utils.many_starts import Modes
from sngr_utils.nested import NestedRun, SamplerSettings
from sngr_utils.window_target import Window

METHODS = ("one Gaussian", "c = 1", "c = 50", "ancestral", "many starts")
SCALES = {"c = 1": 1.0, "c = 50": 50.0}  # of the Gaussian priors, the paper's
PLANE_WALKS, WINDOW_WALKS = 25, 50  # steps; shorter walks bias the evidence
N_STARTS, PLANE_DRAWS, WINDOW_DRAWS = 32, 4_000, 20_000


def plane_runs(
    target: Landmark, start: np.ndarray, covariance: np.ndarray, n_live: int,
    *, rng: np.random.Generator,
) -> dict[str, NestedRun]:  # fmt: skip
    """Every method on a landmark, the Gaussian priors being N(start, c covariance)."""
    modes = many_starts.find_modes(target, many_starts.ring_starts(target))
    settings = SamplerSettings(n_live=n_live, min_walks=PLANE_WALKS)
    priors = {name: ancestral.gaussian(start, covariance, c) for name, c in SCALES.items()}
    priors["ancestral"] = ancestral.ring(target)
    return _runs(target, modes, priors, settings, PLANE_DRAWS, rng)


def window_runs(
    target: Window, n_live: int, *, rng: np.random.Generator
) -> dict[str, NestedRun]:  # fmt: skip
    """Every method on a window, the Gaussian priors about the best of the modes found."""
    tree = ancestral.tree(target)
    modes = many_starts.find_modes(target, tree.draw(N_STARTS, rng=rng))
    settings = SamplerSettings(n_live=n_live, min_walks=WINDOW_WALKS)
    best = modes.places[0], modes.covariances[0]
    priors = {name: ancestral.gaussian(*best, c) for name, c in SCALES.items()}
    return _runs(target, modes, {**priors, "ancestral": tree}, settings, WINDOW_DRAWS, rng)


def _runs(target, modes, priors, settings, draws, rng) -> dict[str, NestedRun]:
    nested = {
        name: ancestral.sample(target, prior, settings, rng=rng) for name, prior in priors.items()
    }
    return {
        "one Gaussian": many_starts.laplace_draws(modes, PLANE_DRAWS, rng=rng),
        **nested,
        "many starts": many_starts.mixture_draws(target, modes, draws, rng=rng),
    }


def window_truth(
    target: Window, n_particles: int, *, rng: np.random.Generator
) -> tuple[brute_force.Reference, Modes]:
    """A window's reference and its modes, from starts drawn from prior and posterior alike."""
    reference = brute_force.window_reference(target, n_particles, rng=rng)
    drawn = reference.points[rng.choice(len(reference.points), N_STARTS, p=reference.weights)]
    starts = np.concatenate([ancestral.tree(target).draw(N_STARTS, rng=rng), drawn])
    return reference, many_starts.find_modes(target, starts)


def judge(
    reference: brute_force.Reference, modes: Modes, plane: Callable[[np.ndarray], np.ndarray]
) -> Callable[[NestedRun], dict[str, float]]:
    """run -> its mass_error (largest over the modes), divergence, evidence_error [nats], calls.

    Parameters
    ----------
    plane : (N, d) points to the (N, 2) places over whose cells the divergence is taken, [m]
    """
    exact = reference.masses(modes.label(reference.points), len(modes.places))
    parts = brute_force.cells(plane(reference.points), reference.weights)

    def errors(run: NestedRun) -> dict[str, float]:
        masses = np.bincount(modes.label(run.samples), run.weights, minlength=len(exact))
        return {
            "mass_error": float(abs(masses - exact).max()),
            "divergence": parts.divergence(plane(run.samples), run.weights),
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
    ancestral.sample(window, ancestral.tree(window), settings, rng=rng)
    brute_force.window_reference(window, 10, rng=rng)
    landmark = Landmark(np.zeros((1, 2)), np.zeros((2, 2)), np.ones(1), 1.0, np.zeros(2), 1.0)
    ancestral.sample(landmark, ancestral.ring(landmark), settings, rng=rng)
    brute_force.landmark_reference(landmark, 4, 4)
