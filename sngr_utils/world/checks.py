"""Checks of arrays that come from outside: what they refuse, they name by field and row."""

import numpy as np


def count(name: str, value) -> int:
    """Number of rows."""
    if np.ndim(numbers(name, value)) == 0:
        raise ValueError(f"{name} is {value!r}: it must have a row each")
    return len(value)


def numbers(name: str, value) -> np.ndarray:
    """An array of floats."""
    try:
        return np.asarray(value, dtype=float)
    except (TypeError, ValueError) as error:
        raise ValueError(f"{name} must hold numbers: {error}") from None


def floats(name: str, value, shape: tuple[int, ...], one_of_all: bool = False) -> np.ndarray:
    """A copy as floats of this shape; without the first axis, if that may be, repeated along it."""
    array = numbers(name, value)
    if array.size == 0 and 0 in shape:
        return np.empty(shape)
    if array.shape != shape and not (one_of_all and array.shape == shape[1:]):
        either = f", or {shape[1:]} for all" if one_of_all else ""
        raise ValueError(f"{name} has shape {array.shape}: it must be {shape}{either}")
    return np.array(np.broadcast_to(array, shape))


def finite(name: str, value, shape: tuple[int, ...], one_of_all: bool = False) -> np.ndarray:
    """The same, all of them finite."""
    array = floats(name, value, shape, one_of_all)
    bad = ~np.isfinite(array).all(axis=tuple(range(1, array.ndim)))
    refuse(name, array, bad, "it must be finite")
    return array


def positive(name: str, value, shape: tuple[int, ...], one_of_all: bool = False) -> np.ndarray:
    """The same, all of them positive."""
    array = finite(name, value, shape, one_of_all)
    refuse(name, array, ~(array > 0), "it must be positive")
    return array


def indices(name: str, value, n: int, least: int, most: int | None) -> np.ndarray:
    """A copy as n integers within bounds."""
    index = finite(name, value, (n,))
    if np.shape(value) != (n,):
        raise ValueError(f"{name} has shape {np.shape(value)}: it must be {(n,)}")
    refuse(name, index, index % 1 != 0, "it must be an integer")
    bad = (index < least) | (index > (np.inf if most is None else most))
    refuse(name, index, bad, f"it must be from {least} to {most}")
    return index.astype(np.int64)


def refuse(name: str, array: np.ndarray, bad: np.ndarray, why: str) -> None:
    """Raise a ValueError that names the first of the bad rows, if there is one."""
    if np.any(bad):
        row = int(np.argmax(bad))
        raise ValueError(f"{name}[{row}] is {np.array2string(array[row])}: {why}")
