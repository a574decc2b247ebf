"""What every record of a study is made of: strict tables, finite numbers, text that can be seen."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    model_validator,
)
from pydantic_core import PydanticCustomError

from .._json import BIGGEST
from .._names import unseen

LARGEST_WHOLE = 10**100


def _check_visible(text: str) -> str:
    if unseen(text) is not None:
        raise PydanticCustomError("unseen", "holds a character that nobody sees")
    return text


Number = Annotated[float, Field(ge=-BIGGEST, le=BIGGEST)]
Figure = Number | None
Whole = Annotated[int, Field(ge=-LARGEST_WHOLE, le=LARGEST_WHOLE)]
Text = Annotated[str, AfterValidator(_check_visible)]
Texts = list[Text]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]
Axis = Literal["tx", "ty", "tz", "rx", "ry", "rz"]


class StrictRecord(BaseModel):
    """A table of a file, read strictly."""

    model_config = ConfigDict(strict=True, frozen=True, extra="ignore", populate_by_name=True)

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, value: Any) -> Any:
        hidden = [key for key in value if unseen(key)] if isinstance(value, dict) else []
        if hidden:
            raise PydanticCustomError("unseen_key", "{key}", {"key": hidden[0]})
        return value

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain values, without the optional keys that it does not have."""
        return self.model_dump(by_alias=True, exclude_unset=True)
