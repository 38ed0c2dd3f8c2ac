"""The command `estimate`: what it prints and writes, and that it ends in one line."""

import numpy as np
import pytest

from sngr_utils import __main__ as command_line
from sngr_utils.files import pyfg
from sngr_utils.world.scenario import Scenario
from sngr_utils.world.simulation import simulate


@pytest.fixture
def log_file(tmp_path):
    world = simulate(Scenario(n_poses=30, n_landmarks=3), 0.2, rng=np.random.default_rng(100))
    path = tmp_path / "mine.pyfg"
    pyfg.write(path, world.log([0.01, 0.01, 0.001]), world.poses, world.landmarks)
    return path


def test_a_summary_a_trajectory_and_a_picture_and_nothing_is_overwritten(log_file, capsys):
    assert command_line.main(["estimate", str(log_file)]) == 0
    said = capsys.readouterr().out
    assert "30 poses, 90 ranges, 3 landmarks" in said
    assert "aligned RMSE against the truth 0." in said
    assert "nothing speaks against it" in said or "IT MAY BE WRONG" in said
    assert np.loadtxt(log_file.with_name("mine_estimate.tum")).shape == (30, 8)
    assert log_file.with_name("mine_estimate.png").read_bytes()[:4] == b"\x89PNG"
    assert command_line.main(["estimate", str(log_file)]) == 1
    assert "is there already" in capsys.readouterr().err


@pytest.mark.parametrize("content", [None, b"", b"\x00\xff" * 100, b"VERTEX_SE2 0 A0 nan 0 0\n"])
def test_a_hostile_file_ends_in_one_line(tmp_path, capsys, content):
    path = tmp_path / "mine.pyfg"
    if content is not None:
        path.write_bytes(content)
    assert command_line.main(["estimate", str(path)]) == 1
    said = capsys.readouterr().err
    assert said.startswith(f"error: {path}")
    assert said.count("\n") == 1
