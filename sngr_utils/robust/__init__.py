"""Ways of doubting a label: robust losses, switches, mixtures, soft association, particles.

Imports `slam` and what is below it.
"""
