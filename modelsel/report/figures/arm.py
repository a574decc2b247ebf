"""This arm, drawn: its frames numbered with the axes that symbols speak of, and the places that
findings name. All in inches of the page, seen from afar."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from textwrap import wrap
from typing import Any

import numpy as np

from ..._typing import Array
from ...results.schemas.details_schema import ArmRecord
from ..style import BLUE, INK, ORANGE, QUIET, WIDTH, shorten_clause, svg, use_style
from .arm_numbers import Drawn, find_room, needs_line, trace_line

ELEVATION = 24.0  # degrees
AZIMUTHS = np.arange(-160.0, 180.0, 10.0)
LONGEST_MARK = 58  # letters
FRAMES_HEIGHT, MARKED_HEIGHT = 2.2, 1.75  # inch
ARM_WIDTH = 2.9  # inch
MARGIN = 0.34  # inch about the arm
LABEL_ROOM = 0.4  # inch for a word right of it
PEDESTAL = 0.22  # inch below frame 0
LINE_POINTS = 25  # of a link or an axis, that no words may cover
MARKED_TOGETHER = 0.3  # inch below which frames share a row of marks
# inch below which frames stand at one point of the picture: a circle's width
SAME_POINT = 0.07
AXIS_LENGTH = 0.26  # inch: of half a dashed axis
MARK = 0.08  # inch: half a mark
MARK_STEP = 0.17  # inch from one mark to the next
MARK_AWAY = 0.24  # inch from a frame to its marks
LARGEST_LINE = 0.25  # inch between the lines of a list
TRIAD_COLUMNS, MANY_COLUMNS = 4, 5  # triads in a row; of more than two such rows
TRIAD_ROW = 1.1  # inch that a triad needs with its name
TRIAD = 0.27  # inch: an axis of a triad
AXIS_COLOURS = (ORANGE, QUIET, BLUE)
LETTERS_APART = 0.1  # inch between the names of two axes
HIDDEN = 0.2  # share of an axis below which it points at the reader


@dataclass(frozen=True, eq=False)
class _Drawing:
    """The arm in the picture: points (n+2, 2) [inch], the view, the axes, which joints slide."""

    points: Array
    view: Array
    axes: Array
    slides: Sequence[bool]

    @property
    def last(self) -> int:
        """The target's place among the points."""
        return len(self.points) - 1

    def find_axis_ends(self, frame: int) -> Array:
        """Return the ends (2, 2) of the dashed axis of a joint."""
        z = self.axes[frame][:, 2]
        along = AXIS_LENGTH * (self.view @ z)[:2]
        place = self.points[frame]
        return np.stack([place - along, place + along])

    def list_drawn(self, top: float) -> Drawn:
        """List what no words may cover in a picture of some height: frames, links and axes."""
        foot = self.points[0] - np.array([0.0, PEDESTAL])
        chain = np.vstack([foot, self.points])
        links = [_trace(start, end) for start, end in pairwise(chain)]
        joints = range(1, self.last)
        axes = [_trace(*self.find_axis_ends(frame)) for frame in joints]
        return Drawn(self.points, np.concatenate(links), np.concatenate(axes), top)

    def group_frames(self, within: float = SAME_POINT) -> list[list[int]]:
        """Group the frames that stand within some inches of each other, in their order."""
        groups: list[list[int]] = []
        for frame in range(1, len(self.points)):
            for group in groups:
                if np.linalg.norm(self.points[group[0]] - self.points[frame]) < within:
                    group.append(frame)
                    break
            else:
                groups.append([frame])
        return groups

    def point_away(self, group: Sequence[int]) -> tuple[Array, Array]:
        """Return where a group stands, and the direction from the arm's middle to it."""
        place = self.points[list(group)].mean(0)
        away = place - self.points.mean(0)
        return place, away / max(float(np.linalg.norm(away)), 1e-9)


