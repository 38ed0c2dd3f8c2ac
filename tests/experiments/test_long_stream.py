import numpy as np
import pytest

from sngr_utils.experiments import every_world, long_stream, sensitivity
from sngr_utils.online import data_association, landmarks


def test_a_long_drive_has_one_range_a_pose_and_no_end_of_rounds():
    world = long_stream.drive(100, 0.0, 100)
    assert np.array_equal(world.pose_of, np.arange(100))
    assert np.bincount(world.source_of).min() >= 16
    assert np.array_equal(world.poses[:30], world.poses[30:60])
    assert world.label_of == pytest.approx(world.source_of)


def test_a_stream_says_what_its_steps_cost_part_by_part(monkeypatch):
    monkeypatch.setattr(long_stream, "SETTLING", 12)
    found = long_stream.rows(40, 0.0, 100)
    assert [row["part"] for row in found] == list(range(long_stream.PARTS))
    assert all(0 < row["part_median_ms"] <= row["most_ms"] for row in found)
    assert found[0]["filtered_rmse"] < 1.0


def test_a_constant_is_changed_wherever_it_is_used_and_put_back(monkeypatch):
    before = data_association.VAGUE
    seen = []

    def rows(*cell):
        seen.append((data_association.VAGUE, landmarks.VAGUE))
        return [{"kind": "circle", "p": 0.3, "seed": 1, "final": 1.0, "filtered": 1.0,
                 "doubtful": 0}]  # fmt: skip

    monkeypatch.setattr(every_world, "rows", rows)
    (row,) = sensitivity.rows("data_association", "VAGUE", 2.0, "circle", 0.3, 1)
    assert seen == [(2 * before, 2 * before)]
    assert data_association.VAGUE == landmarks.VAGUE == before
    assert row["constant"] == "data_association.VAGUE"
    assert len(sensitivity.cells(range(2))) == 6 * (1 + 2 * len(sensitivity.constants()))
