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
from ..exceptions import count_words
from ..mechanisms.causes import ONE
from ..mechanisms.terms import FIXTURE_AXES, FixtureTerm, Mechanism, Term, as_mechanisms, terms_of
from ..robot._kernels import Frame, Workspace, fill_screw_field
from ..robot.kinematics import Pose, walk
from ..robot.rigid import AXES, rotation_vector
from .linearisation import Linearisation
from .observation import predict_readings, reading_gradients
from .problem import Problem

PLACE = {axis: a for a, axis in enumerate(AXES)}
MODEL_EXPECTED = 'a Model, such as Model((mechanism("geometric", robot),))'
# share of the reach, and angle [rad], up to which a residual is rounding of the data
ROUNDING = 1e-9


@dataclass(frozen=True, repr=False)
class Model:
    """A candidate model: mechanisms, in order; terms they share are fitted once."""

    mechanisms: tuple[Mechanism, ...]

    def __post_init__(self) -> None:
        given = as_mechanisms(self.mechanisms)
        object.__setattr__(self, "mechanisms", given)

    @cached_property
    def terms(self) -> tuple[Term, ...]:
        """The fitted numbers."""
        return terms_of(self.mechanisms)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the mechanisms."""
        return tuple(m.name for m in self.mechanisms)

    def __repr__(self) -> str:
        return f"Model of {self.describe()}"

    def describe(self) -> str:
        """Describe the model in a few words: its mechanisms, and the number of its parameters."""
        listed = ", ".join(self.names) or "the nominal robot"
        parameters = count_words(len(self.terms), "parameter")
        return f"{listed}: {parameters}"

    def __add__(self, more: Sequence[Mechanism]) -> Model:
        return Model((*self.mechanisms, *(m for m in more if m not in self.mechanisms)))


# -- the chain at a block of rows
# ------------------------------------------------------------------------------------------------------


def twist_of(problem: Problem, terms: Sequence[Term], theta: Array, rows: slice) -> Array:
    """Compute the entries (n+1, 6, rows) of every frame's H at parameters theta (p,)."""
    out = np.zeros((problem.robot.n + 1, 6, rows.stop - rows.start))
    for value, term in zip(theta, terms, strict=True):
        if value:
            for s in term.screws:
                out[s.frame - 1, PLACE[s.axis]] += value * _rows(problem.cause(s.cause), rows)
    return out


def _rows(cause: Array | float, rows: slice) -> Array | float:
    return cause if isinstance(cause, float) else cause[rows]


def _start(problem: Problem, rows: slice) -> Frame:
    """Return frame 0 as the tracker sees it, at these rows."""
    R, t = problem.placement
    if len(R) == 1:
        return R[0].T[:, :, None], t[0][:, None]
    group = problem.data.group[rows]
    return np.ascontiguousarray(R[group].transpose(2, 1, 0)), np.ascontiguousarray(t[group].T)


def _tool(problem: Problem, rows: slice) -> Array:
    if len(problem.tools) == 1:
        only: Array = problem.tools[0]
        return only
    return problem.tool[rows]


def _subtract_predicted(problem: Problem, frame: Frame, rows: slice, out: Array) -> None:
    """Measured minus predicted into out (c, rows): mm, and with orientations the rotation vector
    [rad], in the tracker's frame; `frame` is the target's."""
    data = problem.data
    np.subtract(data.position[rows].T, frame[1], out=out[:3])
    if data.rotation is not None and problem.tool_rotations is not None:
        tool_rotation = problem.tool_rotations[data.target[rows]]
        predicted = np.einsum("jim,mjk->mik", frame[0], tool_rotation)
        turn = np.einsum("mij,mkj->mik", data.rotation[rows], predicted)
        out[3:] = rotation_vector(turn).T