def _trace(start: Array, end: Array) -> Array:
    """Return points close together from one point to another."""
    steps = np.linspace(0, 1, LINE_POINTS)
    return start + np.outer(steps, end - start)


def draw_frames(arm: ArmRecord) -> bytes:
    """Draw the arm with its frames numbered, and beside it the axes of every frame in the same view."""
    frames = len(arm.origins_mm) - 1
    columns = TRIAD_COLUMNS if frames <= 2 * TRIAD_COLUMNS else MANY_COLUMNS
    lines = -(-frames // columns)
    sheet = max(FRAMES_HEIGHT, TRIAD_ROW * lines)
    drawing = _place_arm(arm, sheet)
    width, height = (WIDTH - ARM_WIDTH) / columns, sheet / lines
    with use_style() as sheets:
        fig, ax = _open_sheet(sheets, sheet)
        _draw_chain(ax, drawing)
        for frame in range(1, len(drawing.points)):
            row, column = divmod(frame - 1, columns)
            place = (ARM_WIDTH + (column + 0.5) * width, sheet - (row + 0.45) * height)
            name = "target" if frame == drawing.last else f"frame {frame}"
            _draw_triad(ax, np.array(place), drawing.view @ drawing.axes[frame], name)
        _write_numbers(ax, drawing)
        return svg(fig, "The arm with its frames")


def draw_marked(arm: ArmRecord, marks: Sequence[tuple[str, str, Sequence[int]]]) -> bytes:
    """Draw the arm; each mark (number, what, frames) as its number at the frames, and what in a list."""
    drawing = _place_arm(arm, MARKED_HEIGHT)
    step = min(LARGEST_LINE, (MARKED_HEIGHT - 0.2) / max(len(marks), 1))
    top = MARKED_HEIGHT / 2 + step * (len(marks) - 1) / 2
    with use_style() as sheets:
        fig, ax = _open_sheet(sheets, MARKED_HEIGHT)
        _draw_chain(ax, drawing)
        taken = _draw_marks(ax, drawing, marks)
        _write_numbers(ax, drawing, taken)
        for line, (number, what, _) in enumerate(marks):
            y = top - step * line
            _draw_mark(ax, (ARM_WIDTH + 0.2, y), number)
            words = (
                _break_words(what) if step >= LARGEST_LINE else shorten_clause(what, LONGEST_MARK)
            )
            ax.text(ARM_WIDTH + 0.36, y, words, fontsize=7, va="center", color=INK)
        return svg(fig, "The arm with what was found")


def _break_words(what: str) -> str:
    """Return a sentence in two lines at most."""
    lines = wrap(shorten_clause(what, 2 * LONGEST_MARK - 8), LONGEST_MARK)
    return "\n".join(lines[:2])


def _open_sheet(sheets: Any, height: float) -> tuple[Any, Any]:
    """Open a picture whose coordinates are inches."""
    fig = sheets.figure(figsize=(WIDTH, height))
    ax = fig.add_axes((0.0, 0.0, 1.0, 1.0))
    ax.set_xlim(0, WIDTH)
    ax.set_ylim(0, height)
    ax.set_axis_off()
    return fig, ax


# -- the arm
# --------------------------------------------------------------------------------------------------


def _place_arm(arm: ArmRecord, height: float) -> _Drawing:
    """Place the arm in the left of a picture of some height, as large as it fits."""
    view = choose_view(arm)
    seen = (np.array(arm.origins_mm) @ view.T)[:, :2]
    low, span = seen.min(0), np.maximum(np.ptp(seen, axis=0), 1e-6)
    room = np.array([ARM_WIDTH - LABEL_ROOM, height]) - 2 * MARGIN
    scale = float((room / span).min())
    corner = MARGIN + (room - scale * span) / 2
    return _Drawing(corner + scale * (seen - low), view, np.array(arm.axes), arm.slides)


def choose_view(arm: ArmRecord) -> Array:
    """Choose from where the arm is seen: rows of (3, 3) are right, up and towards the reader. The azimuth
    shows most of the links and of the axes."""
    origins, axes = np.array(arm.origins_mm), np.array(arm.axes)
    views = [_view(azimuth) for azimuth in AZIMUTHS]
    shares = [_measure_seen(origins, axes, view) for view in views]
    return views[int(np.argmax(shares))]


def _view(azimuth: float) -> Array:
    turn, tilt = np.radians(azimuth), np.radians(ELEVATION)
    right = np.array([-np.sin(turn), np.cos(turn), 0.0])
    level = np.array([np.cos(turn), np.sin(turn), 0.0])
    towards = np.cos(tilt) * level + np.sin(tilt) * np.array([0.0, 0.0, 1.0])
    return np.stack([right, np.cross(towards, right), towards])


def _measure_seen(origins: Array, axes: Array, view: Array) -> float:
    """Return how much of the links' lengths is seen, times how much of each frame's shortest axis."""
    steps = np.diff(origins, axis=0)
    lengths = np.linalg.norm(steps, axis=1).sum()
    seen = np.linalg.norm(steps @ view[:2].T, axis=1).sum()
    shown = np.linalg.norm(view[:2] @ axes, axis=1).min(1)
    return float(seen / max(lengths, 1e-9) * (0.3 + shown.mean()))


def _draw_chain(ax: Any, drawing: _Drawing) -> None:
    """Draw links, joint axes and numbers."""
    points = drawing.points
    links = {"color": "#C9CED3", "solid_capstyle": "round", "solid_joinstyle": "round"}
    ax.plot(*points.T, lw=7, zorder=1, **links)
    foot = points[0] - np.array([0.0, PEDESTAL])
    ax.plot(*np.stack([points[0], foot]).T, lw=7, zorder=1, **links)
    ground = foot + np.array([[-0.2, 0.0], [0.2, 0.0]])
    ax.plot(*ground.T, color=QUIET, lw=2, zorder=1)
    for frame, slides in enumerate(drawing.slides, 1):
        ends = drawing.find_axis_ends(frame)
        ax.plot(*ends.T, color=BLUE, lw=0.9, ls=(0, (5, 2)), zorder=2)
        shape = "s" if slides else "o"
        ax.plot(*points[frame], shape, ms=5, mfc="white", mec=INK, mew=1.1, zorder=3)
    ax.plot(*points[drawing.last], "o", ms=4.5, color=INK, zorder=3)


def _write_numbers(ax: Any, drawing: _Drawing, taken: Sequence[Array] = ()) -> None:
    """Write the numbers of the frames beside them, away from the arm's middle, where nothing else stands, with
    a line to those that are near others; boxes that are `taken` stay free."""
    written = list(taken)
    drawn = drawing.list_drawn(ax.get_ylim()[1])
    for group in drawing.group_frames():
        names = ["target" if frame == drawing.last else str(frame) for frame in group]
        words = ", ".join(names)
        place, away = drawing.point_away(group)
        box = find_room(words, place, away, drawn, written)
        written.append(box)
        if needs_line(box, place, drawing.points):
            line = trace_line(box, place)
            ax.plot(*line.T, color=QUIET, lw=0.6, zorder=3)
            # no other words on it
            written += [np.stack([point, point]) for point in line]
        style = {"fontsize": 8, "fontweight": "bold", "color": INK, "zorder": 4}
        ax.text(*box.mean(0), words, ha="center", va="center", **style)


# -- axes
# --------------------------------------------------------------------------------------------------


def _draw_triad(ax: Any, place: Array, seen: Array, name: str) -> None:
    """Draw the axes of one frame as the reader sees them: `seen` (3, 3), columns x y z."""
    ends: list[Array] = []
    for letter, colour, axis in zip("xyz", AXIS_COLOURS, seen.T, strict=True):
        length = float(np.hypot(*axis[:2]))
        if length < HIDDEN:
            _draw_hidden(ax, place, colour, axis[2] > 0)
            end = place + np.array([0.09, -0.11])
        else:
            end = place + (TRIAD + 0.09 / length) * axis[:2]
            tip = place + TRIAD * axis[:2]
            arrow = {"arrowstyle": "-|>", "color": colour, "lw": 1.6, "mutation_scale": 7}
            ax.annotate("", tip, place, arrowprops=arrow | {"shrinkA": 0, "shrinkB": 0})
        end = _keep_apart(end, place, ends)
        ends.append(end)
        ax.text(*end, letter, color=colour, fontsize=8, ha="center", va="center")
    ax.text(place[0], place[1] - 0.5, name, ha="center", va="center", fontsize=7.5, color=INK)


def _keep_apart(end: Array, place: Array, others: Sequence[Array]) -> Array:
    """Return where the name of an axis stands: farther along it where other names are too near."""
    way = end - place
    step = LETTERS_APART * way / np.linalg.norm(way)
    for _ in others:
        gaps = [np.linalg.norm(end - other) for other in others]
        if min(gaps) < LETTERS_APART:
            end = end + step
    return end


def _draw_hidden(ax: Any, place: Array, colour: str, is_towards: bool) -> None:
    """Draw an axis that points at the reader as a dot in a circle, one that points away as a cross."""
    ax.plot(*place, "o", ms=8, mfc="white", mec=colour, mew=1, zorder=3)
    ax.plot(*place, "." if is_towards else "x", ms=4, color=colour, zorder=4)


# -- marks
# --------------------------------------------------------------------------------------------------


def _draw_marks(
    ax: Any, drawing: _Drawing, marks: Sequence[tuple[str, str, Sequence[int]]]
) -> list[Array]:
    """Ring the frames of every mark, and write the numbers of marks at one point in a row beside it. Returns
    the boxes of the numbers."""
    taken: list[Array] = []
    groups = [[0], *drawing.group_frames(MARKED_TOGETHER)]
    for group in groups:
        place, away = drawing.point_away(group)
        numbers = [number for number, _, frames in marks if set(frames) & set(group)]
        for frame in {frame for *_, frames in marks for frame in frames if frame in group}:
            ax.plot(*drawing.points[frame], "o", ms=9, mfc="none", mec=ORANGE, mew=1.4, zorder=5)
        for centre, number in zip(
            _place_row(place, away, len(numbers), taken), numbers, strict=True
        ):
            _draw_mark(ax, centre, number)
            taken.append(np.stack([centre - MARK, centre + MARK]))
    return taken


def _place_row(place: Array, away: Array, count: int, taken: Sequence[Array]) -> list[Array]:
    """Place a row of marks beside a point, on the arm's side of it if boxes that are `taken` leave room
    there, else elsewhere about it."""
    side = -1.0 if away[0] > 0 else 1.0
    above = MARK_AWAY if away[1] < 0.5 else -MARK_AWAY
    rows = []
    for beside, higher in ((0.02, above), (0.02, -above), (MARK_AWAY, 0.0), (-MARK_AWAY, 0.0)):
        across = beside * side
        start = place + np.array([across, higher])
        step = np.copysign(MARK_STEP, across)
        row = [start + np.array([k * step, 0.0]) for k in range(count)]
        rows.append(row)
    for row in rows:
        blocked = [_is_on(centre, taken) for centre in row]
        if not any(blocked):
            return row
    return rows[0]


def _is_on(centre: Array, taken: Sequence[Array]) -> bool:
    """Whether a mark would touch a box."""
    for box in taken:
        apart = np.abs(centre - box.mean(0))
        if apart.max() < 2 * MARK:
            return True
    return False


def _draw_mark(ax: Any, place: Any, number: str) -> None:
    x, y = place
    ax.plot(x, y, "o", ms=10, color=ORANGE, mew=0, zorder=6)
    style = {"fontsize": 7, "fontweight": "bold", "ha": "center", "va": "center_baseline"}
    ax.text(x, y, number, color="white", zorder=7, **style)
