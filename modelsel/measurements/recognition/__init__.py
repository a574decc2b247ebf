"""Which columns of a file are what: readings, positions, orientations, covariates."""
