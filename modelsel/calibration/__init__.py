"""Using the result: predict, correct, compensate, export, validate, plan."""
