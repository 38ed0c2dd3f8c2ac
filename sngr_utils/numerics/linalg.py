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
    """(N, K) squared norms of lower-triangular inverses times offsets from the places."""
    (n, d), out = points.shape, np.zeros((len(points), len(places)))
    offset = np.empty(d)
    for k in range(n):
        for c in range(len(places)):
            for i in range(d):
                offset[i] = points[k, i] - places[c, i]
                total = 0.0
                for j in range(i + 1):
                    total += inverses[c, i, j] * offset[j]
                out[k, c] += total * total
    return out
