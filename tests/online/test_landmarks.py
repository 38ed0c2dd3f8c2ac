"""Which ranges speak for a landmark not yet initialised, when it starts, when it is removed."""

from collections import Counter
from types import SimpleNamespace

import numpy as np
import pytest
from helpers import SIGMA, scans
from scipy import stats

from sngr_utils.online import landmarks as landmarks_module
from sngr_utils.online import localisation
from sngr_utils.online.data_association import DROPPED, Assignment
from sngr_utils.online.landmarks import (
    _locate,
    drop_landmarks,
    start_landmarks,
    turn_over,
    witnesses,
)
from sngr_utils.robust.association import Shares
from sngr_utils.sampling import importance
from sngr_utils.sampling.targets import place
from sngr_utils.slam import landmark_starts


class Believed(SimpleNamespace):
    """What `landmarks` reads of a belief and asks of it."""

    @property
    def present(self):
        return np.isfinite(self.landmarks[:, 0])

    @property
    def longest(self):
        return self.log.ranges.max()

    def covariance(self, anchored):
        assert anchored
        return SimpleNamespace(poses=self.covariances)

    def assign_fitting(self, mine, landmarks, mode, evidence):
        self.fitted = (mine, landmarks, mode, evidence)
        return "assignments"

    def insert(self, k, position, used):
        self.inserted = (k, position, used)

    def remove(self, k):
        self.removed.append(k)


@pytest.fixture
def waiting():
    """Six poses with a range of each of three landmarks; landmarks 0 and 2 are not in the map."""
    data = scans(np.tile([0, 1, 2], 6), pose_of=np.repeat(np.arange(6), 3),
                 ranges=3.0 + 0.1 * np.arange(18))  # fmt: skip
    weights = np.tile([[0.0, 0.1, 0.0, 0.9], [0.0, 1.0, 0.0, 0.0], [0.0, 0.2, 0.0, 0.8]], (6, 1))
    covariances = np.zeros((6, 3, 3))
    covariances[:, 0, 0], covariances[:, 1, 1] = 0.02 * np.arange(6), 0.04
    return Believed(
        log=data, shares=Shares(0.3, 0.0), in_doubt=np.zeros(3, dtype=bool),
        poses=np.column_stack([np.arange(6.0), np.ones(6), np.zeros(6)]),
        landmarks=np.array([[np.nan, np.nan], [5.0, 5.0], [np.nan, np.nan]]),
        assignment=Assignment(np.where(data.label_of == 1, 1, DROPPED), weights),
        covariances=covariances, counts=Counter(), removed=[],
    )  # fmt: skip


def test_witnesses_are_the_free_ranges_that_the_label_leaves_a_fair_chance(waiting):
    """Of the weight on "not in the map", the prior 0.7 to 0.15 gives landmark 0 most of its own
    label's ranges and 0.8 * 0.15 / 0.85 = 0.14, less than a fifth, of those of landmark 2."""
    mine, evidence = witnesses(waiting, 0)
    assert mine.tolist() == [0, 3, 6, 9, 12, 15]
    assert evidence.wrong == pytest.approx(1 - 0.9 * 0.7 / 0.85)
    assert evidence.anchors.tolist() == waiting.poses[:, :2].tolist()
    assert evidence.ranges == pytest.approx(3.0 + 0.3 * np.arange(6))
    assert evidence.variances == pytest.approx(0.01 * np.arange(6) + 0.02 + SIGMA**2)
    assert evidence.longest == pytest.approx(4.7)
    assert evidence.centre == pytest.approx([2.5, 1.0])
    assert evidence.sigma == pytest.approx(4.5)


