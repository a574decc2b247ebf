"""The chain, its screw field, nominal robots, gravity's moments."""
