"""What the tests of findings read: the results of all notebooks that are committed."""

import numpy as np

from sngr_utils import paths
from sngr_utils.publish.results import results_in

RESULTS = results_in(paths.REFERENCE)


def value(key):
    return RESULTS[key]["value"]


def worlds(key):
    """(n,) one number per world."""
    return np.array(RESULTS[key]["sample"], dtype=float)


def entry(table, row, column, part=1):
    """A number of a recorded table; rows, columns and parts of a cell count from one."""
    key = f"tab_{table}.row{row}.column{column}"
    return value(key if part == 1 else f"{key}.{part}")
