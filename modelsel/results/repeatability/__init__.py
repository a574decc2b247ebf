"""What does not repeat, what rounding of the readings leaves of a joint, and what a gear may hide."""