def fill_rows(
    problem: Problem,
    twist: Array | None,
    rows: slice,
    field: Array,
    residual: Array,
    space: Workspace,
) -> None:
    """Write the screw field (n+1, 6, c, rows) and the residual (c, rows), not whitened, of rows that
    are points; `twist` as of `twist_of`, None for the nominal chain."""
    q, tool, start = problem.data.q[rows], _tool(problem, rows), _start(problem, rows)
    origins = space.array("origins", problem.robot.n + 1, 3, rows.stop - rows.start)
    target = walk(problem.robot, q, tool, (field[:, :, :3], origins), twist, start, space)
    _subtract_predicted(problem, target, rows, residual)
    fill_screw_field(field, origins, origins[-1], twist is not None, space)


# -- [columns | residual] of a block of rows
# ------------------------------------------------------------------------------------------------------


def assemble(
    problem: Problem,
    terms: Sequence[Term],
    at: Linearisation | None = None,
    rows: slice | None = None,
    space: Workspace | None = None,
) -> Array:
    """Assemble [columns | residual] (p+1, c, rows) of a block of rows, not whitened, linearised at
    a fitted point or (None) at the nominal model. With `space` the array is overwritten by the
    next call."""
    if rows is None:
        count = len(problem)
        rows = slice(0, count)
    space = space or Workspace()
    if problem.only_points:
        return _assemble_points(problem, terms, at, rows, space)
    return _assemble_readings(problem, terms, at, rows, space)


def _assemble_points(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None, rows: slice, space: Workspace
) -> Array:
    """Assemble [columns | residual] where every row is a point.

    The screw field stands where the columns of its own entries (see `_entry_run`) belong, so that
    nothing is copied:

        columns   0 … first     first … stop     stop … covered     covered … p
        memory    products      field, which is the columns themselves, and more of it behind

    Columns under the rest of the field (stop … covered) are made in an array of their own, and
    copied over the field once it has been read by all."""
    m, n = rows.stop - rows.start, problem.robot.n
    c, p, entries = problem.components, len(terms), 6 * (n + 1)
    first, stop = space.once("run", terms, _entry_run)
    out = space.array("design", max(p, first + entries) + 1, c, m)
    field = out[first : first + entries].reshape(n + 1, 6, c, m)
    twist = None if at is None else twist_of(problem, at.terms, at.theta, rows)
    fill_rows(problem, twist, rows, field, out[-1], space)
    covered = min(p, first + entries)
    behind = space.array("others", max(covered - stop, 0), c, m)
    _write_products(problem, field, terms[:first], rows, out[:first], space)
    _write_products(problem, field, terms[stop:covered], rows, behind, space)
    _write_products(problem, field, terms[covered:], rows, out[covered:p], space)
    out[stop:covered] = behind
    out[p] = out[-1]
    return out[: p + 1]


def _assemble_readings(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None, rows: slice, space: Workspace
) -> Array:
    """`assemble` where not every row is a point: the target's own three rows of the design, turned
    into the row's by its gradient, less those of the configuration where a distance begins; the
    features' numbers beside them."""
    gauges = problem.observed(rows)
    change = (at or Linearisation((), np.zeros(0))).feature_changes(len(gauges.features))
    moving = [k for k, term in enumerate(terms) if term.screws]
    arm_terms = tuple(terms[k] for k in moving)

    target = assemble(problem.bare, arm_terms, at, rows, space)
    x, origin_x = -target[-1, :3], None
    origin = None
    if problem.origin is not None:
        origin = assemble(problem.origin, arm_terms, at, rows, Workspace())
        origin_x = -origin[-1, :3]

    G, E = reading_gradients(gauges, problem.fixtures, change, x, origin_x)
    out = np.zeros((len(terms) + 1, *target.shape[1:]))
    out[-1] = target[-1]
    out[moving, :3] = np.einsum("ijm,pjm->pim", G, target[:-1, :3])
    out[moving, 3:] = target[:-1, 3:]
    if origin is not None:
        by_origin = G * gauges.of("distance")
        out[moving, :3] -= np.einsum("ijm,pjm->pim", by_origin, origin[:-1, :3])
    for column, term in zip(out, terms, strict=False):
        if isinstance(term, FixtureTerm):
            column[:3] = E[FIXTURE_AXES.index(term.axis)] * (gauges.feature == term.feature)
    predicted = predict_readings(gauges, problem.fixtures, change, x, origin_x)
    out[-1, :3] = problem.readings[:, rows] - predicted
    out *= problem.components_measured[rows].T
    return out


