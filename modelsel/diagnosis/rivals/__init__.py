"""Rivals of a finding: shapes that no list has, one in the place of several, other drivers."""
