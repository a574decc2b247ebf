"""The targets of several that a mechanism moves: one that slipped by itself, or some of them alike."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..exceptions import one_line, sentence_list
from .causes import ONE, Cause, Combined, Member, belongs_to_target
from .terms import Mechanism, Screw, Term

# between the names of targets that move alike
JOINED = " & "
# how what moves the target begins to be told, and of a step how it goes on
THE_TARGET = "The target"
TOLD = f"{THE_TARGET} stands elsewhere on the flange"


def limit_to_targets(
    step: Mechanism, targets: Mapping[int, str], numbers: Sequence[int] = ()
) -> Mechanism:
    """Limit what moves the targets to some of several, given by their places (0-based) and names: to
    one that is moved by itself, or, of a step, to more that slipped alike. `numbers`: those of all targets in their
    file, where they are not their places."""
    own = numbers or range(1, max(targets) + 2)
    members = [belongs_to_target(place, own[place]) for place in targets]
    names = JOINED.join(targets.values())
    words = [one_line(name) for name in targets.values()]
    moved = str(members[0])
    begins, told = THE_TARGET, f"Target {words[0]}"
    if len(members) > 1:
        listed = " + ".join(map(str, members))
        moved = f"({listed})"
        begins, told = (
            TOLD,
            f"Targets {sentence_list(words)} stand elsewhere on the flange, shifted alike,",
        )
    terms = [_limit_term(term, members) for term in step.terms]
    sentence = step.sentence.replace(begins, told, 1)
    is_step = TOLD in step.sentence
    product = "*" if is_step else " · "
    equation = f"{step.equation}{product}{moved}" if step.equation else ""
    return replace(
        step, name=f"{step.name}:{names}", terms=tuple(terms), sentence=sentence, equation=equation
    )


def _limit_term(term: Term, members: list[Member]) -> Term:
    """Limit a term to some targets, which it moves alike."""
    screws: list[Screw] = []
    for member in members:
        for screw in term.screws:
            cause = screw.cause * member
            own = replace(screw, cause=cause)
            screws.append(own)
    return replace(term, screws=tuple(screws))


def find_moved_targets(mechanism: Mechanism) -> tuple[Member, ...]:
    """Find the targets of several that a mechanism moves with some cause, alike; none where it moves
    all."""
    members: list[Member] = []
    for term in mechanism.terms[:1]:
        for screw in term.screws:
            target, cause = split_target(screw.cause)
            if target is None or cause == ONE:
                return ()
            members.append(target)
    return tuple(dict.fromkeys(members))


def split_target(cause: Cause) -> tuple[Member | None, Cause]:
    """Split a cause into the one target that it is limited to, None where it is of all, and the rest."""
    if isinstance(cause, Member) and cause.kind == "target":
        return cause, ONE
    if not isinstance(cause, Combined) or cause.operator not in "*/":
        return None, cause
    left, right = cause.left, cause.right
    target, rest = split_target(left)
    if target is not None:
        is_factor = rest == ONE and cause.operator == "*"
        return target, right if is_factor else replace(cause, left=rest)
    if cause.operator == "*":
        target, rest = split_target(right)
    if target is None:
        return None, cause
    return target, left if rest == ONE else replace(cause, right=rest)
