from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from sngr_utils.online import rivals
from sngr_utils.robust import em
from sngr_utils.slam import conventions
from sngr_utils.world import scenario, simulation

C = conventions.PRESETS["C"]


def fit(log, start, widest):
    return em.fit(log, C, start, exclusive=True, clutter=True, widest=widest)


@pytest.fixture(scope="module")
def drawn():
    return simulation.simulate(scenario.Scenario(), 0.3, rng=np.random.default_rng(101))


@pytest.fixture(scope="module")
def best(drawn):
    return fit(drawn.log(C.x0_sigmas), (drawn.poses, drawn.landmarks), 1.0)


def same(found, best):
    return np.abs(found.landmarks - best.landmarks).max() < 1e-2


def test_landmarks_that_have_exchanged_their_names_get_them_back(drawn, best):
    log = drawn.log(C.x0_sigmas)
    exchanged = fit(log, (best.poses, best.landmarks[[1, 0, 2, 3, 5, 4]]), 1.0)
    assert not same(exchanged, best)
    assert same(rivals.renamed(log, exchanged, fit), best)
    assert rivals.renamed(log, best, fit) is best


@pytest.mark.parametrize("lost", [np.nan, 9.8])
def test_a_landmark_that_is_absent_or_astray_is_found(drawn, best, lost):
    log, places = drawn.log(C.x0_sigmas), best.landmarks.copy()
    places[2] = lost
    wanting = fit(log, (best.poses, places), 1.0)
    assert rivals._wanting(wanting)
    assert same(rivals.repaired(log, wanting, fit), best)


def test_estimates_differ_by_what_their_covariance_says_or_in_a_landmark(drawn, best):
    log = drawn.log(C.x0_sigmas)
    other = partial(replace, best)
    metre = np.array([1.0, 0.0, 0.0])
    assert not rivals.differ(log, best, other(poses=best.poses + 0.001 * metre))
    assert rivals.differ(log, best, other(poses=best.poses + metre))
    elsewhere, absent = best.landmarks.copy(), best.landmarks.copy()
    elsewhere[3] += 0.6
    absent[3] = np.nan
    assert rivals.differ(log, best, other(landmarks=elsewhere))
    assert rivals.differ(log, best, other(landmarks=absent))


@pytest.mark.parametrize("step", [1, 27])
def test_a_slip_near_either_end_is_found_from_nothing(step):
    """As likely as from the truth, in 30 poses: the longer part makes the map."""
    sound = simulation.simulate(scenario.Scenario(), 0.2, rng=np.random.default_rng(102))
    odometry = sound.odometry.copy()
    odometry[step] += [3.0, -2.0, 0.4]
    log = replace(sound, odometry=odometry).log(C.x0_sigmas)
    longest = log.ranges.max()
    start = rivals._put_together(log, step, fit, longest)
    wide = log.odometry_covariances.copy()
    wide[step] = np.diag([longest**2, longest**2, 1.0])
    found = fit(log.with_covariances(wide), start, 1.0)
    best = fit(log.with_covariances(wide), (sound.poses, sound.landmarks), 1.0)
    costs = [rivals.cost_of(log.with_covariances(wide), one) for one in (found, best)]
    assert costs[0] < costs[1] + 1
