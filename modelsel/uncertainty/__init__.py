"""How sure: bootstrap, posterior sampling, significance."""
