"""A robot from a table of DH parameters, as people have it."""
