"""Folds, criteria, subsets, the split, errors and gain, what could be wrong."""
