"""The models of a study: the ladder from the nominal arm to the one chosen, and the errors on held-out rows."""
