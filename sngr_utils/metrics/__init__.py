"""What is measured about an estimate or a detector. Pure functions of arrays.

Imports nothing of the package but `settings`.
"""
