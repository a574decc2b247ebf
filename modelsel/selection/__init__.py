"""Which of several models: splits, cross-validation, criteria, subsets."""
