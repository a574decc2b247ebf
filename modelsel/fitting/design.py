"""Design matrix of any model: screw field x causes, in whitened blocks, at the nominal or at a
fitted point.

Arrays keep configurations last: columns (p, c, m), residuals (c, m); reshaped to (p, c·m) a block
is a Fortran-ordered matrix without a copy."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from .._typing import Array
from ..mechanisms.causes import ONE, Member
from ..mechanisms.terms import FIXTURE_AXES, Mechanism, Screw, Term, terms_of
from ..robot._kernels import Frame, Workspace, fill_screw_field
from ..robot.kinematics import Pose, walk
from ..robot.rigid import AXES, rotation_vector
from .observation import gradients, predicted
from .problem import Problem

PLACE = {axis: a for a, axis in enumerate(AXES)}


@dataclass(frozen=True)
class Model:
    """A candidate model: mechanisms, in order; terms they share are fitted once."""

    mechanisms: tuple[Mechanism, ...]

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The fitted numbers."""
        return terms_of(self.mechanisms)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the mechanisms."""
        return tuple(m.name for m in self.mechanisms)

    def __add__(self, more: Sequence[Mechanism]) -> Model:
        return Model((*self.mechanisms, *(m for m in more if m not in self.mechanisms)))


def twist_of(problem: Problem, terms: Sequence[Term], theta: Array, rows: slice) -> Array:
    """Entries (n+1, 6, rows) of every frame's H at parameters theta (p,)."""
    out = np.zeros((problem.robot.n + 1, 6, rows.stop - rows.start))
    for value, term in zip(theta, terms, strict=True):
        if value and not term.fixture:
            for s in term.screws:
                out[s.frame - 1, PLACE[s.axis]] += value * _rows(problem.cause(s.cause), rows)
    return out


def _rows(cause: Array | float, rows: slice) -> Array | float:
    return cause if isinstance(cause, float) else cause[rows]


def whiten(problem: Problem, values: Array) -> Array:
    """Values (..., c, m) in units of their standard uncertainty; in place where one weight does."""
    if isinstance(problem.whiten, float):
        if problem.whiten != 1.0:
            values *= problem.whiten
        return values
    return np.asarray(np.einsum("mij,...jm->...im", problem.whiten, values))


def _start(problem: Problem, rows: slice) -> Frame:
    """Frame 0 as the tracker sees it, at these rows."""
    R, t = problem.placement
    if len(R) == 1:
        return R[0].T[:, :, None], t[0][:, None]
    group = problem.data.group[rows]
    return np.ascontiguousarray(R[group].transpose(2, 1, 0)), np.ascontiguousarray(t[group].T)


def _tool(problem: Problem, rows: slice) -> Array:
    return problem.tools[0] if len(problem.tools) == 1 else problem.tool[rows]


def _residual(problem: Problem, at: Frame, rows: slice, out: Array) -> None:
    """Measured minus predicted into out (c, rows): mm, and with orientations the rotation vector
    [rad], in the tracker's frame; `at` is the target's frame."""
    data = problem.data
    np.subtract(data.position[rows].T, at[1], out=out[:3])
    if data.rotation is not None and problem.tool_rotations is not None:
        predicted = np.einsum("jim,mjk->mik", at[0], problem.tool_rotations[data.target[rows]])
        out[3:] = rotation_vector(np.einsum("mij,mkj->mik", data.rotation[rows], predicted)).T


def assemble(
    problem: Problem,
    terms: Sequence[Term],
    at: tuple[Sequence[Term], Array] | None = None,
    rows: slice | None = None,
    space: Workspace | None = None,
) -> Array:
    """[columns | residual] (p+1, c, rows) of some rows, not whitened, linearised at the fitted
    point `at` (terms, theta) or at the nominal model. With `space` the array is overwritten by the
    next call."""
    rows, space = rows or slice(0, len(problem)), space or Workspace()
    if problem.data.gauges is not None:
        return _gauged(problem, terms, at, rows, space)
    m, n, c, p = rows.stop - rows.start, problem.robot.n, problem.components, len(terms)
    twist = None if at is None else twist_of(problem, *at, rows)
    first, stop = space.once(
        "run", terms, _run
    )  # the screw field stands where these columns do: nothing is copied
    out = space.array("design", max(p, first + 6 * n + 6) + 1, c, m)
    field, origins = (
        out[first : first + 6 * n + 6].reshape(n + 1, 6, c, m),
        space.array("origins", n + 1, 3, m),
    )
    into = field[:, :, :3], origins
    seen = walk(
        problem.robot,
        problem.data.q[rows],
        _tool(problem, rows),
        into,
        twist,
        _start(problem, rows),
        space,
    )
    _residual(problem, seen, rows, out[-1])
    fill_screw_field(field, origins, origins[-1], twist is not None, space)
    _products(problem, field, terms[:first], rows, out[:first], space)
    covered = min(p, first + 6 * n + 6)  # the field is read before it is overwritten
    others = space.array("others", max(covered - stop, 0), c, m)
    _products(problem, field, terms[stop:covered], rows, others, space)
    _products(problem, field, terms[covered:], rows, out[covered:p], space)
    out[stop:covered] = others
    out[p] = out[-1]
    return out[: p + 1]


