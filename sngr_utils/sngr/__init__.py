"""The paper's method (sections "Trigger" and "Refinement"): windows, trigger, closure, gate.

Imports `sampling`, `slam` and what is below them.
"""