@pytest.mark.parametrize(("elsewhere", "heard"), [(0.70, True), (0.69, False)])
def test_a_range_of_another_label_is_a_witness_from_a_fifth_on(waiting, elsewhere, heard):
    """At p = 0.4 the two that wait share it as 0.2 to 0.6, and 0.8 of that is a fifth."""
    waiting.shares = Shares(0.4, 0.0)
    waiting.assignment.weights[2, -1] = 1.15 * elsewhere
    mine, _ = witnesses(waiting, 0)
    assert (2 in mine) == heard


def test_ranges_assigned_to_a_landmark_are_no_witnesses(waiting):
    waiting.assignment.used[3] = 1
    mine, _ = witnesses(waiting, 0)
    assert mine.tolist() == [0, 6, 9, 12, 15]


@pytest.mark.parametrize(("poses", "enough"), [(3, False), (4, True)])
def test_witnesses_of_four_poses_are_needed(waiting, poses, enough):
    waiting.assignment.used[3 * poses :] = 1
    mine, evidence = witnesses(waiting, 0)
    assert len(mine) == poses
    assert (evidence is not None) == enough
    assert witnesses(waiting, 0, least=3)[1] is not None


# --- starting -------------------------------------------------------------------------------


def test_a_landmark_starts_where_it_is_located_with_the_ranges_that_fit(waiting, monkeypatch):
    mode, asked = localisation.Mode(np.array([1.0, 2.0]), np.eye(2), 0.95), []

    def locate(belief, evidence, by_nested, rng):
        asked.append(by_nested)
        return mode if len(asked) == 1 else None

    monkeypatch.setattr(landmarks_module, "_locate", locate)
    rng = np.random.default_rng(0)
    start_landmarks(waiting, True, True, rng=rng)
    assert asked == [True, True]  # landmarks 0 and 2; 1 is in the map
    assert waiting.inserted[0] == 0
    assert waiting.inserted[1] is mode.mean
    assert waiting.inserted[2] == "assignments"
    mine, landmarks, given, evidence = waiting.fitted
    assert mine.tolist() == [0, 3, 6, 9, 12, 15]
    assert landmarks.tolist() == [0] * 6
    assert given is mode
    assert evidence.sigma == pytest.approx(4.5)


def test_no_question_without_something_new_to_see(waiting, monkeypatch):
    """The newest pose has no witness of landmark 0, and one of landmark 2."""
    waiting.assignment.used[15] = 1
    seen = []
    monkeypatch.setattr(
        landmarks_module, "_locate", lambda belief, evidence, *_: seen.append(evidence.ranges[0])
    )
    start_landmarks(waiting, True, True, rng=np.random.default_rng(0))
    assert seen == [pytest.approx(3.2)]


