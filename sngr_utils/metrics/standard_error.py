"""Standard deviation and standard error of a few numbers."""

import math
from collections.abc import Sequence

import numpy as np


def standard_deviation(values: Sequence[float]) -> float:
    """Sample standard deviation; NaN for a single value."""
    return float(np.std(values, ddof=1)) if len(values) > 1 else math.nan


def standard_error(values: Sequence[float]) -> float:
    """Standard error of the mean; NaN for a single value."""
    return standard_deviation(values) / math.sqrt(len(values))
