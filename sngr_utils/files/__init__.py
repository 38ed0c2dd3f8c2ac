"""Logs from files and into files, a module for each format.

Every reader returns a `Recording`; what it cannot express is refused by file, line and reason.
"""
