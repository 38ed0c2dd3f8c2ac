"""The mirror test of a landmark, against closed forms."""

import numpy as np
import pytest
from scipy.optimize import least_squares

from sngr_utils.detection import mirror_image
from sngr_utils.detection.mirror_image import _refit, mirror_test, trajectory_line

SIGMA = 0.1
LINE = np.column_stack([np.linspace(0, 3, 4), np.zeros(4)])
CIRCLE = 5 * np.column_stack([np.cos(np.arange(8)), np.sin(np.arange(8))])


def seen(positions, landmark, errors=0.0):
    """Ranges to a landmark and their variances."""
    ranges = np.linalg.norm(positions - landmark, axis=1) + errors
    return ranges, np.full(len(positions), SIGMA**2)


def turned(points, angle):
    cos, sin = np.cos(angle), np.sin(angle)
    return points @ np.array([[cos, sin], [-sin, cos]]) + [1.0, -2.0]


@pytest.mark.parametrize("angle", [0.0, 0.7, np.pi / 2])
def test_a_straight_line_cannot_tell_its_sides_apart(angle):
    """By symmetry the gap is 0 whatever the noise, and the image is the reflection."""
    errors = np.random.default_rng(0).normal(size=4) * SIGMA
    positions, landmark = turned(LINE, angle), turned(np.array([[1.2, 2.0]]), angle)[0]
    found = mirror_test(positions, *seen(positions, landmark, errors), landmark)
    assert found.distinct
    assert found.gap == pytest.approx(0, abs=1e-8)
    centre, normal = trajectory_line(positions)
    across = (found.landmark - centre) @ normal
    np.testing.assert_allclose(found.image, found.landmark - 2 * across * normal, atol=1e-5)


def test_gap_is_the_difference_of_the_costs_of_two_refits():
    """A bent trajectory: both places by another optimiser."""
    positions = LINE + np.array([[0, 0], [0, 0.1], [0, 0.3], [0, 0.6]])
    landmark = np.array([1.0, 3.0])
    ranges, variances = seen(positions, landmark, [0.05, -0.1, 0.1, 0.0])
    found = mirror_test(positions, ranges, variances, landmark)
    costs = [
        least_squares(lambda at: (np.linalg.norm(at - positions, axis=1) - ranges) / SIGMA,
                      start, method="lm", xtol=1e-12).cost
        for start in (found.landmark, [1.5, -3.0])
    ]  # fmt: skip
    assert [found.cost, found.image_cost] == pytest.approx(costs, abs=1e-6)
    assert 1 < found.gap == pytest.approx(costs[1] - costs[0], abs=1e-6)


@pytest.mark.parametrize("landmark", [(1.0, 0.5), (-3.0, 2.0), (0.0, 3.9)])
def test_a_trajectory_all_around_leaves_no_second_place(landmark):
    found = mirror_test(CIRCLE, *seen(CIRCLE, landmark), landmark)
    assert found.gap > 100
    assert found.spread < SIGMA
    np.testing.assert_allclose(found.landmark, landmark, atol=1e-6)


def test_the_better_place_may_be_the_image():
    positions = LINE + np.array([[0, 0], [0, 0.3], [0, 0.3], [0, 0.8]])
    ranges, variances = seen(positions, (1.0, 3.0))
    first = mirror_test(positions, ranges, variances, (1.0, 3.0))
    again = mirror_test(positions, ranges, variances, first.image)
    assert again.gap == pytest.approx(-first.gap, abs=1e-6)
    assert first.gap > 1


def test_a_start_at_the_saddle_still_has_two_places():
    """Notebook 1: anchors 4 m apart, both 3 m away; the places are at +-sqrt(5)."""
    anchors = np.array([[0.0, 0.0], [4.0, 0.0]])
    found = mirror_test(anchors, [3.0, 3.0], [0.04, 0.04], [2.0, 0.0])
    assert found.gap == pytest.approx(0, abs=1e-10)
    heights = sorted([found.landmark[1], found.image[1]])
    assert heights == pytest.approx([-np.sqrt(5), np.sqrt(5)])


def test_one_range_is_a_ring_on_which_any_place_is_as_good():
    found = mirror_test([[1.0, 1.0]], [2.0], [0.01], [2.0, 2.0])
    assert found.gap == pytest.approx(0, abs=1e-10)
    assert found.spread == np.inf


@pytest.mark.parametrize(
    ("name", "change"),
    [
        ("positions", {"positions": LINE[:3]}),
        ("ranges", {"ranges": [np.nan] * 4}),
        ("ranges", {"ranges": []}),
        ("variances", {"variances": [0.0] * 4}),
        ("landmark", {"landmark": [1.0, 2.0, 3.0]}),
    ],
)
def test_bad_input_is_named(name, change):
    ranges, variances = seen(LINE, (1.0, 1.0))
    given = {"positions": LINE, "ranges": ranges, "variances": variances, "landmark": (1.0, 1.0)}
    with pytest.raises(ValueError, match=rf"^{name}(\[0\])? (has shape|is)"):
        mirror_test(**{**given, **change})


def test_gaps_of_growing_data_are_those_of_refits():
    """300 ranges, one in five wrong: where a refit is spared both are beyond doubt."""
    rng = np.random.default_rng(3)
    positions = np.column_stack([np.linspace(0, 30, 300), np.linspace(0, 2, 300) ** 2])
    for landmark in ([12.0, 6.0], [3.0, -2.0]):
        ranges, variances = seen(positions, np.array(landmark), rng.normal(size=300) * SIGMA)
        ranges[::5] = rng.uniform(0, 20, 60)
        counts = np.arange(2, 301)
        given = positions, ranges, variances, np.array(landmark)
        gaps = mirror_image.gaps(*given, counts)
        refits = [mirror_test(*(part[:n] for part in given[:3]), given[3]).gap for n in counts]
        weights, expected = (1 / (1 + np.exp(np.minimum(x, 700.0))) for x in (gaps, refits))
        np.testing.assert_allclose(weights, expected, atol=1e-15)


def test_refits_are_spared_where_ranges_are_many(monkeypatch):
    """On a circle nearly all of them: ten times the ranges, and not a hundred times the work."""
    done = []
    monkeypatch.setattr(mirror_image, "_refit", lambda *a: done.append(len(a[1])) or _refit(*a))
    monkeypatch.setattr(mirror_image, "reflect", mirror_image.reflect.py_func)
    work = {}
    for n in (100, 1000):
        angles = np.arange(n) * 0.3
        positions = 5 * np.column_stack([np.cos(angles), np.sin(angles)])
        errors = np.random.default_rng(0).normal(size=n) * SIGMA
        landmark = np.array([1.0, 2.0])
        done.clear()
        given = positions, *seen(positions, landmark, errors), landmark
        mirror_image.gaps.py_func(*given, np.arange(2, n + 1))
        work[n] = sum(done)
    assert work[1000] < 10 * work[100]
