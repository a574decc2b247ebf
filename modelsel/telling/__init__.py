"""Results as words, tables, JSON, pictures and pages; one study, or many."""
