"""Unknown names in a study file that cannot be read for another reason: all of a file's errors are
said at once."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .._files import STUDY_FILE
from .._text import parse_toml, read_text
from ..config.study_file import Study, read_study
from ..exceptions import StudyError
from ..mechanisms.registry import refuse_unknown_mechanism, with_plugins

# lists of mechanisms in [model], and the one that holds lists of them
LISTS = ("base", "candidates")
LADDER = "ladder"


def read_whole_study(path: Path) -> Study:
    """Read a study file; a folder stands for its study.toml. Raises StudyError with every problem,
    mechanisms that nobody has registered among them."""
    try:
        return read_study(path)
    except StudyError as error:
        file = path / STUDY_FILE if path.is_dir() else path
        unknown = _list_unknown_mechanisms(file)
        raise StudyError(*error.problems, *unknown) from None


def _list_unknown_mechanisms(file: Path) -> list[str]:
    """List the names of mechanisms in a study file that are in no registry; none where it is not
    even TOML."""
    try:
        table = parse_toml(read_text(file, "the study file"), file.name)
    except StudyError:
        return []
    registry, _ = with_plugins()
    own_names = set(_list_own_names(table))
    problems = []
    for place, name in _list_named(table):
        stem, _, _ = name.partition(":")
        if stem in registry or name in own_names:
            continue
        problems.append(f"{file.name}: {place}: {refuse_unknown_mechanism(name, registry)}")
    return list(dict.fromkeys(problems))


def _list_own_names(table: dict[str, Any]) -> Iterator[str]:
    """List what the file calls causes of its own."""
    causes = table.get("covariate")
    for cause in causes if isinstance(causes, list) else ():
        name = cause.get("name") if isinstance(cause, dict) else None
        if isinstance(name, str):
            yield name


def _list_named(table: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """List the mechanisms that a file names, each with its place; what is no list of names is wrong
    in another way."""
    model = table.get("model")
    if not isinstance(model, dict):
        return
    for key in LISTS:
        yield from _list_texts(f"model.{key}", model.get(key))
    rungs = model.get(LADDER)
    for rung in rungs if isinstance(rungs, list) else ():
        yield from _list_texts(f"model.{LADDER}", rung)


def _list_texts(place: str, names: object) -> Iterator[tuple[str, str]]:
    listed = names if isinstance(names, list) else ()
    for name in listed:
        if isinstance(name, str):
            yield place, name
