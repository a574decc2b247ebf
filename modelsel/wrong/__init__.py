"""Cause, screw, term, mechanism: everything that can be wrong, as values; the table of mechanisms."""
