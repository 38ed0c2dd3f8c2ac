"""Which windows have failed? Scores that may tell, and thresholds with a known rate of alarms.

Imports `sngr` and what is below it.
"""
