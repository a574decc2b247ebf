"""What rows are in their campaign: visits and their order, motion, time, state variables, shared features."""
