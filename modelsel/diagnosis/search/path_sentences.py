"""Words of the path of a search, which has a line for every step."""

from __future__ import annotations

# what a step of a search that drops an effect begins with
DROPPED = "- "
