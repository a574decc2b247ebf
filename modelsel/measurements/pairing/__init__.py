"""Points of an instrument and readings of a joint log, joined to one table."""
