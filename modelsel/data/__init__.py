"""What was measured, and reading it."""
