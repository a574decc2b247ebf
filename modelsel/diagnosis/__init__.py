"""Naming the cause: scan, evidence, credible sets, stepwise search, outliers."""