def test_without_delay_three_poses_do(waiting):
    """As iSAM2 starts it, from the first range of each of three poses."""
    waiting.landmarks[2] = 0.0
    waiting.poses = np.array([[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [4.0, 1.5, 0.0]])
    spot = np.array([1.0, 4.0])
    ranges = np.linalg.norm(waiting.poses[:, :2] - spot, axis=1)[[0, 1, 1, 2]]
    waiting.log = scans([0, 0, 0, 0], pose_of=[0, 1, 1, 2], ranges=ranges - [0, 0, 1, 0])
    waiting.assignment = Assignment(np.full(4, DROPPED), np.tile([0.0, 0, 0, 1], (4, 1)))
    start_landmarks(waiting, False, True, rng=np.random.default_rng(0))
    assert not hasattr(waiting, "inserted")
    start_landmarks(waiting, False, False, rng=np.random.default_rng(0))
    k, position, _ = waiting.inserted
    assert k == 0
    mode = waiting.fitted[2]
    assert mode.covariance.tolist() == [[1, 0], [0, 1]]  # vague, and all there is
    assert mode.mass == 1
    assert position == pytest.approx(spot, abs=1e-6)


def test_least_squares_that_end_nowhere_start_nothing(waiting, monkeypatch):
    monkeypatch.setattr(landmark_starts, "start_landmark", lambda *_: np.array([np.inf, 0.0]))
    start_landmarks(waiting, False, False, rng=np.random.default_rng(0))
    assert not hasattr(waiting, "inserted")


def arc(n, angle, spot, noise=0.0):
    """Evidence of a place from a quarter circle or less."""
    turn = np.linspace(0, angle, n)
    anchors = 5 * np.column_stack([np.cos(turn), np.sin(turn)])
    ranges = np.linalg.norm(anchors - spot, axis=1) + noise
    return place.Evidence(
        anchors, ranges, np.full(n, SIGMA**2), np.full(n, 0.1), 10.0, anchors.mean(axis=0), 8.0
    )


def test_a_mirror_image_makes_it_wait_without_a_question(waiting):
    waiting.counts["mirror waits"] = 7
    found = _locate(waiting, arc(5, 0.1, [1.0, 2.0]), True, np.random.default_rng(0))
    assert found is None
    assert waiting.counts == {"mirror waits": 8}


def test_one_place_is_found_by_many_starts(waiting):
    waiting.counts["landmark questions"] = 3
    found = _locate(waiting, arc(12, 3.0, [1.0, 2.0]), True, np.random.default_rng(0))
    assert found.mean == pytest.approx([1.0, 2.0], abs=0.05)
    assert found.mass > 0.99
    assert waiting.counts == {"landmark questions": 4}


@pytest.mark.parametrize(("mass", "kept"), [(0.89, False), (0.91, True)])
@pytest.mark.parametrize("sound", [False, True])
def test_nine_tenths_of_the_posterior_in_one_mode_are_a_place(
    waiting, monkeypatch, mass, kept, sound
):
    """What many starts say is a start already if their weights are sound; else the referee's is."""
    lone = localisation.Mode(np.zeros(2), np.eye(2), 0.95)
    mode = localisation.Mode(np.ones(2), np.eye(2), mass)
    monkeypatch.setattr(localisation, "mirrored", lambda evidence: False)
    monkeypatch.setattr(localisation, "many_starts", lambda evidence, rng: ("starts", sound))
    monkeypatch.setattr(localisation, "sample", lambda evidence, rng: "nested")
    answers = {"starts": mode if sound else lone, "nested": mode}
    monkeypatch.setattr(localisation, "modes", lambda cloud, evidence: [answers[cloud], lone])
    found = _locate(waiting, arc(5, 0.1, [1.0, 2.0]), True, np.random.default_rng(0))
    assert found is (mode if kept else None)
    assert waiting.counts["landmark samples"] == (not sound)


def test_the_referee_is_not_asked_about_a_landmark_that_would_wait_anyway(waiting, monkeypatch):
    vague = localisation.Mode(np.zeros(2), np.eye(2), 0.9)
    monkeypatch.setattr(localisation, "mirrored", lambda evidence: False)
    monkeypatch.setattr(localisation, "many_starts", lambda evidence, rng: ("starts", False))
    monkeypatch.setattr(localisation, "modes", lambda cloud, evidence: [vague])
    assert _locate(waiting, arc(5, 0.1, [1.0, 2.0]), True, np.random.default_rng(0)) is None
    assert waiting.counts == {"landmark questions": 1}


# --- taking out -----------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("labelled", "used", "out"),
    [(20, 8, False), (20, 7, True), (10, 3, True), (10, 4, False), (9, 0, False)],
)
def test_a_landmark_used_by_less_than_half_of_its_right_labels_is_taken_out(labelled, used, out):
    """At p = 0.2, 20 labels are right 16 times, and half of that is 8; below 10 none is judged."""
    assignment = np.where(np.arange(labelled) < used, 1, DROPPED)
    state = Believed(
        log=scans([1] * labelled), shares=Shares(0.2, 0.0), counts=Counter(), removed=[],
        landmarks=np.array([[np.nan, np.nan], [0.0, 0.0], [1.0, 1.0]]),
        assignment=Assignment(assignment, None),
    )  # fmt: skip
    drop_landmarks(state)
    assert state.removed == ([1] if out else [])
    assert state.counts["landmark restarts"] == out