def _entry_run(terms: Sequence[Term]) -> tuple[int, int]:
    """Find (start, stop) of the first run of terms that are the screw field's own entries, in its order
    from frame 1."""
    starts = [k for k, term in enumerate(terms) if _is_entry(term, 0)]
    start = starts[0] if starts else 0
    stop = start
    while stop < len(terms):
        number = stop - start
        if not _is_entry(terms[stop], number):
            break
        stop += 1
    return start, stop


def _is_entry(term: Term, number: int) -> bool:
    """Whether a term's column is an entry of the screw field by its number."""
    if len(term.screws) != 1:
        return False
    screw = term.screws[0]
    frame = number // 6 + 1
    if screw.frame != frame:
        return False
    has_axis = screw.axis == AXES[number % 6]
    return has_axis and screw.cause == ONE


def _write_products(
    problem: Problem, field: Array, terms: Sequence[Term], rows: slice, out: Array, space: Workspace
) -> None:
    """Write columns of terms, screw field times cause, into out (len(terms), c, rows); rows that are
    points see no feature."""
    scaled = space.array("scaled", *out.shape[1:])
    for column, term in zip(out, terms, strict=True):
        if not term.screws:
            column[:] = 0.0
            continue
        first, *others = term.screws
        cause = _rows(problem.cause(first.cause), rows)
        np.multiply(field[first.frame - 1, PLACE[first.axis]], cause, out=column)
        for s in others:
            cause = _rows(problem.cause(s.cause), rows)
            np.multiply(field[s.frame - 1, PLACE[s.axis]], cause, out=scaled)
            np.add(column, scaled, out=column)


# -- the screw field of a pose
# ------------------------------------------------------------------------------------------------------


def field_of(problem: Problem, pose: Pose, rows: slice) -> Array:
    """Compute the screw field (n+1, 6, c, rows) of a pose in the tracker's frame: mm (and rad of
    the target frame) per unit screw."""
    R = problem.placement[0][problem.data.group[rows]]
    moved: Array = np.einsum("mij,fajm->faim", R, pose.displacement())
    if not problem.only_points:
        distances = problem.observed(rows).of("distance")
        G = directions(problem, pose, rows) * ~distances  # which has no place of its own
        moved = np.einsum("ijm,fajm->faim", G, moved)
    if problem.components == 3:
        return moved
    turned = np.zeros_like(moved)
    turned[:, 3:] = np.einsum("mij,fajm->faim", R, pose.axes[:, 3:])
    return np.concatenate([moved, turned], axis=2)


def directions(problem: Problem, pose: Pose, rows: slice) -> Array:
    """Compute what the rows see of the target's displacement at a pose, (3, 3, rows) in the
    tracker's frame."""
    group = problem.data.group[rows]
    if problem.only_points:
        identity = np.eye(3)[:, :, None]
        return np.tile(identity, (1, 1, len(group)))
    gauges = problem.observed(rows)
    R, t = problem.placement
    turned = np.einsum("mij,jm->im", R[group], pose.target)
    x = turned + t[group].T
    unchanged = np.zeros((len(gauges.features), len(FIXTURE_AXES)))
    G, _ = reading_gradients(gauges, problem.fixtures, unchanged, x, None)
    return G


def compute_columns(problem: Problem, field: Array, terms: Sequence[Term], rows: slice) -> Array:
    """Compute the columns (p, c, rows) of terms from a screw field."""
    out = np.empty((len(terms), *field.shape[2:]))
    _write_products(problem, field, terms, rows, out, Workspace())
    return out


