"""Sentences and tables of a record, which the terminal, the PDF, the page to explore and notebooks share."""
