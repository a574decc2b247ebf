"""[[covariate]]: causes of the study's own, of columns of its measurements."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Field, model_validator

from ..robot.rigid import Axis
from .frozen_table import FrozenTable

# the word that a name in model.base is, so that no registered name's joint or constant is in it
WORD = re.compile(r"[A-Za-z][A-Za-z0-9-]*")
CAUSE_WORD = re.compile(r"[^\W\d]\w*")
# causes that one table may combine: of twenty, products are 190 columns of the error map
MAX_CAUSES = 20


def _check_word(name: str) -> str:
    if not WORD.fullmatch(name) or len(name) > 60:
        raise ValueError(
            f"expected a name of letters, digits and hyphens, 60 at most, found {name[:60]!r}"
        )
    return name


class CovariateTable(FrozenTable):
    """[[covariate]]: causes that the search weighs in addition to those it has: each one alone, every
    pair together, or the product of every pair. A single effect at one place can be given a name,
    which model.base, model.ladder and model.candidates may list."""

    causes: list[str] = Field(
        max_length=MAX_CAUSES, description="Columns of the file, or formulas that contain one."
    )
    as_: Literal["alone", "pairs", "products"] = Field(
        default="alone",
        alias="as",
        description='Each cause alone; "pairs": every pair of causes, each cause with its own '
        'coefficient; "products": the product of every pair.',
    )
    frame: int | None = Field(
        default=None,
        ge=1,
        description="Frame where the effect acts, with axis: 1 to n, n+1 for the target; without both, "
        "every place.",
    )
    axis: Axis | None = Field(default=None, description="Axis of that frame.")
    prior: float | None = Field(
        default=None,
        gt=0,
        lt=1,
        description="Prior probability that an effect is one of the table's, shared evenly among them.",
    )
    name: Annotated[str, AfterValidator(_check_word)] | None = Field(
        default=None,
        description="Name of a single effect at one place, for model.base, model.ladder and "
        "model.candidates.",
    )

    @model_validator(mode="before")
    @classmethod
    def _table(cls, given: Any) -> Any:
        if isinstance(given, str):
            raise ValueError(f'expected a table: causes = ["{given[:60]}"]')
        return given

    @model_validator(mode="after")
    def _consistent(self) -> CovariateTable:
        if not self.causes:
            raise ValueError("causes lists nothing; columns of the file, or formulas, are expected")
        repeated = _find_repeated(self.causes)
        if repeated is not None:
            product = "; a product has two different causes" if self.as_ == "products" else ""
            raise ValueError(f'causes lists "{repeated}" twice{product}')
        if self.as_ != "alone" and len(self.causes) < 2:
            raise ValueError(f'as = "{self.as_}" needs two causes or more')
        if (self.frame is None) != (self.axis is None):
            raise ValueError("frame and axis go together: give both, or neither for every place")
        if self.name is not None and (self.frame is None or self.count > 1):
            raise ValueError(
                f'name = "{self.name}" stands for one effect at one place: give frame and axis, and '
                "one cause, or two as pairs or products"
            )
        return self

    @property
    def count(self) -> int:
        """How many effects the table stands for at one place."""
        given = len(self.causes)
        return given if self.as_ == "alone" else given * (given - 1) // 2


def list_words(table: CovariateTable) -> list[str]:
    """List the words of a table's causes, columns of the file among them."""
    return [word for cause in table.causes for word in CAUSE_WORD.findall(cause)]


def _find_repeated(causes: Sequence[str]) -> str | None:
    """Find a cause that is listed twice, whatever its spaces."""
    seen: set[str] = set()
    for cause in causes:
        plain = re.sub(r"\s", "", cause)
        if plain in seen:
            return cause.strip()[:60]
        seen.add(plain)
    return None


def expect_tables(given: Any) -> Any:
    """Refuse one table where a list of them is expected. Raises ValueError."""
    if isinstance(given, dict):
        raise ValueError("expected [[covariate]], with two brackets on each side")
    return given


def check_covariates(tables: list[CovariateTable]) -> list[CovariateTable]:
    """Check that names differ, and that priors leave something. Raises ValueError."""
    names = [table.name for table in tables if table.name is not None]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f'the name "{name}" is given twice')
    priors = [table.prior or 0.0 for table in tables]
    total = sum(priors)
    if total >= 1:
        raise ValueError(
            f"the priors sum to {total:.4g}; all other explanations together need what is left of 1"
        )
    return tables
