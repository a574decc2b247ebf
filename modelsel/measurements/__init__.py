"""What was measured: reading and checking measurement files.

Its folders, each of which imports from those above it alone:

- `formats`: text tables, spreadsheets and Parquet files, read as tables of named columns
- `campaign`: visits, motion, time, state variables and features of rows
- `quantities`: positions, orientations, lengths, times and names from columns, with their units
- `recognition`: which columns of a file are what
- `pairing`: points and readings from two files, joined to one table

Beside them are the measurements themselves, and `read_measurements` of `reader`.
"""
