"""A candidate: one explanation of what is measured, one effect with coefficients of its own."""

from __future__ import annotations

from dataclasses import dataclass

from ..._hashing import cache_hash
from ..._short_numbers import round_numbers
from ...mechanisms.terms import Mechanism
from ..shapes.candidate_kinds import NAMED_IN_FULL, NAMED_IN_WORDS, CandidateKind
from ..shapes.cause_words import write_cause
from .fault_kinds import FaultKind, find_fault_kind
from .own_candidates import Screws

MANY_FRAMES = 4  # that one number moves, from which they are told together


@cache_hash
@dataclass(frozen=True)
class Candidate:
    """An explanation with its prior probability.

    `but_for_sign`: for a cell of the error map, the registered mechanisms with the same screws,
    which physics allows with one sign only; `asked`: the study considers no causes but those that
    it lists."""

    mechanism: Mechanism
    kind: CandidateKind
    prior: float
    but_for_sign: tuple[Mechanism, ...] = ()
    asked: bool = False

    @property
    def registered(self) -> bool:
        """Whether the registry has it."""
        kind = self.kind
        return kind is CandidateKind.MECHANISM

    @property
    def registered_name(self) -> str | None:
        """The registered name; None for an unregistered explanation."""
        if not self.registered:
            return None
        return self.mechanism.name

    @property
    def fault(self) -> FaultKind | None:
        """The kind of data fault that it stands for; None for an error of the arm."""
        if not self.registered:
            return None
        return find_fault_kind(self.mechanism)

    @property
    def bumped_joint(self) -> int:
        """The joint that it lets err around one reading; 0 for any other explanation.

        A few such errors side by side take any shape, so that a model has one of a joint."""
        if self.kind is not CandidateKind.BUMP:
            return 0
        first_term = self.mechanism.terms[0]
        return first_term.screws[0].frame

    @property
    def screws(self) -> Screws:
        """Its terms' screws, without their order."""
        return collect_screws(self.mechanism)

    @property
    def label(self) -> str:
        """A short name: the registered one, or place and cause."""
        mechanism = self.mechanism
        if self.registered:
            return mechanism.name
        if self.kind is CandidateKind.FREE_FUNCTION:
            return mechanism.name.partition(" ")[0]
        if self.kind in NAMED_IN_FULL:
            return mechanism.name
        first_term = mechanism.terms[0]
        screw = first_term.screws[0]
        place = f"frame {screw.frame} {screw.axis}"
        causes = self.causes(" & ")
        if self.many_frames:
            frames = self.many_frames
            place = f"frames {frames[0]} to {frames[-1]}"
            causes = ", ".join(sorted(mechanism.names()))
        return f"{place} · {causes}"

    @property
    def many_frames(self) -> list[int]:
        """The frames that one number of an unregistered mechanism moves, each in its own way; empty of
        few."""
        first_term = self.mechanism.terms[0]
        screws = first_term.screws
        frames = sorted({screw.frame for screw in screws})
        count = len(frames)
        if self.registered or count < MANY_FRAMES:
            return []
        return frames

    def causes(self, conjunction: str) -> str:
        """Its causes in words, joined by a conjunction, their long numbers rounded."""
        mechanism = self.mechanism
        if self.kind is CandidateKind.SHAPE:
            drivers = sorted(mechanism.names())
            listed = ", ".join(drivers)
            return f"free({listed})"
        if self.kind is CandidateKind.WAVE_PRODUCT:
            first, second = sorted(mechanism.names())
            return f"waves of {first} times waves of {second}"
        if self.kind in NAMED_IN_WORDS:
            _, _, named = mechanism.name.split(" ", 2)
            return round_numbers(named)
        if self.kind is CandidateKind.PERIOD:
            repeated = mechanism.terms[0].screws[0].cause
            named = f"pattern that repeats on {repeated}"
            return round_numbers(named)
        words: list[str] = []
        for term in mechanism.terms:
            for screw in term.screws:
                cause = write_cause(screw.cause)
                if cause not in words:
                    words.append(cause)
        return conjunction.join(words)


def collect_screws(mechanism: Mechanism) -> Screws:
    """Return the screws of a mechanism's terms, by which two mechanisms do the same."""
    return frozenset(term.key for term in mechanism.terms)
