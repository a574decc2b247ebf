"""Joint commands whose real position is the wanted one, and the table that they are written in."""
