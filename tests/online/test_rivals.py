from dataclasses import replace

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


def test_a_landmark_too_many_is_dispensable_and_none_that_is_there(drawn, best):
    """The seventh lies where some ranges meet, of which one in twelve says that it is its own."""
    log = drawn.log(C.x0_sigmas)
    label = np.where(np.arange(len(log.ranges)) % 12 == 0, 6, log.label_of)
    more = replace(
        log, n_landmarks=7, label_of=label, label_probabilities=None,
        landmark_means=np.full((7, 2), np.nan), landmark_sigmas=np.full(7, np.nan),
    )  # fmt: skip
    for place in ([3.0, 2.0], best.landmarks[2] + 0.3):
        found = fit(more, (best.poses, np.vstack([best.landmarks, place])), 1.0)
        known = np.linalg.norm(found.landmarks[:6] - best.landmarks, axis=1) < 0.1
        dispensable = rivals.dispensable(more, found)
        assert known.sum() >= 5
        assert dispensable.tolist() == [*~known, True]
    surveyed = more._with(landmark_sigmas=np.full(7, 0.1), landmark_means=found.landmarks)
    assert not rivals.dispensable(surveyed, found).any()


def test_a_slip_that_was_none_is_trusted_again_and_one_of_its_neighbour_is_moved(drawn):
    odometry = drawn.odometry.copy()
    odometry[14] += [1.2, -1.6, 0.3]
    for moved, true in ((drawn.odometry, []), (odometry, [14])):
        log = replace(drawn, odometry=moved).log(C.x0_sigmas)
        told, wide = log.odometry_covariances, rivals.distrusting(log, 15)
        ours = rivals.rival(wide, told, fit(wide, (drawn.poses, drawn.landmarks), 1.0))
        best, made = rivals.reconsidered(ours, told, fit)
        assert rivals._slipped(best.log, told) == true
        assert best.cost < min(one.cost for one in made) + rivals.BETTER < ours.cost + rivals.BETTER


def test_a_map_that_grew_is_found_and_a_long_log_is_not_asked(drawn, best):
    log = drawn.log(C.x0_sigmas)
    labelled, bare = rivals.grown(log, log.odometry_covariances, fit)
    assert same(labelled.found, best)
    assert same(bare.found, best)
    long = simulation.simulate(
        scenario.Scenario(n_poses=121), 0.0, rng=np.random.default_rng(0)
    ).log(C.x0_sigmas)
    assert rivals.grown(long, long.odometry_covariances, fit) == []


@pytest.mark.parametrize("step", [0, 1, 14, 27])
def test_a_slip_at_any_step_is_found_from_nothing(step):
    """As likely as from the truth, in 30 poses: the longer part makes the map."""
    sound = simulation.simulate(scenario.Scenario(), 0.2, rng=np.random.default_rng(102))
    odometry = sound.odometry.copy()
    odometry[step] += [3.0, -2.0, 0.4]
    log = replace(sound, odometry=odometry).log(C.x0_sigmas)
    wide, longest = log.odometry_covariances.copy(), log.ranges.max()
    wide[step] = np.diag([longest**2, longest**2, np.pi**2 / 4])
    slipped = log.with_covariances(wide)
    truth = fit(slipped, (sound.poses, sound.landmarks), 1.0)
    least = rivals.rival(slipped, log.odometry_covariances, truth).cost
    assert least > rivals.cost_of(slipped, truth) + 3 * np.log(longest / 0.1)
    assert min(one.cost for one in rivals.with_a_slip(log, fit, True)) < least + 0.1


@pytest.mark.parametrize("n", [0, 1, 2, 3, 7, 29, 118])
def test_every_step_is_in_one_group_of_neighbours(n):
    groups = rivals._neighbours(n)
    assert np.concatenate([[], *groups]).tolist() == list(range(n))
    assert max(map(len, groups), default=0) <= rivals.STRIDE
