"""The failure label of a window."""

import numpy as np

from sngr_utils.sngr import windows

FAILURE_ERROR = 0.5  # m, mean position error above which a window has failed


def failures(position_errors: np.ndarray) -> np.ndarray:
    """(T-W+1,) bool: mean position error over the window's poses above 0.5 m.

    Parameters
    ----------
    position_errors : (T,) distance of each estimated pose to the truth, [m]
    """
    return windows.means(position_errors) > FAILURE_ERROR
