"""What the records of a study add to strict records: figures that may be undefined, names, axes."""

from __future__ import annotations

from typing import Literal

from ..._records import Number, Text

Figure = Number | None
Texts = list[Text]
Axis = Literal["tx", "ty", "tz", "rx", "ry", "rz"]
