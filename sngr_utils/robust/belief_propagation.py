"""Marginals of all matchings of a scan, near enough, where their sum is too much work."""

import math

import numpy as np

from sngr_utils.numerics.jit import compile_once

LEAST = -50.0  # log weight, against a range's largest: less counts as that, and "none" has it
ROUNDS, SETTLED = 100, 1e-3  # of messages: at most, and the relative change that ends them


@compile_once
def propagate(weights, found):
    """Fill the (n, K+1) marginals of all matchings, from (n, K+1) weights of 1 at most a row.

    Between ranges and landmarks messages go round until none changes by more than `SETTLED` of
    itself, or `ROUNDS` times. They err the more the sparser the scan and the less likely "none":
    by a tenth at e^-5; where it is all but impossible, they are sure of the likelier way of two.
    How many ranges have a landmark, and how many landmarks a range, would then agree slowly: so
    all messages are scaled alike, by one where they do.

    Source: Williams, Lau, IEEE Transactions on Aerospace and Electronic Systems 50(4), 2014,
    doi:10.1109/TAES.2014.120568; the common scale is ours.
    """
    n, k = weights.shape[0], weights.shape[1] - 1
    free, wanted = np.ones((n, k)), np.empty((k, n))  # by others than the range or the landmark
    shares, of_row, of_column = np.empty(k), np.empty(k), np.empty(n)
    for i in range(n):
        weights[i, k] = max(weights[i, k], math.exp(LEAST))
    for _ in range(ROUNDS):
        nowhere, unseen, change = max(k - n, 0.0), max(n - k, 0.0), 0.0
        for i in range(n):
            for j in range(k):
                shares[j] = weights[i, j] * free[i, j]
            nowhere += weights[i, k] / _of_others(shares, weights[i, k], of_row)
            for j in range(k):
                wanted[j, i] = weights[i, j] / of_row[j]
        for j in range(k):
            unseen += 1.0 / (1.0 + wanted[j].sum())
        scale = math.sqrt(nowhere / unseen)
        for j in range(k):
            _of_others(wanted[j], 1.0, of_column)
            for i in range(n):
                now = scale / of_column[i]
                change = max(change, abs(now / free[i, j] - 1.0))
                free[i, j] = now
        if change < SETTLED:
            break
    for i in range(n):
        for j in range(k):
            found[i, j] = weights[i, j] * free[i, j]
        found[i, k] = weights[i, k]
        total = found[i].sum()
        for j in range(k + 1):
            found[i, j] /= total


@compile_once
def _of_others(values, constant, sums):
    """Sums of the constant and all (n,) values but one each, of positive terms; the sum of all."""
    total = constant
    for j in range(len(values)):
        sums[j] = total
        total += values[j]
    later = 0.0
    for j in range(len(values) - 1, -1, -1):
        sums[j] += later
        later += values[j]
    return total
