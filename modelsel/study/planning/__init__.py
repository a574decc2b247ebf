"""What to measure next: which configurations, which of them twice, and what they would tell."""
