"""Checks of arrays that come from outside: what they refuse, they name by field and row.

The bounds are wide, and there so that squares are numbers too.
"""

import reprlib

import numpy as np

LARGEST, SMALLEST = 1e20, 1e-20  # a number, and a sigma
SINGULAR = 1e-14  # the least eigenvalue of correlations that can be inverted
SYMMETRIC = 1e-9  # of correlations, a difference of mirror images that is rounding


def count(name: str, value) -> int:
    """Number of rows."""
    if np.ndim(numbers(name, value)) == 0:
        raise ValueError(f"{name} is {shown(value)}: it must have a row each")
    return len(value)


def numbers(name: str, value) -> np.ndarray:
    """An array of floats, made from real numbers: a truth value, a text or a time is none."""
    try:
        array = np.asarray(value)
        if array.dtype.kind not in "iuf" and not isinstance(value, np.ndarray):
            array = np.asarray(value, dtype=object)
    except ValueError:
        raise ValueError(f"{name} must hold numbers, as many in each row") from None
    bad = np.ma.getmaskarray(value) if np.ma.is_masked(value) else None
    if array.dtype.kind == "O" and array.size:
        bad = np.vectorize(_no_number, otypes=[bool])(array)
    elif array.dtype.kind not in "iufO":
        bad = np.ones(array.shape, bool)
    if bad is not None and bad.any():
        first = tuple(np.argwhere(bad)[0])
        entry = "masked" if np.ma.is_masked(value) else shown(array[first])
        row = f"[{first[0]}]" if first else ""
        raise ValueError(f"{name}{row} is {entry}: it must be a real number")
    return array.astype(float, order="C") if array.size else np.empty(array.shape)


def _no_number(entry) -> bool:
    if isinstance(entry, bool) or not isinstance(entry, int | float | np.integer | np.floating):
        return True
    return isinstance(entry, int) and abs(entry) > LARGEST


def floats(name: str, value, shape: tuple[int, ...], one_of_all: bool = False) -> np.ndarray:
    """A copy as floats of this shape; without the first axis, if that may be, repeated along it."""
    array = numbers(name, value)
    if array.size == 0 and 0 in shape:
        return np.empty(shape)
    if array.shape != shape and not (one_of_all and array.shape == shape[1:]):
        either = f", or {shape[1:]} for all" if one_of_all else ""
        raise ValueError(f"{name} has shape {array.shape}: it must be {shape}{either}")
    return array if array.shape == shape else np.array(np.broadcast_to(array, shape))


def finite(
    name: str, value, shape: tuple[int, ...], one_of_all: bool = False, most: float = LARGEST
) -> np.ndarray:
    """The same, all of them finite."""
    array = floats(name, value, shape, one_of_all)
    fine = np.abs(array) <= most
    if not fine.all():  # hardly ever, and asked a hundred thousand times in a chapter
        bad = ~fine.all(axis=tuple(range(1, array.ndim)))
        refuse(name, array, bad, f"it must be finite, and within {most:g}")
    return array


def positive(name: str, value, shape: tuple[int, ...], one_of_all: bool = False) -> np.ndarray:
    """The same, all of them positive."""
    array = finite(name, value, shape, one_of_all)
    refuse(name, array, array < SMALLEST, f"it must be positive, from {SMALLEST:g} on")
    return array


def indices(name: str, value, n: int, least: int, most: int) -> np.ndarray:
    """A copy as n integers within bounds."""
    index = finite(name, value, (n,))
    refuse(name, index, index % 1 != 0, "it must be an integer")
    refuse(name, index, (index < least) | (index > most), f"it must be from {least} to {most}")
    return index.astype(np.int64)


def proper(matrices: np.ndarray) -> np.ndarray:
    """(N,) bool, whether (N, D, D) finite matrices are covariances that can be inverted.

    Of the correlations, for a matrix of metres and radians has eigenvalues of both.
    """
    variances = np.diagonal(matrices, axis1=1, axis2=2)
    fine = ((variances >= SMALLEST**2) & (variances <= LARGEST**2)).all(axis=1)
    sigmas = np.sqrt(np.where(fine[:, None], variances, 1.0))
    correlations = matrices / (sigmas[:, :, None] * sigmas[:, None, :])
    skew = np.abs(correlations - correlations.swapaxes(1, 2)).max(axis=(1, 2))
    return fine & (skew <= SYMMETRIC) & (np.linalg.eigvalsh(correlations)[:, 0] > SINGULAR)


def refuse(name: str, array: np.ndarray, bad: np.ndarray, why: str) -> None:
    """Raise a ValueError that names the first of the bad rows, if there is one."""
    if np.any(bad):
        row = int(np.argmax(bad))
        entry = " ".join(np.array2string(array[row], threshold=9).split())
        raise ValueError(f"{name}[{row}] is {entry}: {why}")


def shown(value) -> str:
    """A value in a few characters of one line."""
    try:
        return " ".join(reprlib.repr(value).split())
    except ValueError:  # Python writes no integer of thousands of digits
        return "an integer of too many digits"
