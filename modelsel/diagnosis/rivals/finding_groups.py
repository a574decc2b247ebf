"""Findings of one place, taken together: one shape that no list has may explain what several listed ones
approximate."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations

from ...fitting.problem import Problem
from ...mechanisms.motors import is_joint_motion
from ...mechanisms.terms import Mechanism
from ..candidates.candidate import Candidate
from ..shapes.candidate_kinds import CandidateKind
from ..shapes.distinct_places import Place
from ..shapes.torque_powers import generate_powers
from .changing_ripples import list_loaded_ripples, list_turning_ripples
from .changing_shapes import generate_changing
from .field_distortions import generate_distortions, is_seen_wrongly
from .finer_waves import generate_finer_waves
from .free_functions import Drivers, generate_shapes
from .joint_drags import generate_drags_together, is_own_hysteresis
from .kinks import list_kinks_together
from .pair_waves import generate_waves_of
from .soft_shapes import DISTINCT, list_soft_steps, list_springs
from .stepped_waves import generate_waves_in_time
from .uneven_bases import depends_on_load, generate_uneven_bases
from .unlisted_shapes import UNLISTED_ODDS

# prior probability of a further listed finding at a place, where one is
FURTHER = 0.1


@dataclass(frozen=True)
class FindingGroup:
    """Findings of one place: their numbers, all of them as one candidate, and shapes of their
    drivers that no list has; `others`: shapes of another driver, which these depend on."""

    members: tuple[int, ...]
    listed: Candidate
    shapes: tuple[Candidate, ...]
    others: tuple[Candidate, ...] = ()

    @property
    def every(self) -> tuple[Candidate, ...]:
        """All explanations, what is listed first."""
        return (self.listed, *self.shapes, *self.others)


def list_finding_groups(problem: Problem, effects: Mapping[int, Candidate]) -> list[FindingGroup]:
    """List the findings that share a place: every two, and all of a place together; and those that an
    uneven base may stand for.

    Functions of one joint's own angle are left to `joint_curves`, but for waves: two of them may be
    one of a number between."""
    by_place: dict[Place, list[int]] = {}
    for g, candidate in effects.items():
        if candidate.asked:
            return []
        for place in candidate.mechanism.names_by_place():
            by_place.setdefault(place, []).append(g)
    groups: dict[tuple[int, ...], Place] = {}
    for place, members in by_place.items():
        for group in (*combinations(members, 2), tuple(members)):
            if len(group) > 1:
                groups.setdefault(group, place)
    gathered = [_build_group(problem, effects, group, place) for group, place in groups.items()]
    uneven = _generate_on_uneven(problem, effects)
    return [*(one for one in gathered if one is not None), *uneven]


def _generate_on_uneven(
    problem: Problem, effects: Mapping[int, Candidate]
) -> Iterator[FindingGroup]:
    """Generate the findings, of any places, that one tilt of an uneven base may stand for: every two, all
    but one, and all."""
    members = [g for g, one in effects.items() if depends_on_load(one.mechanism)]
    count = len(members)
    sizes = sorted({size for size in (2, count - 1, count) if 1 < size <= count})
    groups = [group for size in sizes for group in combinations(members, size)]
    tilts = list(generate_uneven_bases(problem)) if groups else []
    kind = CandidateKind.UNEVEN_BASE
    for group in groups if tilts else ():
        own = [effects[g] for g in group]
        if any(one.kind is kind for one in own):
            continue
        prior = UNLISTED_ODDS * max(one.prior for one in own) / len(tilts)
        others = [Candidate(tilt, kind, prior) for tilt in tilts]
        yield FindingGroup(group, build_listed(own), (), tuple(others))


def _build_group(
    problem: Problem, effects: Mapping[int, Candidate], members: tuple[int, ...], place: Place
) -> FindingGroup | None:
    mechanisms = [effects[g].mechanism for g in members]
    drivers = frozenset[str]().union(*(mechanism.names() for mechanism in mechanisms))
    is_own = drivers == {f"q{place[0]}"} and is_joint_motion(problem.robot, place)
    if is_own:
        kind = CandidateKind.JOINT_WAVE if place[1] == "rz" else CandidateKind.SLIDE_WAVE
        waves = [wave for m in mechanisms for wave in generate_finer_waves(problem, m)]
        shapes = [(wave, kind) for wave in dict.fromkeys(waves)]
    elif all(map(is_seen_wrongly, mechanisms)):
        fields = generate_distortions(problem, mechanisms[0])
        others = [field for field in fields if field not in mechanisms]
        shapes = [(field, CandidateKind.DISTORTION) for field in others]
    else:
        shapes = _list_shapes(problem, mechanisms, place, drivers)
    steps = list_soft_steps(problem, mechanisms)
    known = {*mechanisms, *(shape for shape, _ in shapes)}
    springs = [m for m in list_springs(problem, place, mechanisms) if m not in known]
    ripples = list_turning_ripples(mechanisms)
    rippling = list_loaded_ripples(problem, mechanisms)
    stepped = list(generate_waves_in_time(problem, place, mechanisms))
    kinks = [] if is_own else list_kinks_together(problem, mechanisms)
    if not any((shapes, steps, springs, ripples, rippling, stepped, kinks)):
        return None
    odds = UNLISTED_ODDS * max(effects[g].prior for g in members)
    weighed = [Candidate(m, kind, odds / len(shapes)) for m, kind in shapes]
    soft = [Candidate(m, CandidateKind.SHAPE, DISTINCT * odds / len(steps)) for m in steps]
    soft += [Candidate(m, CandidateKind.RIPPLE, odds / len(ripples)) for m in ripples]
    soft += [Candidate(m, CandidateKind.STEPPED_WAVE, odds / len(stepped)) for m in stepped]
    soft += [Candidate(m, CandidateKind.KINK, odds / len(kinks)) for m in kinks]
    loaded = [Candidate(m, CandidateKind.SHAPE, odds) for m in springs]
    loaded += [Candidate(m, CandidateKind.RIPPLE, odds) for m in rippling]
    listed = build_listed([effects[g] for g in members])
    if f"torque{place[0]}" in drivers:
        return FindingGroup(members, listed, (*weighed, *soft, *loaded))
    return FindingGroup(members, listed, (*weighed, *soft), tuple(loaded))


def build_listed(effects: Sequence[Candidate]) -> Candidate:
    """Build all of several findings as one candidate."""
    mechanisms = [effect.mechanism for effect in effects]
    terms = {term.key: term for mechanism in mechanisms for term in mechanism.terms}
    name = " & ".join(mechanism.name for mechanism in mechanisms)
    prior = max(effect.prior for effect in effects)
    further = FURTHER ** (len(effects) - 1)
    together = Mechanism(name, tuple(terms.values()))
    return Candidate(together, CandidateKind.SHAPE, prior * further)


def _list_shapes(
    problem: Problem, mechanisms: Sequence[Mechanism], place: Place, drivers: Drivers
) -> list[tuple[Mechanism, CandidateKind]]:
    """List shapes of the drivers of several findings at one place; none where one of these is such."""
    free = list(generate_shapes(problem, {place: drivers}))
    if any(m in free for m in mechanisms):
        return []
    powers = dict.fromkeys(power for m in mechanisms for power in generate_powers(problem, m))
    changing = [one for m in mechanisms for one in generate_changing(problem, m)]
    free += [one for one in changing if one.names() == drivers]
    waves = generate_waves_of(problem, place, drivers)
    is_own = is_own_hysteresis(problem, place, drivers)
    drags = dict.fromkeys(generate_drags_together(problem, place[0], mechanisms) if is_own else ())
    shapes = [(m, CandidateKind.SHAPE) for m in free]
    shapes += [(m, CandidateKind.POWER) for m in powers if m not in mechanisms]
    shapes += [(m, CandidateKind.HYSTERESIS) for m in drags if m not in mechanisms]
    return shapes + [(m, CandidateKind.WAVE) for m in waves if m not in mechanisms]
