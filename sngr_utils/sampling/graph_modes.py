"""The modes of a small log's posterior: nested sampling finds them, ascents tell them apart.

This is for graphs that NSFG and NF-iSAM are shown on: some poses, few landmarks, ranges that may
belong to one landmark or another.
"""

from dataclasses import dataclass

import numpy as np

from sngr_utils.sampling import compiled_nested
from sngr_utils.sampling.modes import find_modes
from sngr_utils.sampling.targets import whole_graph
from sngr_utils.world.log import Log

N_LIVE, WALKS, DLOGZ = 600, 60, 0.1  # of the nested sampler
STARTS = 100  # draws of the posterior from which its maxima are sought


@dataclass(frozen=True)
class GraphMode:
    """One of the places where a posterior is high, all variables together.

    Attributes
    ----------
    mass : share of the posterior
    poses, landmarks : (T, 2) and (K, 2) means of the positions, [m]
    pose_covariances, landmark_covariances : (T, 2, 2) and (K, 2, 2), [m^2]
    """

    mass: float
    poses: np.ndarray
    landmarks: np.ndarray
    pose_covariances: np.ndarray
    landmark_covariances: np.ndarray


def modes_of(log: Log, *, rng: np.random.Generator) -> list[GraphMode]:
    """The modes of a log's posterior by falling mass; a draw belongs to the likeliest of them.

    Raises
    ------
    ValueError : a log that `whole_graph.of_log` refuses, or a posterior without a maximum
    """
    target = whole_graph.of_log(log)
    mean, lower = target.root
    run = compiled_nested.sample(target.over(mean, lower), lower, N_LIVE, WALKS, DLOGZ, rng=rng)
    starts = run.samples[rng.choice(len(run.samples), STARTS, p=run.weights)]
    label = find_modes(target, starts).label(run.samples)
    poses, landmarks = target.placed(run.samples)
    found = []
    for mode in np.unique(label):
        weights = np.where(label == mode, run.weights, 0.0)
        mass = float(weights.sum())
        if mass > 0:
            places = (_moments(weights / mass, at) for at in (poses[:, :, :2], landmarks))
            (means, spread), (points, point_spread) = places
            found.append(GraphMode(mass, means, points, spread, point_spread))
    return sorted(found, key=lambda mode: -mode.mass)


def _moments(weights: np.ndarray, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(P, 2) means and (P, 2, 2) covariances of (N, P, 2) weighted places."""
    means = np.einsum("n,npi->pi", weights, places)
    centred = places - means
    return means, np.einsum("n,npi,npj->pij", weights, centred, centred)
