"""Thresholds with a controlled rate of false alarms, from scores of clean windows.

A score whose law on clean data is known needs none of this: its p-value is compared with alpha.
"""

import numpy as np


def conformal_threshold(clean: np.ndarray, alpha: float) -> float:
    """The threshold that a further clean score exceeds with probability at most alpha.

    The ceil((n + 1)(1 - alpha))-th smallest of n scores; infinite if n is too small for alpha.
    Holds for whatever law the scores have, if the new one is drawn as they were (exchangeable):
    from the same scenario, that is. It is a promise on average over calibrations.

    Raises
    ------
    ValueError : no scores, or alpha outside (0, 1)

    Source: Vovk, Gammerman, Shafer, Algorithmic Learning in a Random World, 2005; Papadopoulos
    et al., ECML 2002 (split conformal prediction).
    """
    clean = _checked(clean, alpha)
    rank = int(np.ceil((len(clean) + 1) * (1 - alpha) - 1e-9))  # a rounding error is no rank
    return float(np.sort(clean)[rank - 1]) if rank <= len(clean) else np.inf


def surprise(scores: np.ndarray, clean: np.ndarray) -> np.ndarray:
    """(N,) -log10 of the conformal p-values (1 + number of clean scores >= s) / (n + 1)."""
    clean = np.sort(_checked(clean, 0.5))
    above = len(clean) - np.searchsorted(clean, scores, side="left")
    return -np.log10((1 + above) / (len(clean) + 1))


def _checked(clean: np.ndarray, alpha: float) -> np.ndarray:
    clean = np.asarray(clean, dtype=float)
    if len(clean) == 0 or np.isnan(clean).any():
        raise ValueError("clean must hold scores, none of them NaN")
    if not 0 < alpha < 1:
        raise ValueError(f"alpha is {alpha!r}: a rate of false alarms lies in (0, 1)")
    return clean
