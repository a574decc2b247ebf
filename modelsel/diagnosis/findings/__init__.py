"""The named effects: how much of each is proven, what it is told as, and its sentences."""
