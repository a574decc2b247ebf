"""Hysteresis that remembers: a joint whose error depends on what it drags along, wherever it was
before.

Friction winds a drive up over a short way before it slides; then the error stays, until the joint has
turned back by twice that way. A cable is drawn along once its slack is used up. Both are a stop
operator of the joint's motion (Maxwell slip; Krasnosel'skii and Pokrovskii 1989), or what is left of
the reading without it (play)."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from dataclasses import replace

import numpy as np

from ...fitting.problem import Problem
from ...measurements.campaign.state_names import (
    THOUSAND,
    StateKind,
    StateVariable,
    list_widths,
    parse_state_name,
    state_kind,
)
from ...mechanisms.causes import Cause, Named
from ...mechanisms.motors import joint_axis, motor_reading
from ...mechanisms.terms import Mechanism
from ..shapes.distinct_places import Place
from ..shapes.joint_bumps import describe_reading
from ..shapes.unregistered import build_cell

# visits at which a joint is ahead by as much as it can be, and visits at which it is not
MIN_VISITS = 4
# a joint is ahead by as much as it can be, up to this share
FULL = 1 - 1e-6
# by this factor the widths that are looked for are at least apart; up to the other, some stand beside
# one that was found
APART = 1.35
NEAR = 1.5
# what has such errors, as far as is known
DRAWN = ("cable or hose that is drawn along",)
DRAGGED = ("friction before it slides", *DRAWN)
# what a joint's own hysteresis depends on
OWN_KINDS = {StateKind.READING, StateKind.APPROACH, StateKind.MOVE, StateKind.DRAG}


def generate_drags(problem: Problem, joint: int) -> Iterator[Mechanism]:
    """Generate errors of a joint with its lead over what it drags along, and with the way of that: for
    widths that the rows tell from none and from one that is never used up."""
    for width in _thin_out(list_told_widths(problem, joint)):
        yield build_drag(problem, joint, width)
        yield build_drag(problem, joint, width, follows=True)


def build_drag(problem: Problem, joint: int, width: int, follows: bool = False) -> Mechanism:
    """Build a joint's error in proportion to its lead, at most `width` [mrad, of a slide µm], or, where it
    `follows`, to the way of what is drawn along."""
    robot = problem.robot
    unit = robot.unit(joint)
    variable = StateVariable(StateKind.DRAG, joint, width=width)
    lead = Named(variable.name, unit)
    # from being ahead on one side to being ahead on the other
    size = 2 * width / THOUSAND
    over = describe_reading(robot.joints[joint - 1], size, size / 20)
    cause: Cause = lead
    words = f"hysteresis that builds up over {over}"
    sentence = f"by hysteresis that builds up over {over} after each reversal"
    if follows:
        cause = motor_reading(robot, joint) - lead
        words = f"what it draws along with {over} of slack"
        sentence = f"in proportion to the way of what it draws along with {over} of slack"
    told = build_cell(
        place=(joint, joint_axis(robot, joint)),
        causes=(cause,),
        words=words,
        sentence=f"Joint {joint} is off its reading {sentence}",
    )
    return replace(told, usual_causes=DRAWN if follows else DRAGGED)


def list_told_widths(problem: Problem, joint: int) -> list[int]:
    """List the widths that the rows can tell: at some visits the joint is ahead by all of it, at others
    by less."""
    path, places = problem.data.path, problem.data.on_path
    if path is None or places is None:
        return []
    told = []
    visits = np.unique(places)
    for width in list_widths(problem.robot, joint):
        size = width / THOUSAND
        lead = np.abs(path.lead(joint, size)[visits])
        full = int((lead > FULL * size).sum())
        if min(full, len(visits) - full) >= MIN_VISITS:
            told.append(width)
    return told


def _thin_out(widths: Sequence[int]) -> list[int]:
    """Choose widths that are well apart."""
    chosen: list[int] = []
    for width in widths:
        if not chosen or width >= APART * chosen[-1]:
            chosen.append(width)
    return chosen


def is_own_hysteresis(problem: Problem, place: Place, names: Collection[str]) -> bool:
    """Return whether what depends on some names at a place is one joint's motion with how it moved, or
    with its own reading, too."""
    joint, axis = place
    if not names or joint > problem.robot.n or axis != joint_axis(problem.robot, joint):
        return False
    variables = [parse_state_name(name) for name in names]
    own = {one.kind for one in variables if one is not None and one.joint == joint}
    others = [one for one in variables if one is None or one.joint != joint]
    return not others and own <= OWN_KINDS and own != {StateKind.READING}


def generate_drags_instead(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate hysteresis that stands against a finding, but for that of its own form. None for one
    that does not move one joint with how it moved."""
    places = list(found.names_by_place())
    if len(places) != 1 or not is_own_hysteresis(problem, places[0], found.names()):
        return
    joint, _ = places[0]
    form = _read_form(found)
    for drag in generate_drags(problem, joint):
        if _read_form(drag) != form:
            yield drag


def generate_other_widths(problem: Problem, found: Mechanism) -> Iterator[Mechanism]:
    """Generate hysteresis that differs from what was found in its width alone, and not much in that."""
    joint, _ = next(iter(found.names_by_place()))
    known = [parse_state_name(name) for name in found.names()]
    (own,) = [one.width for one in known if one is not None and one.width]
    follows = len(known) > 1
    for width in list_told_widths(problem, joint):
        ratio = width / own
        if width != own and 1 / NEAR < ratio < NEAR:
            yield build_drag(problem, joint, width, follows)


def generate_drags_together(
    problem: Problem, joint: int, found: Sequence[Mechanism]
) -> Iterator[Mechanism]:
    """Generate hysteresis that stands in the place of several findings of a joint: of widths that are
    looked for, and of those between the widths that were found."""
    yield from generate_drags(problem, joint)
    for one in found:
        names = one.names()
        kinds = [state_kind(name) for name in names]
        widths = kinds.count(StateKind.DRAG)
        if widths == 1:
            yield from generate_other_widths(problem, one)


def _read_form(found: Mechanism) -> frozenset[StateKind | None]:
    """Read off the kinds of what something depends on: the same whatever the width."""
    return frozenset(state_kind(name) for name in found.names())
