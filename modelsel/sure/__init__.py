"""Posterior in closed form and by emcee, bootstrap, correlation, what each mechanism matters."""
