"""The search for effects: step by step, then over sets of them."""
