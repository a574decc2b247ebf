"""Keys that study files did not always have: a study without them is written, and hashed, as before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

# of a measurements file that has the contract's own form
PLAIN_FORM: Mapping[str, Any] = {
    "features": {},
    "sheet": None,
    "decimal": None,
    "header": True,
    "joined": {},
}


def drop_defaults(written: dict[str, Any], defaults: Mapping[str, Any]) -> dict[str, Any]:
    """Drop the keys that hold their defaults."""
    new = {}
    for key, value in written.items():
        is_default = key in defaults and value == defaults[key]
        if not is_default:
            new[key] = value
    return new
