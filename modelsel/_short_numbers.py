"""Names with short numbers: what people read of a cause whose constants have ten digits."""

from __future__ import annotations

import re

# significant digits of a constant in a name
DIGITS = 4
LONG_NUMBER = re.compile(r"\d+\.\d{3,}")


def round_numbers(name: str) -> str:
    """Return a name or a cause with its long numbers rounded to four significant digits, for people to
    read; digits before the point stay."""
    return LONG_NUMBER.sub(_round_number, name)


def _round_number(match: re.Match[str]) -> str:
    number = match[0]
    whole, _, _ = number.partition(".")
    digits = max(DIGITS, len(whole))
    return f"{float(number):.{digits}g}"
