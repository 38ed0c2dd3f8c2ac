"""The online estimator: landmarks that wait, data association, slips of the odometry.

Imports `detection`, `sampling`, `robust` and what is below them.
"""
