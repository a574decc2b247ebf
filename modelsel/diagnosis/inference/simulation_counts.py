"""How many draws the tests by simulation have: the least p-value of each is 1 / (draws + 1)."""

from __future__ import annotations

# draws under the null of small and of large studies, by noise and by signs of the residual
NULL_DRAWS = (999, 499)
FLIP_DRAWS = (999, 185)
# random directions that say how often chance does as well as a fault of single rows
FAULT_DRAWS = 1999
# signs that say whether a smooth function predicts what is left
REST_FLIPS = 199
