"""Measurements prepared for a study: checked, set up, weighted, split into estimation and held-out rows."""
