"""What a study says: records, verdicts, tables, storage."""
