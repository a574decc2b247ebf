"""Candidates that a study lists and its measurements cannot test, and what they lack."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ...diagnosis.candidates.scanned_constants import has_both_sides
from ...diagnosis.candidates.usable_names import list_lacking
from ...exceptions import StudyError, sentence_list
from ...fitting.problem import Problem
from ...measurements.campaign.state_names import describe_state_name
from ...mechanisms.campaign_registry import TARGET_STEP, is_of_targets, set_targets
from ...mechanisms.moved_targets import JOINED, find_moved_targets
from ...mechanisms.registry import Registry, build_mechanisms
from ...mechanisms.terms import Mechanism
from ...notices import Note


@dataclass(frozen=True)
class Untested:
    """Names of mechanisms that cannot be tested, each with the state variables that are unknown; and
    steps of targets that have too few rows before or after any moment, or what moves a target of which
    there is no estimation row."""

    missing: dict[str, frozenset[str]]
    one_sided: tuple[str, ...] = ()
    unseen: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """What each of them needs, to follow a colon; empty where all can be tested."""
        parts = []
        for name, unknown in self.missing.items():
            needed = sentence_list([describe_state_name(each) for each in sorted(unknown)])
            parts.append(f"{name} needs {needed}")
        sentences = []
        if parts:
            listed = "; ".join(parts)
            sentences.append(f"{listed}, of which the measurements say nothing.")
        sentences += [
            f"{name} needs {_say_targets(name)} both before and after a slip."
            for name in self.one_sided
        ]
        sentences += [
            f"{name} needs estimation rows of {_say_targets(name)}." for name in self.unseen
        ]
        return " ".join(sentences)

    def note(self) -> tuple[Note, ...]:
        """Return the warning about them; empty where all can be tested."""
        if not self.reason:
            return ()
        sentence = (
            f"Not every candidate can be tested: {self.reason} Add it, or take the candidate out of the "
            "study file."
        )
        return (Note("candidates-untested", sentence),)

    def select_tested(self, asked: Sequence[str] | str) -> Sequence[str] | str:
        """Select what can be tested of a study's list of candidates, each once."""
        if isinstance(asked, str):
            return asked
        untested = {*self.missing, *self.one_sided, *self.unseen}
        return [name for name in dict.fromkeys(asked) if name not in untested]


def find_untested(
    asked: Sequence[str] | str,
    problem: Problem,
    mechanisms: Sequence[Mechanism],
    unseen: tuple[str, ...] = (),
) -> Untested:
    """Find the `mechanisms` of a study's list `asked` for whose causes the data lack a value, in any
    form that they have; names of `unseen` targets are known."""
    if isinstance(asked, str) or not asked:
        return Untested({})
    unknown = {}
    usable = set()
    for mechanism, lacking in zip(mechanisms, list_lacking(problem, mechanisms), strict=True):
        if lacking:
            unknown[mechanism.name] = lacking
        else:
            usable.add(mechanism.name)
    tested = {name.partition(":")[0] for name in usable}
    missing = {}
    for name, lacking in unknown.items():
        if name in usable:
            continue
        stem = name.partition(":")[0]
        # a mechanism of each joint is told once
        is_one_joint = stem in tested or name in asked
        missing[name if is_one_joint else stem] = lacking
    return Untested(missing, _list_one_sided(asked, problem, mechanisms), unseen)


def find_unseen_steps(
    asked: Sequence[str] | str, problem: Problem, registry: Registry
) -> tuple[str, ...]:
    """Find the names of what moves a target that was left out, as no estimation row measures it."""
    listed = problem.data.listed_targets
    if isinstance(asked, str) or not listed:
        return ()
    registry = set_targets(registry, listed)
    unseen = []
    for name in asked:
        stem, _, _ = name.partition(":")
        if not is_of_targets(registry.get(stem)):
            continue
        built = build_mechanisms(name, problem.robot, registry)
        moved = [listed[target.index] for one in built[:1] for target in find_moved_targets(one)]
        if not set(moved) <= set(problem.data.targets):
            unseen.append(name)
    return tuple(unseen)


def _say_targets(name: str) -> str:
    """Say of how many targets a step is, by its name."""
    return "its targets" if JOINED in name else "its target"


def refuse_unseen(names: Sequence[str], problem: Problem, registry: Registry) -> None:
    """Raise StudyError where mechanisms of the study's own models move a target that was left out."""
    unseen = find_unseen_steps(names, problem, registry)
    if unseen:
        raise StudyError(
            f"model: {Untested({}, unseen=unseen).reason} Let some of its configurations fit the "
            "models, or take the mechanism out of the base and the ladder."
        )


def _list_one_sided(
    asked: Sequence[str], problem: Problem, mechanisms: Sequence[Mechanism]
) -> tuple[str, ...]:
    """List the steps of some targets, asked for by name, that no moment has rows on both sides of."""
    of_targets = [m for m in mechanisms if m.stem == TARGET_STEP and find_moved_targets(m)]
    known = {m.name for m in of_targets if has_both_sides(problem, m)}
    one_sided = dict.fromkeys(m.name for m in of_targets if m.name not in known)
    return tuple(
        name
        for name in dict.fromkeys(asked)
        if any(name == step or name.startswith(f"{step}:") for step in one_sided)
    )


def require_causes(problem: Problem, mechanisms: Iterable[Mechanism]) -> None:
    """Raise StudyError where the data lack what mechanisms of the study's own models depend on."""
    available = frozenset(problem.names())
    missing = {one.name: one.names() - available for one in mechanisms}
    lacking = {name: unknown for name, unknown in missing.items() if unknown}
    if lacking:
        raise StudyError(
            f"model: {Untested(lacking).reason} Add it to the measurements, or take the mechanism out "
            "of the base and the ladder."
        )
