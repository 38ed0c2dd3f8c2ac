"""What happened in truth, as far as it is known: for who judges, not for who estimates."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The truth of a `Log` with T poses, K landmarks and M ranges, in the same order.

    Attributes
    ----------
    poses : (T, 3), [m, m, rad]; None where nobody knows, and then the landmarks have a frame of
        their own
    landmarks : (K, 2), [m]; NaN for one that nobody knows
    source_of : (M,) int, landmark each range truly came from, -1 for none; None if not known
    """

    poses: np.ndarray | None
    landmarks: np.ndarray
    source_of: np.ndarray | None
