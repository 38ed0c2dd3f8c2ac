"""The simulated world (section "Experimental set-up"): scenario, motion, ranges, labels.

NumPy only. Imports nothing of the package but `settings`.
"""
