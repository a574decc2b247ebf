"""Columns of the design: what each candidate moves at every row."""
