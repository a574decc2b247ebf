"""Weights, least squares on the exact chain, the tracker's frame."""
