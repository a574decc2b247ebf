"""Faults of the data: rows that are far off, mistaken or exchanged."""
