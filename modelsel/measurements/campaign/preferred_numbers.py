"""Preferred numbers, which divide every decade into steps of about 6 %."""

from __future__ import annotations

# preferred numbers of ISO 3, R 40
PREFERRED = (
    *(100, 106, 112, 118, 125, 132, 140, 150, 160, 170, 180, 190, 200, 212, 224, 236, 250, 265),
    *(280, 300, 315, 335, 355, 375, 400, 425, 450, 475, 500, 530, 560, 600, 630, 670, 710, 750),
    *(800, 850, 900, 950),
)


def list_preferred(least: int, most: int) -> dict[int, None]:
    """List the preferred numbers from one to another, as whole numbers in their order."""
    decades = (0.01, 0.1, 1.0, 10.0, 100.0)
    numbers = {round(decade * number) for decade in decades for number in PREFERRED}
    return dict.fromkeys(number for number in sorted(numbers) if least <= number <= most)
