"""Names of mechanisms that a study lists, where its robot cannot be read to build them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from ...config.study_file import Study
from ...mechanisms.registry import Registry, refuse_unknown_mechanism
from ..preparation.own_causes import list_own_names


def list_named_mechanisms(study: Study) -> Iterator[tuple[str, Sequence[str]]]:
    """List the mechanisms that a study names, with the key of each list."""
    model = study.model
    yield "model.base", model.base
    for rung in model.ladder:
        yield "model.ladder", rung
    yield "search.outcomes", list(study.search.outcomes)
    if model.candidates != "all":
        yield "model.candidates", list(model.candidates)


def list_unknown_mechanisms(study: Study, registry: Registry) -> list[str]:
    """List the names of mechanisms that are in no registry, and none of the study's own."""
    own_names = list_own_names(study)
    problems = []
    for place, names in list_named_mechanisms(study):
        for name in names:
            stem, _, _ = name.partition(":")
            if stem not in registry and name not in own_names:
                problems.append(f"{place}: {refuse_unknown_mechanism(name, registry)}")
    return list(dict.fromkeys(problems))
