"""What the tables of a study file have in common: strict values, which stay as they are."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict

from ..exceptions import ArgumentError


class FrozenTable(BaseModel):
    """A table of a study file, or the whole of it. Raises ArgumentError where a value is set."""

    model_config = ConfigDict(
        extra="forbid", frozen=True, strict=True, arbitrary_types_allowed=True
    )

    def __setattr__(self, name: str, value: Any) -> None:
        raise ArgumentError(
            f"{name}: a study keeps its values. Make another one: "
            'Study(**{**dict(study), "name": "another"}).'
        )
