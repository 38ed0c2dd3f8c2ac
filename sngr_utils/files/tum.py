"""Trajectories in TUM's format: a line `time x y z qx qy qz qw` for each pose."""

from pathlib import Path

import numpy as np

from sngr_utils import whole_file


def write(path: Path, times: np.ndarray, poses: np.ndarray) -> None:
    """Write a trajectory of the plane; z and the first two of the quaternion are 0.

    Parameters
    ----------
    times : (T,), [s]
    poses : (T, 3), [m, m, rad]
    """
    zero = np.zeros(len(poses))
    half = poses[:, 2] / 2
    table = np.column_stack(
        [times, poses[:, :2], zero, zero, zero, np.sin(half), np.cos(half)]
    )  # fmt: skip
    lines = (" ".join(repr(float(v)) for v in row) + "\n" for row in table)
    whole_file.write_text(path, "".join(lines))
