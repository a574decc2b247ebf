"""One model: design matrix, least squares, identifiability, noise."""
