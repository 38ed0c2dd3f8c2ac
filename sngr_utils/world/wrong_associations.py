"""Wrong associations: ranges that keep their value and lose their landmark."""

import numpy as np


def wrong_associations(
    true_labels: np.ndarray, n_landmarks: int, p: float, *, rng: np.random.Generator
) -> np.ndarray:
    """Attach each measurement, with probability p, to a uniformly drawn *other* landmark.

    The draws do not depend on p, so the wrong set at a smaller p is a subset of the wrong set
    at a larger one (common random numbers along a sweep).

    Parameters
    ----------
    true_labels : (M,) int, landmark each measurement came from
    n_landmarks : number of landmarks; a single one has no other
    p : probability of a wrong association

    Returns
    -------
    (M,) int labels

    Raises
    ------
    ValueError : a single landmark, and p above 0
    """
    if n_landmarks < 2:
        if p > 0:
            raise ValueError(f"p is {p!r}: with {n_landmarks} landmark there is no wrong one")
        return true_labels
    uniform = rng.random(len(true_labels))
    shift = rng.integers(1, n_landmarks, size=len(true_labels))
    return np.where(uniform < p, (true_labels + shift) % n_landmarks, true_labels)
