"""What landmarks are called, by labels of which some are wrong."""

from dataclasses import replace

import numpy as np
import pytest

from sngr_utils.robust import em, naming
from sngr_utils.robust.association import Shares
from sngr_utils.world import scenario, simulation
from sngr_utils.world.log import NO_LABEL


def labelled(counts):
    """A log of 3 landmarks whose ranges come in cells of (place, label), half of them wrong."""
    places = np.repeat(np.arange(9) // 3, np.ravel(counts))
    scene = scenario.Scenario(n_poses=40, n_landmarks=3)
    log = simulation.simulate(scene, 0.0, rng=np.random.default_rng(0)).log([0.01, 0.01, 0.001])
    log = log.keep(np.arange(len(log.ranges)) < len(places))
    log = log._with(label_of=np.repeat(np.arange(9) % 3, np.ravel(counts)))
    return log, em.SoftEstimate(None, None, None, np.eye(4)[places], Shares(0.5, 0.0), None)


def test_a_map_named_otherwise_gets_its_names_from_the_labels():
    log, soft = labelled([[5, 1, 0], [1, 5, 0], [0, 0, 9]])
    soft = replace(soft, landmarks=np.eye(3)[:, :2])
    mixed = replace(
        soft, landmarks=soft.landmarks[[2, 0, 1]], weights=soft.weights[:, [2, 0, 1, 3]]
    )
    np.testing.assert_array_equal(naming.named(log, mixed), soft.landmarks)


@pytest.mark.parametrize(("crossed", "are_open"), [(5, True), (4, False)])
def test_names_that_could_be_exchanged_are_open(crossed, are_open):
    """A label that agrees is twice as likely: 6 of them are less than 99 to 1, and 8 are more."""
    log, soft = labelled([[8, crossed, 0], [crossed, 8, 0], [0, 0, 12]])
    assert (2.0 ** (16 - 2 * crossed) < 99) == are_open
    assert naming.names_open(log, soft).tolist() == [are_open, are_open, False]


def test_three_names_that_go_round_are_open_though_no_two_can_be_exchanged():
    counts = [[8, 7, 0], [0, 8, 7], [7, 0, 8]]
    log, soft = labelled(counts)
    assert naming.names_open(log, soft).all()
    log, soft = labelled([[8, 5, 0], [0, 8, 5], [5, 0, 8]])
    assert not naming.names_open(log, soft).any()


def test_where_nothing_has_a_label_or_all_is_surveyed_no_name_is_open():
    log, soft = labelled(np.full((3, 3), 4))
    assert naming.names_open(log, soft).all()
    bare = log._with(label_of=np.full(len(log.ranges), NO_LABEL))
    assert not naming.names_open(bare, soft).any()
    known = log._with(landmark_sigmas=np.full(3, 0.1))
    assert not naming.names_open(known, soft).any()


def test_a_surveyed_landmark_keeps_its_name_and_the_others_may_exchange_theirs():
    log, soft = labelled([[2, 4, 4], [4, 1, 6], [4, 6, 1]])
    known = log._with(landmark_sigmas=np.array([0.1, np.nan, np.nan]))
    soft = replace(soft, landmarks=np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]))
    assert np.array_equal(naming.named(known, soft), soft.landmarks[[0, 2, 1]])
    log, soft = labelled(np.full((3, 3), 4))
    known = log._with(landmark_sigmas=np.array([0.1, np.nan, np.nan]))
    assert naming.names_open(known, soft).tolist() == [False, True, True]


@pytest.mark.parametrize(("wrong", "since"), [(0.2, 60), (0.4, 40)])
def test_names_that_are_exchanged_in_the_middle_are_in_doubt(wrong, since):
    """From a pose on, labels of the first two are the other's; those of the third one stay.

    Names that are right are doubted in a log with a chance below 1/99: four of 20 are below 1e-4.
    """
    sound, turned = [], []
    scene = scenario.Scenario(n_poses=80, n_landmarks=3)
    log = simulation.simulate(scene, 0.0, rng=np.random.default_rng(0)).log([0.01, 0.01, 0.001])
    for seed in range(20):
        rng, sources = np.random.default_rng(seed), np.arange(240) % 3
        label = np.where(rng.random(240) < wrong, (sources + rng.integers(1, 3, 240)) % 3, sources)
        drawn = log._with(label_of=label)
        soft = em.SoftEstimate(None, None, None, np.eye(4)[sources], Shares(wrong, 0.0), None)
        sound.append(naming.exchanged(drawn, soft).any())
        late = (drawn.pose_of >= since) & (label < 2)
        late_ones = drawn._with(label_of=np.where(late, 1 - label, label))
        turned.append(naming.exchanged(late_ones, soft).tolist())
    assert sum(sound) < 4
    assert turned.count([True, True, False]) > 15
