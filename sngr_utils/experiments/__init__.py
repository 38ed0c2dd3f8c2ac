"""Many worlds to tidy tables: one module a study, named by what it measures.

Imports everything that estimates; nothing that shows or publishes.
"""
