"""Where tracker, targets and features stand, and mistakes in the set-up."""
