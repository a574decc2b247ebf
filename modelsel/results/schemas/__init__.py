"""The records that a study writes, strict: result.json and details.json."""