def _arm(terms: Sequence[Term], theta: Array) -> tuple[tuple[Term, ...], Array]:
    """The terms that move the arm, and their values."""
    some = [k for k, t in enumerate(terms) if not t.fixture]
    return tuple(terms[k] for k in some), theta[some]


def fixture_values(count: int, terms: Sequence[Term], theta: Array) -> Array:
    """(..., F, 7) changes of the features' numbers at parameters theta (..., p)."""
    out = np.zeros((*theta.shape[:-1], count, len(FIXTURE_AXES)))
    for k, term in enumerate(terms):
        if term.fixture:
            for s in term.screws:
                out[..., _feature(s), FIXTURE_AXES.index(s.axis)] += theta[..., k]
    return out


def _feature(screw: Screw) -> int:
    assert isinstance(screw.cause, Member)
    return screw.cause.index


def _gauged(
    problem: Problem,
    terms: Sequence[Term],
    at: tuple[Sequence[Term], Array] | None,
    rows: slice,
    space: Workspace,
) -> Array:
    """`assemble` where not every row is a point: the target's own three rows of the design, turned
    into the row's by its gradient, less those of the configuration where a distance begins; the
    features' numbers beside them."""
    gauges, own = problem.data.gauges, [k for k, t in enumerate(terms) if not t.fixture]
    measured = problem.measured
    assert gauges is not None
    assert measured is not None
    gauges, arm = gauges.take(rows), tuple(terms[k] for k in own)
    values = fixture_values(len(gauges.features), *(((), np.zeros(0)) if at is None else at))
    point = None if at is None else _arm(*at)
    block = assemble(problem.bare, arm, point, rows, space)
    x, start = -block[-1, :3], None
    out = np.zeros((len(terms) + 1, *block.shape[1:]))
    out[-1] = block[-1]
    other = (
        None if problem.origin is None else assemble(problem.origin, arm, point, rows, Workspace())
    )
    if other is not None:
        start = -other[-1, :3]
    G, E = gradients(gauges, problem.fixtures, values, x, start)
    out[own, :3] = np.einsum("ijm,pjm->pim", G, block[:-1, :3])
    out[own, 3:] = block[:-1, 3:]
    if other is not None:
        out[own, :3] -= np.einsum("ijm,pjm->pim", G * gauges.of("distance"), other[:-1, :3])
    out[-1, :3] = problem.readings[:, rows] - predicted(gauges, problem.fixtures, values, x, start)
    for k, term in enumerate(terms):
        if term.fixture:
            for s in term.screws:
                out[k, :3] += E[FIXTURE_AXES.index(s.axis)] * _rows(problem.cause(s.cause), rows)
    out *= measured[rows].T
    return out


def field_of(problem: Problem, at: Pose, rows: slice) -> Array:
    """Screw field (n+1, 6, c, rows) of a pose in the tracker's frame: mm (and rad of the target
    frame) per unit screw."""
    R = problem.placement[0][problem.data.group[rows]]
    moved: Array = np.einsum("mij,fajm->faim", R, at.displacement())
    if problem.data.gauges is not None:
        G = (
            directions(problem, at, rows) * ~problem.data.gauges.of("distance")[rows]
        )  # which has no place of its own
        moved = np.einsum("ijm,fajm->faim", G, moved)
    if problem.components == 3:
        return moved
    turned = np.zeros_like(moved)
    turned[:, 3:] = np.einsum("mij,fajm->faim", R, at.axes[:, 3:])
    return np.concatenate([moved, turned], axis=2)


def directions(problem: Problem, at: Pose, rows: slice) -> Array:
    """(3, 3, rows) what the rows see of the target's displacement at a pose, in the tracker's
    frame."""
    R, t = (
        problem.placement[0][problem.data.group[rows]],
        problem.placement[1][problem.data.group[rows]],
    )
    gauges = problem.data.gauges
    if gauges is None:
        return np.tile(np.eye(3)[:, :, None], (1, 1, len(R)))
    gauges = gauges.take(rows)
    x = np.einsum("mij,jm->im", R, at.target) + t.T
    G, _ = gradients(
        gauges, problem.fixtures, np.zeros((len(gauges.features), len(FIXTURE_AXES))), x, None
    )
    return G


