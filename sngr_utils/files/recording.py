"""What a reader returns: the log, its truth where there is one, and what landmarks are called."""

import re
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sngr_utils.files.text import Line
from sngr_utils.world.log import Log
from sngr_utils.world.truth import Truth

# Without a prior on the first pose the frame is free: this holds it, and no more
FRAME_SIGMAS = (0.1, 1e-3)  # of the least range sigma, and [rad]


@dataclass(frozen=True)
class Recording:
    """A log from a file.

    Attributes
    ----------
    log : what an estimator may know
    truth : None if the file has none
    landmark_names : (K,) as in the file
    """

    log: Log
    truth: Truth | None
    landmark_names: list[str]


def frame_sigmas(range_sigmas: np.ndarray) -> list[float]:
    """(3,) of a first pose that is where the frame is, [m, m, rad]."""
    position = FRAME_SIGMAS[0] * (float(np.min(range_sigmas)) if len(range_sigmas) else 1.0)
    return [position, position, FRAME_SIGMAS[1]]


@contextmanager
def named(path: Path, lines: dict[str, list[Line]] | None = None):
    """What `Log` refuses is refused with the name of the file, and the line that gave a row.

    Parameters
    ----------
    lines : field of the log -> the line of each of its rows
    """
    try:
        yield
    except ValueError as error:
        row = re.match(r"(\w+)\[(\d+)\]", str(error))
        if row and row[1] in (lines or {}):
            raise lines[row[1]][int(row[2])].refuse(str(error)) from None
        raise ValueError(f"{path}: {error}") from None