def test_uses_by_ranges_of_other_labels_do_not_count():
    state = Believed(
        log=scans([1] * 10 + [0] * 10), shares=Shares(0.0, 0.0), counts=Counter(), removed=[],
        landmarks=np.zeros((3, 2)), assignment=Assignment(np.array([0] * 10 + [1] * 10), None),
    )  # fmt: skip
    drop_landmarks(state)
    assert state.removed == [0, 1]
    assert state.counts["landmark restarts"] == 2


@pytest.mark.parametrize(
    ("poses", "sigmas", "enters"),
    [(8, 4.9, True), (7, 4.9, False), (8, 5.0, False)],
)
def test_after_long_a_landmark_enters_on_one_of_two_narrow_sides(
    waiting, monkeypatch, poses, sigmas, enters
):
    """Narrow is less than five sigmas of the surest range."""

    def two(cloud, evidence):
        covariance = sigmas**2 * evidence.variances.min() * np.eye(2)
        return [localisation.Mode(np.zeros(2), covariance, mass) for mass in (0.5, 0.45)]

    monkeypatch.setattr(localisation, "mirrored", lambda evidence: True)
    monkeypatch.setattr(localisation, "many_starts", lambda evidence, rng: ("starts", True))
    monkeypatch.setattr(localisation, "modes", two)
    found = _locate(waiting, arc(poses, 0.1, [1.0, 2.0]), True, np.random.default_rng(0))
    assert found.mass == 0.5 if enters else found is None


def test_no_mode_is_no_place(waiting, monkeypatch):
    def none(evidence, rng):
        raise importance.NoModeError

    monkeypatch.setattr(localisation, "many_starts", none)
    assert _locate(waiting, arc(12, 3.0, [1.0, 2.0]), True, np.random.default_rng(0)) is None


# --- mirror images ------------------------------------------------------------------------------


@pytest.mark.parametrize(("beyond", "turned"), [(-1e-9, 1), (1e-9, 0)])
def test_dropped_ranges_vote_whether_a_landmark_turns_over(waiting, beyond, turned):
    """By the likelihood of each: normal of range and pose, or uniform for a share of 1 - .7 * .9.

    The graph's own verdict is set to outweigh the votes by next to nothing, on either side.
    """
    waiting.shares, waiting.in_doubt[1] = Shares(0.3, 0.1), True
    waiting.assignment.used[[1, 4]] = DROPPED
    image = np.array([waiting.landmarks[0], [-1.5, -1.5], waiting.landmarks[2]])
    votes = []
    for spot in (waiting.landmarks[1], image[1]):
        away = [np.hypot(x - spot[0], 1 - spot[1]) for x in (0, 1)]
        sigmas = [np.sqrt(0.02 + SIGMA**2), np.sqrt(0.03 + SIGMA**2)]
        right = stats.norm.pdf([3.1 - away[0], 3.4 - away[1]], scale=sigmas)
        votes.append(np.log(0.63 * right + 0.37 / 4.7).sum())
    assert votes[1] > votes[0] + 0.1
    waiting.mirrored = lambda k: (votes[1] - votes[0] + beyond, 2 * waiting.poses, image)
    turn_over(waiting)
    assert waiting.counts["landmarks turned over"] == turned
    assert (waiting.landmarks is image) == bool(turned)
    assert waiting.in_doubt[1]


@pytest.mark.parametrize(("gap", "doubted"), [(14.99, True), (15.01, False), (np.inf, False)])
def test_a_side_is_believed_when_the_other_is_worse_by_what_no_noise_makes(waiting, gap, doubted):
    waiting.in_doubt[1] = True
    waiting.mirrored = lambda k: (gap, waiting.poses, waiting.landmarks)
    turn_over(waiting)
    assert waiting.in_doubt[1] == doubted
