"""Every sampler on the experiment of notebook 1: a landmark seen from two known anchors."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from sngr_utils.experiments import sampler_contest
from sngr_utils.experiments.many_worlds import map_rows
from sngr_utils.sampling import weighted_samples
from sngr_utils.sampling.modes import find_modes, ring_starts
from sngr_utils.sampling.reference import landmark_reference
from sngr_utils.sampling.targets.landmark import Landmark
from sngr_utils.world.two_anchors import TwoAnchors

SCENE = TwoAnchors()


def posterior() -> Landmark:
    """The landmark: two known anchors, a range from each."""
    return Landmark(SCENE.anchors, np.zeros((4, 4)), np.full(2, SCENE.measured_range),
                    SCENE.range_sigma, SCENE.saddle, SCENE.landmark_prior_sigma)  # fmt: skip


def start_at(place: str) -> tuple[np.ndarray, np.ndarray]:
    """(2,) start and (2, 2) covariance that a solver reports there, "saddle" or "mode".

    At the saddle the paper's solver stays. The covariance it reports there is that of the
    landmark's own prior, in the direction in which the landmark could be on either side.
    """
    start = SCENE.modes[0] if place == "mode" else SCENE.saddle
    return start, np.linalg.inv(SCENE.gauss_newton_hessian(start))


def nested_from_a_mode(n_live: int, seed: int) -> dict[str, weighted_samples.WeightedSamples]:
    """Nested sampling on the two anchors, the Gaussian priors about one of the two places."""
    rng = np.random.default_rng([seed, 9])
    return sampler_contest.plane_nested(posterior(), *start_at("mode"), n_live, rng=rng)


def draw_priors(n: int, *, rng: np.random.Generator) -> dict[str, np.ndarray]:
    """(n, 2) draws of each prior on the two anchors, the Gaussian ones about a mode, [m]."""
    priors = sampler_contest.plane_priors(posterior(), *start_at("mode"))
    return {name: prior.draw(n, rng=rng) for name, prior in priors.items()}


def run(n_live: int, seeds: Sequence[int], jobs: int) -> pd.DataFrame:
    """All methods on the two anchors.

    Returns
    -------
    one row per case, size (poses, or ranges per pose), seed and method: the errors of
    `sampler_contest.judge`
    """
    return pd.DataFrame(map_rows(_one, [(n_live, seed) for seed in seeds], jobs))


def _one(n_live: int, seed: int) -> list[dict]:
    target = posterior()
    modes = find_modes(target, ring_starts(target))
    errors = sampler_contest.judge(landmark_reference(target), modes)
    rng, start = np.random.default_rng([seed, 9]), start_at("saddle")
    by_place = {"saddle": sampler_contest.plane_runs(target, *start, n_live, rng=rng)}
    narrow = nested_from_a_mode(n_live, seed)  # the other methods do not depend on the start
    by_place["mode"] = {name: narrow[name] for name in sampler_contest.SCALES}
    rows = []
    for place, runs in by_place.items():
        head = {"case": f"two anchors, from the {place}", "size": 2, "seed": seed}
        rows += [{**head, "method": name, **errors(run)} for name, run in runs.items()]
    return rows
