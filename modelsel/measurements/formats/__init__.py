"""Text tables, spreadsheets and Parquet files, read as tables of named columns."""
