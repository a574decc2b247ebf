"""What can be wrong: causes, screws, terms and the registry of error mechanisms."""
