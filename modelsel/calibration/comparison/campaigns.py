"""What changed between two campaigns: parameters that moved beyond their uncertainty, mechanisms
that appeared, disappeared, grew.

Two fits choose their own representatives of what the data cannot tell apart, so neither's
parameters are compared as they stand: both are expressed in one set of representatives on common
configurations (identifiability.Identified.relation), where the difference and its covariance are
tested one by one, corrected for their number (Holm 1979), and all together. What moved is then said in
the fewest terms that explain it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..._short_numbers import round_numbers
from ..._typing import Array, Index
from ...exceptions import StudyError
from ...mechanisms.terms import Term
from ...robot.differences import describe_difference
from ..calibration import Calibration
from ..known_names import Names
from .common_space import CommonSpace, build_common_space
from .difference_tests import (
    SIGNIFICANCE_TOGETHER,
    compute_p_of_each,
    compute_p_together,
    correct_holm,
    open_names,
)
from .ended_steps import settle_steps
from .fewest_terms import Step, select_fewest_terms
from .mechanism_changes import (
    GEOMETRY_NAMES,
    MRAD,
    POWER_QUANTILE,
    SIGNIFICANCE,
    MechanismChange,
    Motions,
    compare_mechanisms,
    two_sided_quantile,
)
from .noise_changes import NoiseChange, find_noise_change
from .target_changes import (
    TargetChange,
    TargetMotion,
    build_motion,
    build_target_changes,
    build_target_groups,
    compute_target_p,
)
from .undeclared_payloads import select_as_by_payload

MAX_DIFFERENCE = 1e-6  # mm, entries of a rotation, kg: between two nominal robots that are one


@dataclass(frozen=True)
class Change:
    """One parameter in both campaigns: values and the difference with its standard error, in the
    term's unit; `p` corrected for the number tested; `moves_mm` what the difference does to the
    target (rms), `turns_mrad` to its orientation, where both campaigns measured that."""

    mechanism: str
    symbol: str
    label: str
    unit: str
    before: float
    after: float
    standard_error: float
    p: float
    moves_mm: float
    turns_mrad: float | None = None


@dataclass(frozen=True)
class Explanation:
    """A change of one term that, with those before it, explains the difference best; the terms
    `alike` would explain it as well."""

    mechanism: str
    symbol: str
    label: str
    unit: str
    by: float
    standard_error: float
    moves_mm: float
    alike: tuple[str, ...]
    turns_mrad: float | None = None


@dataclass(frozen=True)
class Comparison:
    """Two campaigns compared: all parameters tested, the most surprising first; the fewest terms
    that explain what changed; the mechanisms; what could not be compared."""

    changes: tuple[Change, ...]
    explained_by: tuple[Explanation, ...]
    mechanisms: tuple[MechanismChange, ...]
    left_aside: tuple[str, ...]
    # from where a change of a typical, of the worst determined parameter would have been detected
    seen_mm: tuple[float, float] | None
    # between the targets of the two campaigns on the flange, of those that both measured
    targets_apart_mm: float = 0.0
    # names of the targets that the first, and that the second campaign alone measured
    other_targets: tuple[Names, Names] = ((), ())
    # whether the set-up was registered, so that a new placement takes up what is left aside
    registered_again: bool = True
    # of several targets that both campaigns measured: where each sits, and which of them moved
    targets: tuple[TargetChange, ...] = ()
    target_motions: tuple[TargetMotion, ...] = ()
    # that chance alone gives where the targets sit among each other, corrected for the number tested
    targets_among_p: float = 1.0
    noise: NoiseChange | None = None
    # that chance alone gives the difference of all parameters together
    together_p: float = 1.0
    # of the changed mechanisms, those that another payload would change as well
    as_by_payload: tuple[MechanismChange, ...] = ()

    @property
    def moved(self) -> tuple[Change, ...]:
        """The changes beyond chance."""
        moved = []
        for change in self.changes:
            beyond_chance = change.p <= SIGNIFICANCE
            if beyond_chance:
                moved.append(change)
        return tuple(moved)

    @property
    def moved_targets(self) -> tuple[TargetChange, ...]:
        """The targets whose place changed beyond chance."""
        moved = []
        for target in self.targets:
            beyond_chance = target.p <= SIGNIFICANCE
            if beyond_chance:
                moved.append(target)
        return tuple(moved)


def require_same_robot(a: Calibration, b: Calibration) -> None:
    """Raise StudyError where two nominal robots differ."""
    first = a.robot
    second = b.robot
    difference = describe_difference(first, second, MAX_DIFFERENCE)
    if difference is not None:
        raise StudyError(
            f"{first.name} and {second.name} are not the same nominal robot: {difference}. Nothing "
            "can be compared; run both studies with one description of the robot."
        )


def compare_campaigns(a: Calibration, b: Calibration) -> Comparison:
    """Compare campaign b with campaign a, on configurations that both have seen: the arm as it stood
    at the beginning of b with the arm as it stood at the end of a. Raises StudyError."""
    require_same_robot(a, b)
    ended = settle_steps(a, at_end=True)
    begun = settle_steps(b, at_end=False)
    space = build_common_space(ended, begun)
    motions = Motions(
        space.campaigns,
        space.terms,
        space.theta,
        space.factors,
        space.X,
        space.turns,
        _error_ratio(space, _select_tested(space)),
    )
    space = open_names(space, motions)
    tested = _select_tested(space)
    own = np.isin(space.kept[tested], space.offsets)
    of_arm = tested[~own]
    p_of_arm = compute_p_of_each(space, of_arm)
    p_of_targets = compute_target_p(space)
    p = correct_holm(np.concatenate([p_of_arm, p_of_targets]))
    changes = _list_changes(space, of_arm, p[: len(of_arm)])
    targets = build_target_changes(space, p[len(of_arm) :], len(p))
    together = compute_p_together(space, tested)
    significant = together <= SIGNIFICANCE_TOGETHER or p.min(initial=1.0) <= SIGNIFICANCE
    explained, motions_of_targets = _explain(space, tested) if significant else ((), ())
    moved = {explanation.mechanism for explanation in explained}
    mechanisms = compare_mechanisms(motions, moved)
    return Comparison(
        changes,
        explained,
        mechanisms,
        tuple(term.symbol for term in space.placing),
        _find_detectable_range(space, of_arm, len(p)),
        _measure_targets(space),
        (space.targets.only_first, space.targets.only_second),
        a.registered or b.registered,
        targets,
        motions_of_targets,
        float(p[-1]) if targets else 1.0,
        find_noise_change(a.floor, b.floor),
        together,
        select_as_by_payload(mechanisms, (a, b)),
    )


def _measure_targets(space: CommonSpace) -> float:
    """Return how far the targets that both campaigns measured are apart [mm], at most."""
    first, second = space.campaigns
    shared = space.targets.shared
    before = first.tools[shared]
    after = second.tools[shared]
    distances = np.linalg.norm(after - before, axis=1)
    largest = distances.max(initial=0.0)
    return float(largest)


def _select_tested(space: CommonSpace) -> Index:
    """Select the representatives that both campaigns fitted and the data determine."""
    comparable = []
    for place in space.kept:
        term = space.terms[place]
        is_comparable = space.is_comparable(term)
        comparable.append(is_comparable)
    determined = space.standard_errors > 0
    comparable_places = np.array(comparable, dtype=bool)
    return np.flatnonzero(comparable_places & determined)


def _list_changes(space: CommonSpace, tested: Index, p: Array) -> tuple[Change, ...]:
    """List every representative tested, with its corrected p, the most surprising first."""
    changes = []
    tests = zip(tested, p.tolist(), strict=True)
    for i, corrected in tests:
        change = _build_change(space, i, corrected)
        changes.append(change)

    def surprise(change: Change) -> tuple[float, float]:
        difference = change.after - change.before
        size = abs(difference)
        return change.p, -size / change.standard_error

    changes.sort(key=surprise)
    return tuple(changes)


def _build_change(space: CommonSpace, i: int, p: float) -> Change:
    place = space.kept[i]
    term = space.terms[place]
    before, after = space.estimates[:, i].tolist()
    error = space.standard_errors[i]
    difference = abs(space.difference[i])
    moves_mm = difference * space.displacement[place]
    return Change(
        mechanism=space.owner[term.key],
        symbol=term.symbol,
        label=_label_term(space.owner[term.key], term),
        unit=term.unit,
        before=before,
        after=after,
        standard_error=float(error),
        p=p,
        moves_mm=float(moves_mm),
        turns_mrad=_measure_turn(space, place, difference),
    )


def _measure_turn(space: CommonSpace, place: int, change: float) -> float | None:
    """Measure the rms turn [mrad] of the target by a change of a term; None where orientations are
    not compared."""
    if not space.turns.size:
        return None
    turn = change * space.turning[place] * MRAD
    return float(turn)


def _explain(
    space: CommonSpace, tested: Index
) -> tuple[tuple[Explanation, ...], tuple[TargetMotion, ...]]:
    """Explain the difference by the fewest terms that both campaigns fitted, and motions of several
    targets: terms, motions."""
    groups = build_target_groups(space)
    places = []
    for place, term in enumerate(space.terms):
        # several targets move as they do, not along one axis of the flange
        is_group = bool(groups) and _shifts_target(space, term)
        if space.is_comparable(term) and not is_group:
            places.append(place)
    relation = space.relation[:, tested]
    of_groups = [group.of_terms @ relation for group in groups]
    alone = [k for k, group in enumerate(groups) if not group.together]
    difference = space.difference[tested]
    factor = space.difference_factor[tested]
    moves = space.whole_displacement[places]
    steps = select_fewest_terms(difference, factor, relation[places], of_groups, alone, moves)
    terms = [space.terms[place] for place in places]
    labels = [_label_term(space.owner[term.key], term) for term in terms]
    labels += [group.label for group in groups]
    explanations = []
    motions = []
    for step in steps:
        alike = _list_alike(labels, step)
        if step.term < len(terms):
            place = places[step.term]
            explanation = _build_explanation(space, place, step, alike)
            explanations.append(explanation)
        else:
            group = groups[step.term - len(terms)]
            motion = build_motion(space, group, step, alike)
            motions.append(motion)
    explanations.sort(key=lambda explanation: -explanation.moves_mm)
    return tuple(explanations), tuple(motions)


def _list_alike(labels: list[str], step: Step) -> tuple[str, ...]:
    """List what would explain a difference as well as a step, each once."""
    own = labels[step.term]
    alike = list[str]()
    for place in step.alike:
        label = labels[place]
        if label != own and label not in alike:
            alike.append(label)
    return tuple(alike)


def _shifts_target(space: CommonSpace, term: Term) -> bool:
    """Whether a term only shifts targets on the flange."""
    flange = space.campaigns[0].robot.n + 1
    first, *others = term.screws
    kind = first.axis[0]
    names = first.cause.names()
    is_shift = first.frame == flange and kind == "t"
    is_constant = names <= {"target"}
    return is_shift and is_constant and not others


def _build_explanation(
    space: CommonSpace, place: int, step: Step, alike: tuple[str, ...]
) -> Explanation:
    term = space.terms[place]
    change = abs(step.change)
    moves_mm = change * space.displacement[place]
    return Explanation(
        mechanism=space.owner[term.key],
        symbol=term.symbol,
        label=_label_term(space.owner[term.key], term),
        unit=term.unit,
        by=step.change,
        standard_error=step.standard_error,
        moves_mm=float(moves_mm),
        alike=alike,
        turns_mrad=_measure_turn(space, place, change),
    )


def _label_term(mechanism: str, term: Term) -> str:
    """Name a parameter by its place in the arm: γ3 (frame 3 rz); one that is not of the geometry by
    its mechanism: h2 (joint2-twist)."""
    where = round_numbers(mechanism)
    if mechanism in GEOMETRY_NAMES:
        first, *_ = term.screws
        where = f"frame {first.frame} {first.axis}"
    return f"{term.symbol} ({where})"


def _error_ratio(space: CommonSpace, tested: Index) -> float:
    """Return the second campaign's standard errors over the first's, in the median of the
    parameters that neither knows exactly; 1 where there are none."""
    relation = space.relation.T[tested]
    errors = []
    for factor in space.factors:
        own = np.linalg.norm(relation @ factor, axis=1)
        errors.append(own)
    first, second = errors
    uncertain = (first > 0) & (second > 0)
    if not uncertain.any():
        return 1.0
    ratios = second[uncertain] / first[uncertain]
    ratio = np.median(ratios)
    return float(ratio)


def _find_detectable_range(
    space: CommonSpace, tested: Index, count: int
) -> tuple[float, float] | None:
    """Return the rms displacements [mm] from which a change of a typical (median) and of the worst
    determined parameter would have been detected among `count` tests; None where none is tested."""
    if not len(tested):
        return None
    quantile = two_sided_quantile(SIGNIFICANCE / count)
    quantile += POWER_QUANTILE
    places = space.kept[tested]
    displacement = space.displacement[places]
    errors = space.standard_errors[tested]
    does_move = displacement > 0
    least = quantile * errors[does_move] * displacement[does_move]
    if not len(least):
        return None
    typical = float(np.median(least))
    worst = float(least.max())
    return typical, worst
