"""Compiled functions that several rooms need: linear algebra, the normal quantile, derivatives.

Imports nothing of the package but `paths`.
"""
