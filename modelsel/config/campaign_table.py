"""The table of a study file that an auditor reads: what was measured, when, with what, by whom."""

from __future__ import annotations

from datetime import date
from typing import Annotated

from pydantic import BeforeValidator, Field

from .._names import strip_directions
from .frozen_table import FrozenTable
from .study_tables import Name


def _as_campaign_text(value: object) -> object:
    """Return a date of TOML or a whole number as text, and text without marks of direction."""
    if isinstance(value, date) or (isinstance(value, int) and not isinstance(value, bool)):
        return str(value)
    if isinstance(value, str):
        return strip_directions(value).strip()
    return value


CampaignText = Annotated[Name, BeforeValidator(_as_campaign_text)]


class CampaignTable(FrozenTable):
    """[campaign]: what an auditor asks about the measurements. It appears in the report and
    affects no result."""

    date: CampaignText | None = Field(default=None, description="Date of the measurements.")
    instrument: CampaignText | None = Field(default=None, description="Measuring instrument.")
    serial_number: CampaignText | None = Field(
        default=None, description="Serial number of the robot."
    )
    operator: CampaignText | None = Field(default=None, description="Who measured.")
    ambient: CampaignText | None = Field(
        default=None, description="Ambient conditions, such as temperature and humidity."
    )

    @property
    def given(self) -> dict[str, str]:
        """What the study gives, by key."""
        return {key: text for key, text in self if text is not None}
