"""Positions, orientations, lengths, times and names, as the columns of a table give them, with units."""
