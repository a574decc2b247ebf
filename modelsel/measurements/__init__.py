"""What was measured: reading and checking measurement files."""
