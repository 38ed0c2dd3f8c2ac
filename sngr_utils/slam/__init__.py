"""The estimation problem (section "Problem"): factors, iSAM2, batch solvers, marginal covariances.

Imports `world`, `numerics` and what is below them.
"""
