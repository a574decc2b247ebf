"""Where the numbers of joints stand on the drawing of the arm: each at its own joint, on nothing else. All
in inches of the page."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..._typing import Array

NUMBER_OFFSET = 0.18  # inch from a frame to its number
STEPS_AWAY = (1.0, 1.5, 2.0, 2.6, 3.3)  # of that offset, tried in turn
DIRECTIONS = 16  # tried about a frame
# inch: the picture's edge, a letter's width, a line's height, half a dot
EDGE, LETTER, WORD_HEIGHT, DOT = 0.02, 0.075, 0.13, 0.04
# what a place costs, in inches that it may stand farther away instead: covering what must be read,
# a line across another frame or other words, covering a link or an axis, and another frame as near as its own
COVERED, CROSSED, ON_LINK, ON_AXIS, BESIDE_OTHER = 9.0, 4.0, 1.0, 0.1, 0.6
TURNED = 0.05  # inch: of a place at a right angle to the wanted direction
NEAR = 1.5  # times as far as its own frame: others that are nearer are as near as it
LONGEST_GAP = 0.16  # inch between a number and its frame that needs no line
LEADER_POINTS = 12


class Drawn(NamedTuple):
    """What is drawn [inch]: the frames (m, 2), points along the links and along the dashed axes, and the
    height of the picture."""

    frames: Array
    links: Array
    axes: Array
    top: float


def find_room(
    words: str, place: Array, away: Array, drawn: Drawn, written: Sequence[Array]
) -> Array:
    """Find where words go beside a place: the box (2, 2), low and high corner [inch], that is whole in the
    picture and covers no frame, no other words and if it can be no link; near its own frame rather than
    another."""
    boxes = _list_boxes(words, place, away)
    others = np.reshape(written, (len(written), 2, 2))
    best, least = boxes[0], np.inf
    for box in boxes:
        cost = _weigh_direction(box, place, away)
        cost += _weigh_cover(box, drawn, others)
        # a line makes no box better
        if cost < least:
            cost += _weigh_line(box, place, drawn.frames, others)
        if cost < least:
            best, least = box, cost
    return best


def needs_line(box: Array, place: Array, points: Array) -> bool:
    """Return whether words stand so far from their place, or so near another frame, that a line must tell
    whose they are."""
    gap = _measure_gap(box, place)
    return gap > LONGEST_GAP or _is_beside_other(box, place, points)


def trace_line(box: Array, place: Array) -> Array:
    """Return points along the line from the edge of a frame to its words."""
    end = np.clip(place, *box)
    steps = np.linspace(0, 1, LEADER_POINTS)
    line: Array = place + np.outer(steps, end - place)
    is_outside = np.linalg.norm(line - place, axis=1) > DOT
    shown: Array = line[is_outside]
    return shown


def _list_boxes(words: str, place: Array, away: Array) -> list[Array]:
    """List the boxes about a place, first those in the wanted direction."""
    size = np.array([LETTER * len(words), WORD_HEIGHT])
    half = size / 2
    start = np.arctan2(away[1], away[0])
    angles = start + np.linspace(0, 2 * np.pi, DIRECTIONS, endpoint=False)
    boxes = []
    for step in STEPS_AWAY:
        for angle in angles:
            way = np.array([np.cos(angle), np.sin(angle)])
            centre = place + step * NUMBER_OFFSET * way
            # long words begin or end beside the place
            centre[0] += way[0] * (half[0] - LETTER / 2)
            boxes.append(np.stack([centre - half, centre + half]))
    return boxes


def _weigh_direction(box: Array, place: Array, away: Array) -> float:
    """Return what a box costs for its distance, and for standing elsewhere than in the wanted direction."""
    centre = box.mean(0)
    way = centre - place
    length = max(float(np.linalg.norm(way)), 1e-9)
    turn = 1 - float(way @ away) / length
    return _measure_gap(box, place) + TURNED * turn


def _weigh_cover(box: Array, drawn: Drawn, written: Array) -> float:
    """Return what a box costs for what it covers; `written` (w, 2, 2): other boxes."""
    low, high = box
    top = drawn.top - EDGE
    is_out = low.min() < EDGE or high[1] > top
    if is_out or _covers(box, drawn.frames):
        return COVERED
    if _meets(box, written):
        return COVERED
    cost = 0.0
    if _covers(box, drawn.links):
        cost += ON_LINK
    if _covers(box, drawn.axes):
        cost += ON_AXIS
    return cost


def _weigh_line(box: Array, place: Array, points: Array, written: Array) -> float:
    """Return what a box costs for the line that it needs; nothing where it needs none."""
    if not needs_line(box, place, points):
        return 0.0
    line = trace_line(box, place)[:, None]
    spots = np.stack([line, line])
    others = _list_others(place, points)
    if _covers(spots, others) or _meets(spots, written):
        return CROSSED
    return BESIDE_OTHER


def _is_beside_other(box: Array, place: Array, points: Array) -> bool:
    """Return whether a box is about as near another frame as its own."""
    gap = _measure_gap(box, place)
    others = _list_others(place, points)
    gaps = [_measure_gap(box, other) for other in others]
    nearest = min(gaps, default=np.inf)
    return bool(nearest < NEAR * gap)


def _list_others(place: Array, points: Array) -> Array:
    """Return the frames that are not at a place."""
    away = np.linalg.norm(points - place, axis=1)
    others: Array = points[away > DOT]
    return others


def _measure_gap(box: Array, place: Array) -> float:
    """Return how far a box is from a place; zero within it."""
    nearest = np.clip(place, *box)
    return float(np.linalg.norm(nearest - place))


def _covers(box: Array, points: Array) -> bool:
    """Return whether a box (2, 2), or one of some (2, p, 1, 2), covers one of the points (m, 2)."""
    low, high = box
    is_inside = (points > low - DOT) & (points < high + DOT)
    return bool(is_inside.all(-1).any())


def _meets(box: Array, others: Array) -> bool:
    """Return whether a box (2, 2), or one of some (2, p, 1, 2), meets another one (w, 2, 2)."""
    low, high = box
    is_met = (low < others[:, 1]) & (others[:, 0] < high)
    return bool(is_met.all(-1).any())