def columns_of(problem: Problem, field: Array, terms: Sequence[Term], rows: slice) -> Array:
    """Columns (p, c, rows) of terms from a screw field."""
    out = np.empty((len(terms), *field.shape[2:]))
    _products(problem, field, terms, rows, out, Workspace())
    return out


def _run(terms: Sequence[Term]) -> tuple[int, int]:
    """(start, stop) of the first run of terms that are the screw field's own entries, in its order
    from frame 1."""

    def is_entry(term: Term, k: int) -> bool:
        screw = term.screws[0]
        return (len(term.screws), screw.frame, screw.axis) == (
            1,
            k // 6 + 1,
            AXES[k % 6],
        ) and screw.cause == ONE

    start = next((k for k, term in enumerate(terms) if is_entry(term, 0)), 0)
    stop = start
    while stop < len(terms) and is_entry(terms[stop], stop - start):
        stop += 1
    return start, stop


def _products(
    problem: Problem, field: Array, terms: Sequence[Term], rows: slice, out: Array, space: Workspace
) -> None:
    """Columns of terms, screw field times cause, into out (len(terms), c, rows)."""
    scaled = space.array("scaled", *out.shape[1:])
    for column, term in zip(out, terms, strict=True):
        if term.fixture:  # rows that are points see no feature
            column[:] = 0.0
            continue
        first, *others = term.screws
        np.multiply(
            field[first.frame - 1, PLACE[first.axis]],
            _rows(problem.cause(first.cause), rows),
            out=column,
        )
        for s in others:
            np.multiply(
                field[s.frame - 1, PLACE[s.axis]], _rows(problem.cause(s.cause), rows), out=scaled
            )
            np.add(column, scaled, out=column)


def residuals(problem: Problem, terms: Sequence[Term] = (), theta: Array | None = None) -> Array:
    """Exact residuals (m, c) [mm, rad], not whitened, at parameters theta; the nominal model
    without."""
    out, space = np.empty((len(problem), problem.components)), Workspace()
    if problem.data.gauges is not None:
        return _gauged_residuals(problem, terms, np.zeros(len(terms)) if theta is None else theta)
    for rows, part in problem.parts():
        every, frames, m = slice(0, len(part)), problem.robot.n + 1, len(part)
        twist = None if theta is None else twist_of(part, terms, theta, every)
        axes, origins = space.array("axes", frames, 6, 3, m), space.array("origins", frames, 3, m)
        seen = walk(
            problem.robot,
            part.data.q,
            _tool(part, every),
            (axes, origins),
            twist,
            _start(part, every),
            space,
        )
        _residual(part, seen, every, out[rows].T)
    return out


def _gauged_residuals(problem: Problem, terms: Sequence[Term], theta: Array) -> Array:
    """`residuals` where not every row is a point."""
    gauges, measured = problem.data.gauges, problem.measured
    assert gauges is not None
    assert measured is not None
    arm, own = _arm(terms, theta)
    out = residuals(problem.bare, arm, own)
    start = None if problem.origin is None else -residuals(problem.origin, arm, own)[:, :3].T
    values = fixture_values(len(gauges.features), terms, theta)
    out[:, :3] = (
        problem.readings - predicted(gauges, problem.fixtures, values, -out[:, :3].T, start)
    ).T
    return np.asarray(np.where(measured, out, 0.0))


def whitened(problem: Problem, residual: Array) -> Array:
    """Residuals (m, c) in units of their standard uncertainty, (m, c)."""
    return np.asarray(whiten(problem, residual.T.copy()).T)


def blocks(
    problem: Problem, terms: Sequence[Term], at: tuple[Sequence[Term], Array] | None = None
) -> Iterator[tuple[slice, Array, Array]]:
    """(rows, whitened columns (p, c, rows), whitened residual (c, rows)), linearised at the fitted
    point `at` (terms, theta), or at the nominal model."""
    for rows, part in problem.parts():
        block = whiten(part, assemble(part, terms, at))
        yield rows, block[:-1], block[-1]


def design(
    problem: Problem, terms: Sequence[Term], at: tuple[Sequence[Term], Array] | None = None
) -> tuple[Array, Array]:
    """Whole design (m, c, p) and residual (m, c), whitened; for data that fit in memory."""
    parts = [(columns, residual) for _, columns, residual in blocks(problem, terms, at)]
    return (
        np.concatenate([c for c, _ in parts], axis=2).transpose(2, 1, 0),
        np.concatenate([r for _, r in parts], axis=1).T,
    )
