"""The posterior of one place in the plane, from ranges any of which may be wrong.

A range does not care which of its ends is unknown. So this is the start of a landmark, seen
from known poses, and it is also the position of a lost robot among known landmarks. After few
ranges the posterior is a ring or a pair of mirror images: no Gaussian, and no place for one
optimiser. Many starts come first, with importance sampling about the modes they end in; where
its weights say that they missed something, nested sampling draws it.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from scipy import stats

from sngr_utils.detection import mirror_image
from sngr_utils.numerics.jit import compile_once
from sngr_utils.sampling import compiled_nested, importance
from sngr_utils.sampling.settings import FastSettings
from sngr_utils.sampling.targets import compiled
from sngr_utils.sampling.targets.place import Evidence
from sngr_utils.sampling.weighted_samples import WeightedSamples
from sngr_utils.slam import landmark_starts

N_LIVE, WALKS, DLOGZ = 100, 25, 0.5  # of the nested sampler, in two dimensions
CROSSED = 128  # ranges whose circles are crossed, at most: work grows with the cube of them
START_APART = 3.0  # sigmas of a range, nearer than which two crossings are one start
GATE = stats.chi2.ppf(0.99, 1)  # squared normalised error of a range that fits
MAX_MODES = 4  # what is beyond them is left without a mode
ENOUGH_MASS = 0.9  # of the first mode: the place is known
LEAST_GAP = math.log(ENOUGH_MASS / (1 - ENOUGH_MASS))  # nats by which a mirror image is then worse
CLAIM = stats.chi2.ppf(0.999, 2)  # a mode claims what its Gaussian holds at this level


def crossing_starts(evidence: Evidence, most: int) -> np.ndarray:
    """(S, 2) crossings of every two circles, the likeliest first, no two of them near. [m]

    Of more than `CROSSED` ranges, the circles of those that are least likely wrong; of equal ones
    the first.

    Parameters
    ----------
    most : S at most
    """
    some = np.sort(np.argsort(evidence.wrong, kind="stable")[:CROSSED])
    places = landmark_starts.crossings(evidence.anchors[some], evidence.ranges[some])
    log_densities = _log_densities(evidence, places - evidence.centre)
    apart = START_APART * math.sqrt(evidence.variances.min())
    return _likeliest(places, log_densities, apart, most)


@compile_once
def _likeliest(places, log_densities, apart, most):
    """(S, 2) of (P, 2) places, the likeliest first, no two of them nearer than `apart`."""
    chosen, found = np.empty((most, 2)), 0
    while found < most and log_densities.max() > -np.inf:
        chosen[found] = places[np.argmax(log_densities)]
        for i in range(len(places)):
            dx, dy = places[i, 0] - chosen[found, 0], places[i, 1] - chosen[found, 1]
            if dx * dx + dy * dy <= apart**2:
                log_densities[i] = -np.inf
        found += 1
    return chosen[:found].copy()


def _log_densities(evidence: Evidence, xi: np.ndarray) -> np.ndarray:
    """(P,) of the posterior at (P, 2) offsets from the centre, up to a constant, [nats]."""
    return compiled.log_likelihoods(evidence.factors, xi) + _log_prior(evidence, xi)


def _log_prior(evidence: Evidence, xi: np.ndarray) -> np.ndarray:
    """(P,) of the prior at (P, 2) offsets from the centre, up to a constant, [nats]."""
    return -0.5 * np.sum(xi**2, axis=1) / evidence.sigma**2


def mirrored(evidence: Evidence) -> bool:
    """Is there plainly a second place, the mirror image of the likeliest? No sampling.

    The likeliest place says which ranges are right, and the mirror test is made with these.
    """
    best = crossing_starts(evidence, 1)[0]
    fit = fitting(evidence, best, evidence.variances)
    if fit.sum() < 3:
        return True
    found = mirror_image.mirror_test(
        evidence.anchors[fit], evidence.ranges[fit], evidence.variances[fit], best
    )
    return found.gap < LEAST_GAP


def fitting(evidence: Evidence, place: np.ndarray, variances: np.ndarray) -> np.ndarray:
    """(N,) bool: the ranges that a (2,) place explains, given their (N,) variances, [m^2]."""
    distances = np.linalg.norm(place - evidence.anchors, axis=1)
    return (distances - evidence.ranges) ** 2 < GATE * variances


def many_starts(evidence: Evidence, *, rng: np.random.Generator) -> tuple[WeightedSamples, bool]:
    """The posterior by importance sampling about its modes, and whether its weights are sound.

    Sound are weights of enough effective draws and without a heavy tail (`importance`).

    Raises
    ------
    importance.NoModeError : no start ended in a mode
    """
    settings = FastSettings()
    found = importance.sample(
        evidence.factors, evidence.sigma * np.eye(2), settings,
        crossing_starts(evidence, settings.n_starts) - evidence.centre, rng=rng,
    )  # fmt: skip
    doubts = {"k-hat", "ESS"}.intersection(found.diagnostics.objections)
    return _placed(found, evidence), not doubts


def sample(evidence: Evidence, *, rng: np.random.Generator) -> WeightedSamples:
    """The posterior by nested sampling (`compiled_nested`), about ten milliseconds."""
    run = compiled_nested.sample(
        evidence.factors, evidence.sigma * np.eye(2), N_LIVE, WALKS, DLOGZ, rng=rng
    )
    return _placed(run, evidence)


def _placed(run: WeightedSamples, evidence: Evidence) -> WeightedSamples:
    """From offsets to places, and to the log of the density of the ranges for the evidence."""
    return replace(
        run,
        samples=run.samples + evidence.centre,
        log_evidence=run.log_evidence + evidence.ceiling,
    )


@dataclass(frozen=True)
class Mode:
    """One place where the posterior is high.

    Attributes
    ----------
    mean : (2,) of what it claims, [m]
    covariance : (2, 2) of what it claims, [m^2]
    mass : share of the posterior
    """

    mean: np.ndarray
    covariance: np.ndarray
    mass: float


def modes(posterior: WeightedSamples, evidence: Evidence) -> list[Mode]:
    """The modes by falling mass, each of them one Gaussian.

    The most likely place that no mode has claimed yet is the next mode. It claims all places
    within the 99.9 % ellipse of its Gaussian (Laplace's, of the ranges that are right there). So
    a ring falls into many modes of little mass, and a mass near one says two things: there is
    one place, and a Gaussian describes it.
    """
    places, free = posterior.samples, posterior.weights > 0
    log_densities = posterior.log_likelihoods + _log_prior(evidence, places - evidence.centre)
    found = []
    while free.any() and len(found) < MAX_MODES:
        best = places[np.argmax(np.where(free, log_densities, -np.inf))]
        offsets = places - best
        information = _information(evidence, best)
        own = free & (np.sum(offsets @ information * offsets, axis=1) < CLAIM)
        weights = posterior.weights[own]
        mass = weights.sum()
        mean = weights @ places[own] / mass
        centred = places[own] - mean
        covariance = (weights[:, None] * centred).T @ centred / mass
        found.append(Mode(mean, covariance, float(mass)))
        free &= ~own
    return sorted(found, key=lambda mode: -mode.mass)


def _information(evidence: Evidence, place: np.ndarray) -> np.ndarray:
    """(2, 2) information about a place, each range counting as far as it is right there."""
    offsets = place - evidence.anchors
    distances = np.linalg.norm(offsets, axis=1)
    right = np.exp(-0.5 * (distances - evidence.ranges) ** 2 / evidence.variances)
    share = right / np.maximum(right + evidence.floors, 1e-300)  # both may be 0
    directions = offsets / np.maximum(distances, 1e-9)[:, None]
    weighted = directions * (share / evidence.variances)[:, None]
    return weighted.T @ directions + np.eye(2) / evidence.sigma**2
