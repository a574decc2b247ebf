"""Candidates that a study lists and its measurements cannot test, and what they lack."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ..diagnosis.candidates import list_usable_names
from ..exceptions import StudyError, sentence_list
from ..fitting.problem import Problem
from ..measurements.state_names import describe_state_name
from ..mechanisms.terms import Mechanism
from ..notices import Note


@dataclass(frozen=True)
class Untested:
    """Names of mechanisms that cannot be tested, each with the state variables that are unknown."""

    missing: dict[str, frozenset[str]]

    @property
    def reason(self) -> str:
        """What each of them needs, to follow a colon; empty where all can be tested."""
        parts = []
        for name, unknown in self.missing.items():
            needed = sentence_list([describe_state_name(each) for each in sorted(unknown)])
            parts.append(f"{name} needs {needed}")
        if not parts:
            return ""
        listed = "; ".join(parts)
        return f"{listed}, of which the measurements say nothing."

    def note(self) -> tuple[Note, ...]:
        """Return the warning about them; empty where all can be tested."""
        if not self.missing:
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
        return [name for name in dict.fromkeys(asked) if name not in self.missing]


def find_untested(
    asked: Sequence[str] | str, problem: Problem, mechanisms: Iterable[Mechanism]
) -> Untested:
    """Find the `mechanisms` of a study's list `asked` for whose causes the data lack a value."""
    if isinstance(asked, str) or not asked:
        return Untested({})
    available = list_usable_names(problem)
    unknown = {}
    tested = set()
    for mechanism in mechanisms:
        lacking = mechanism.names() - available
        if lacking:
            unknown[mechanism.name] = frozenset(lacking)
        else:
            tested.add(mechanism.name.partition(":")[0])
    missing = {}
    for name, lacking in unknown.items():
        stem = name.partition(":")[0]
        # a mechanism of each joint is told once
        is_one_joint = stem in tested or name in asked
        missing[name if is_one_joint else stem] = lacking
    return Untested(missing)


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
