"""Robot and data bound together: columns, rank, alias groups."""
