"""The study's data made ready, the search as a whole, its confidence, planted effects."""