# -- residuals, and the design of all rows
# ------------------------------------------------------------------------------------------------------


def residuals(problem: Problem, terms: Sequence[Term] = (), theta: Array | None = None) -> Array:
    """Compute the exact residuals (m, c) [mm, rad], not whitened, at parameters theta; without
    them, of the nominal model."""
    if problem.only_points:
        return _point_residuals(problem, terms, theta)
    if theta is None:
        theta = np.zeros(len(terms))
    return _reading_residuals(problem, terms, theta)


def _point_residuals(problem: Problem, terms: Sequence[Term], theta: Array | None) -> Array:
    """Compute the residuals where every row is a point."""
    out, space = np.empty((len(problem), problem.components)), Workspace()
    frames = problem.robot.n + 1
    for rows, part in problem.parts():
        m = len(part)
        every = slice(0, m)
        twist = None if theta is None else twist_of(part, terms, theta, every)
        axes, origins = space.array("axes", frames, 6, 3, m), space.array("origins", frames, 3, m)
        tool, start = _tool(part, every), _start(part, every)
        target = walk(problem.robot, part.data.q, tool, (axes, origins), twist, start, space)
        _subtract_predicted(part, target, every, out[rows].T)
    return out


def _reading_residuals(problem: Problem, terms: Sequence[Term], theta: Array) -> Array:
    """Compute the residuals where not every row is a point."""
    gauges = problem.observed()
    count = len(gauges.features)
    change = Linearisation(terms, theta).feature_changes(count)
    out = residuals(problem.bare, terms, theta)
    x = -out[:, :3].T
    origin_x = None
    if problem.origin is not None:
        origin_residual = residuals(problem.origin, terms, theta)
        origin_x = -origin_residual[:, :3].T
    predicted = predict_readings(gauges, problem.fixtures, change, x, origin_x)
    out[:, :3] = (problem.readings - predicted).T
    measured = np.where(problem.components_measured, out, 0.0)
    return np.asarray(measured)


def whiten(problem: Problem, values: Array) -> Array:
    """Turn values (..., c, m) into units of their standard uncertainty; in place where one weight
    does."""
    return problem.whitening.apply(values)


def whitened(problem: Problem, residual: Array) -> Array:
    """Return residuals (m, c) in units of their standard uncertainty, (m, c)."""
    values = residual.T.copy()
    in_units = whiten(problem, values)
    return np.asarray(in_units.T)


def measure_rounding(problem: Problem) -> float:
    """Measure the norm of whitened residuals up to which they are rounding of the data.

    Every row is then off by ROUNDING of the reach, and turned by ROUNDING, which no instrument
    resolves and a fit that has converged may leave."""
    shape = problem.components, len(problem)
    residual = np.full(shape, ROUNDING * problem.reach_mm)
    residual[3:] = ROUNDING
    in_units = problem.whitening.apply_by_row(residual)
    return float(np.linalg.norm(in_units))


def blocks(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None = None
) -> Iterator[tuple[slice, Array, Array]]:
    """Yield (rows, whitened columns (p, c, rows), whitened residual (c, rows)), linearised at a
    fitted point or (None) at the nominal model."""
    for rows, part in problem.parts():
        block = whiten(part, assemble(part, terms, at))
        yield rows, block[:-1], block[-1]


def compute_design(
    problem: Problem, terms: Sequence[Term], at: Linearisation | None = None
) -> tuple[Array, Array]:
    """Compute the whole design (m, c, p) and residual (m, c), whitened; for data that fit in
    memory."""
    columns = []
    residual = []
    for _, block_columns, block_residual in blocks(problem, terms, at):
        columns.append(block_columns)
        residual.append(block_residual)
    X = np.concatenate(columns, axis=2)
    y = np.concatenate(residual, axis=1)
    rows_first = X.transpose(2, 1, 0)
    return rows_first, y.T
