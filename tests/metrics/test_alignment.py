"""Rigid alignment: what it takes out, and what it leaves."""

import numpy as np

from sngr_utils.metrics.alignment import aligned_errors, incremental_rmse, rigid


def turned(points, angle, shift):
    rotation = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return points @ rotation.T + shift


def test_a_turn_and_a_shift_are_no_error():
    truth = np.random.default_rng(100).normal(size=(20, 2))
    moved = turned(truth, 2.0, [3.0, -1.0])
    np.testing.assert_allclose(aligned_errors(moved, truth), 0, atol=1e-12)


def test_a_scale_and_a_mirror_image_are_errors():
    truth = np.random.default_rng(100).normal(size=(20, 2))
    assert np.abs(aligned_errors(1.1 * truth, truth)).max() > 0.05
    assert np.abs(aligned_errors(truth * [1, -1], truth)).max() > 0.5
    assert np.linalg.det(rigid(truth * [1, -1], truth)[0]) > 0


def test_no_other_rigid_motion_is_nearer():
    rng = np.random.default_rng(100)
    truth = rng.normal(size=(20, 2))
    estimate = turned(truth, 0.5, [1.0, 2.0]) + 0.1 * rng.normal(size=(20, 2))
    best = np.sum(aligned_errors(estimate, truth) ** 2)
    rotation, shift = rigid(estimate, truth)
    aligned = estimate @ rotation.T + shift
    for angle, dx, dy in 0.01 * rng.normal(size=(50, 3)):
        assert np.sum((turned(aligned, angle, [dx, dy]) - truth) ** 2) >= best


def test_an_incremental_error_is_the_change_over_a_distance():
    """A straight way whose estimate is a hundredth too long, judged over ten metres."""
    truth = np.column_stack([np.arange(0.0, 51.0), np.zeros(51)])
    assert abs(incremental_rmse(1.01 * truth, truth, 10.0) - 0.1) < 1e-12
    assert incremental_rmse(turned(truth, 1.0, [2.0, 3.0]), truth, 10.0) < 1e-12
    assert np.isnan(incremental_rmse(truth, truth, 60.0))
