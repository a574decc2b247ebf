"""How much each candidate explains, and how probable that makes it: scan, evidence, tests, credible sets."""
