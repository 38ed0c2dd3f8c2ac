"""The failure label of a window."""

import numpy as np

from sngr_utils.sngr.windows import WIDTH

FAILURE_ERROR = 0.5  # m, mean position error above which a window has failed


def failures(position_errors: np.ndarray) -> np.ndarray:
    """(T-W+1,) bool: mean position error over the window's poses above 0.5 m.

    Parameters
    ----------
    position_errors : (T,) distance of each estimated pose to the truth, [m]
    """
    means = np.convolve(position_errors, np.full(WIDTH, 1 / WIDTH), mode="valid")
    return means > FAILURE_ERROR
