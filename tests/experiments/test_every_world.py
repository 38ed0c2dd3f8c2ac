"""Worlds of every kind, the oracle, and one row of the study."""

import numpy as np
import pytest

from sngr_utils.experiments import every_world, kinds_of_worlds
from sngr_utils.slam import conventions

C = conventions.PRESETS["C"]


def test_every_row_has_a_kind_and_every_kind_can_be_drawn():
    assert {kind for kind, _, _ in kinds_of_worlds.ROWS} <= set(kinds_of_worlds.CHANGES)
    assert len(kinds_of_worlds.cells(range(2))) == 2 * sum(
        len(row[2]) for row in kinds_of_worlds.ROWS
    )
    for kind in kinds_of_worlds.CHANGES:
        world, sound = kinds_of_worlds.draw(kind, 0.3, 100)
        assert world.n_poses == sound.n_poses
        assert (np.diff(world.pose_of) >= 0).all()
    with pytest.raises(ValueError, match="kind is"):
        kinds_of_worlds.draw("moon", 0.0, 100)


def test_the_oracle_is_told_what_is_clutter_and_which_step_slipped():
    """Five metres of slip, or a fifth of clutter, cost it little."""
    for kind, most in (("slip 5 m", 2.0), ("clutter added 20 %", 1.05)):
        world, sound = kinds_of_worlds.draw(kind, 0.3, 104)
        best, newest = every_world.oracle(world, sound, C, from_grid=False)
        clean, _ = every_world.oracle(sound, sound, C, from_grid=False)
        truth = world.poses[:, :2]
        error, least = (np.linalg.norm(e.poses[:, :2] - truth) for e in (best, clean))
        assert error < most * least
        assert newest.shape == truth.shape


def test_a_row_holds_numbers_of_a_sound_world():
    (row,) = every_world.rows("clutter added 5 %", "C", 0.0, 101)
    assert row["final"] < 1.1
    assert row["known"] == 1
    assert row["astray"] == 0
    assert 0.3 < row["landmark_nees"] < 6  # of six landmarks, two numbers each: 2 expected
    assert row["doubtful"] == 0
    assert row["em_exclusive"] == pytest.approx(row["final"], abs=0.05)
    assert row["cauchy"] > 1
    assert row["at_truth"] == pytest.approx(row["final"], abs=0.01)
    assert row["behind"] == pytest.approx(0.0, abs=0.1)
    assert row["at_mode"] == pytest.approx(row["final"], abs=0.01)
    assert row["filtered_likelier"] == pytest.approx(row["filtered"], abs=0.05)
    assert np.isnan(row["filtered_right"])


def test_of_a_slip_a_row_says_what_the_newest_poses_are_with_every_label_right():
    (row,) = every_world.rows("slip 1 m", "C", 0.3, 102)
    assert 0.9 < row["filtered_right"] < row["filtered"] + 0.05
