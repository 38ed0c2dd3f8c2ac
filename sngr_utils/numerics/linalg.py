"""Compiled linear algebra of small dense matrices."""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once


@compile_once
def invert(matrix):
    """Invert a symmetric positive definite (n, n) matrix in place; reads its upper triangle.

    Returns the first row at which it is not positive definite, -1 if it is.
    """
    n = len(matrix)
    for i in range(n):
        for j in range(i):
            matrix[i, j] = matrix[j, i]
    failed = factorise(matrix)
    if failed >= 0:
        return failed
    for j in range(n):  # L^-1, in the same triangle
        matrix[j, j] = 1.0 / matrix[j, j]
        for i in range(j + 1, n):
            total = 0.0
            for k in range(j, i):
                total += matrix[i, k] * matrix[k, j]
            matrix[i, j] = -total / matrix[i, i]
    for j in range(n):
        for i in range(j, n):
            total = 0.0
            for k in range(i, n):
                total += matrix[k, i] * matrix[k, j]
            matrix[i, j] = matrix[j, i] = total
    return -1


@compile_once
def factorise(matrix):
    """Lower Cholesky factor of a symmetric matrix, in its lower triangle; returns as `invert`."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            if i > j:
                matrix[i, j] = total / matrix[j, j]
            elif total > 0.0:
                matrix[i, i] = math.sqrt(total)
            else:
                return i
    return -1


@compile_once
def solve_lower(lower, right):
    """L^-1 b, in place."""
    for i in range(len(right)):
        total = right[i]
        for k in range(i):
            total -= lower[i, k] * right[k]
        right[i] = total / lower[i, i]


@compile_once
def solve_upper(lower, right):
    """L^-T b, in place."""
    for i in range(len(right) - 1, -1, -1):
        total = right[i]
        for k in range(i + 1, len(right)):
            total -= lower[k, i] * right[k]
        right[i] = total / lower[i, i]


@compile_once
def distances(points, places, inverses):
    """(N, K) squared norms of lower-triangular inverses times offsets from the places.

    Four points side by side: in the sums of one alone every term waits for the one before it.
    """
    (n, d), out = points.shape, np.empty((len(points), len(places)))
    offsets = np.empty((d, 4))
    for c in range(len(places)):
        for k in range(0, n, 4):
            k1, k2, k3 = min(k + 1, n - 1), min(k + 2, n - 1), min(k + 3, n - 1)
            a0 = a1 = a2 = a3 = 0.0
            for i in range(d):
                place = places[c, i]
                offsets[i, 0], offsets[i, 1] = points[k, i] - place, points[k1, i] - place
                offsets[i, 2], offsets[i, 3] = points[k2, i] - place, points[k3, i] - place
                t0 = t1 = t2 = t3 = 0.0
                for j in range(i + 1):
                    factor = inverses[c, i, j]
                    t0, t1 = t0 + factor * offsets[j, 0], t1 + factor * offsets[j, 1]
                    t2, t3 = t2 + factor * offsets[j, 2], t3 + factor * offsets[j, 3]
                a0, a1, a2, a3 = a0 + t0 * t0, a1 + t1 * t1, a2 + t2 * t2, a3 + t3 * t3
            out[k3, c], out[k2, c], out[k1, c], out[k, c] = a3, a2, a1, a0
    return out
