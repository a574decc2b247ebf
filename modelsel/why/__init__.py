"""Outliers, the scan, credible sets, the loop that extends the model."""
