"""Samplers of a posterior: nested sampling, importance sampling, modes, priors, references.

Imports `slam` and what is below it; the samplers import the targets, not the other way round.
"""
