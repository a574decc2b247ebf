"""Strict records of the JSON files that modelsel writes and reads back, and what is wrong with one,
in words of the file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from reprlib import repr as brief
from textwrap import shorten
from typing import Annotated, Any, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    GetCoreSchemaHandler,
    ValidationError,
    model_validator,
)
from pydantic_core import CoreSchema, PydanticCustomError, core_schema

from ._names import find_hidden_character

MAX_NUMBER = 1e100  # its square and its cube can be computed with
MAX_WHOLE = 10**100
MAX_SHOWN = 80  # characters of a value in a message
MAX_LINE = 160  # characters of a record in a Python session
BRANCH = "<"  # begins the tag of a branch of a union: no key of a file, left out of places
EXPECTED = {
    "float_type": "a finite number",
    "finite_number": "a finite number",
    "int_type": "a whole number",
    "string_type": "text that can be seen",
    "unseen": "text that can be seen",
    "bool_type": "true or false",
    "list_type": "a list",
    "tuple_type": "a list",
    "model_type": "a table",
    "dict_type": "a table",
}


def _check_visible(text: str) -> str:
    if find_hidden_character(text) is not None:
        raise PydanticCustomError("unseen", "holds a character that nobody sees")
    return text


Number = Annotated[float, Field(ge=-MAX_NUMBER, le=MAX_NUMBER)]
Whole = Annotated[int, Field(ge=-MAX_WHOLE, le=MAX_WHOLE)]
Text = Annotated[str, AfterValidator(_check_visible)]
Pair = Annotated[list[Number], Field(min_length=2, max_length=2)]
Vector = Annotated[list[Number], Field(min_length=3, max_length=3)]


@dataclass(frozen=True)
class OneOf:
    """The words that a text may be, where they come from a table of the program."""

    words: tuple[str, ...]

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        words = list(self.words)
        return core_schema.literal_schema(words)


class StrictRecord(BaseModel):
    """A table of a file, read strictly: every key, each of its type, and only finite numbers. Keys
    that a record does not know are ignored, as docs/reference/files.md promises."""

    model_config = ConfigDict(
        strict=True, frozen=True, extra="ignore", populate_by_name=True, defer_build=True
    )

    def __repr__(self) -> str:
        """One line: its sentence, or its name with its probability, or as much as fits."""
        name = type(self).__name__
        kind = name.removesuffix("Record")
        said = getattr(self, "sentence", None) or getattr(self, "name", None)
        if not isinstance(said, str):
            fields = [f"{key}={brief(value)}" for key, value in self.__repr_args__()]
            listed = shorten(", ".join(fields), MAX_LINE, placeholder=" …")
            return f"{name}({listed})"
        probability = getattr(self, "probability", None)
        likely = "" if probability is None else f", probability {probability:.2f}"
        return f"{kind}: {said}{likely}"

    def __str__(self) -> str:
        return repr(self)

    @model_validator(mode="before")
    @classmethod
    def _check_keys(cls, value: Any) -> Any:
        hidden = (
            [key for key in value if find_hidden_character(key)] if isinstance(value, dict) else []
        )
        if hidden:
            raise PydanticCustomError("unseen_key", "{key}", {"key": hidden[0]})
        return value

    def to_dict(self) -> dict[str, Any]:
        """Return the table as plain values, without the optional keys that it does not have."""
        return self.model_dump(by_alias=True, exclude_unset=True)


Record = TypeVar("Record", bound=StrictRecord)


def parse_record(value: Any, model: type[Record]) -> Record:
    """Return a JSON value as a record. Raises ValueError with the first problem and its place."""
    try:
        return model.model_validate(value)
    except ValidationError as error:
        raise ValueError(describe_problem(error.errors(include_url=False)[0])) from None


def describe_problem(error: Any) -> str:
    """Describe an error of pydantic: its place (items counted from 1), what was expected, what is
    there."""
    kind, value = error["type"], error["input"]
    place = _place(error["loc"])
    where = place or "the file"
    if kind == "missing":
        return f"{place} is missing"
    if kind == "extra_forbidden":
        return f"{where}: unknown key"
    if kind == "unseen_key":
        key = json.dumps(error["ctx"]["key"])[:MAX_SHOWN]
        return f"{where}: the key {key} holds a character that nobody sees"
    if kind == "recursion_loop":
        return f"{where}: nested too deeply"
    if kind == "value_error":
        return f"{where}: {error['ctx']['error']}"
    expected = _expectation(error)
    return f"{where}: expected {expected}, found {_shown(value)}"


def _place(parts: tuple[int | str, ...]) -> str:
    """Return a path such as findings.1.p_value."""
    steps = []
    for part in parts:
        step = str(part + 1) if isinstance(part, int) else part
        if not step.startswith(BRANCH):
            steps.append(step)
    return ".".join(steps)


def _expectation(error: Any) -> str:
    kind, context = error["type"], error.get("ctx") or {}
    if kind in EXPECTED:
        return EXPECTED[kind]
    if kind in ("too_short", "too_long"):
        side = "at least" if kind == "too_short" else "at most"
        bound = context.get("min_length", context.get("max_length"))
        return f"a list of {side} {bound}"
    if kind == "literal_error":
        return f"one of {context['expected']}"
    is_bound = kind in ("greater_than", "greater_than_equal", "less_than", "less_than_equal")
    return _describe_bound(kind, context) if is_bound else str(error["msg"])


def _describe_bound(kind: str, context: dict[str, Any]) -> str:
    """Describe a number's bound; the bound of all numbers is that they are finite."""
    bound = next(iter(context.values()))
    allows_all = abs(bound) == MAX_NUMBER
    if allows_all:
        is_whole = isinstance(bound, int)
        return "a whole number" if is_whole else "a finite number"
    words = {"greater_than": "above", "less_than": "below", "less_than_equal": "at most"}
    side = words.get(kind, "at least")
    return f"a number {side} {bound:g}"


def _shown(value: Any) -> str:
    """Return a value as a message shows it: a short text."""
    if isinstance(value, list):
        return f"a list of {len(value)}"
    if isinstance(value, dict):
        return "a table"
    return json.dumps(value, ensure_ascii=True)[:MAX_SHOWN]
