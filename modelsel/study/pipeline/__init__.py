"""The steps of a study, from its measurements to its result."""
