"""Rows far off that a simple slip explains: other units, a sign, two axes that changed places, a position of the row before."""
from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ..data.places import lines
from ..matrix.scene import Scene
from ..words.rigid import Array
from .faults import MATCH
from .robust import scale_of

FAR = 20.0         # times as near as a row comes by a slip, a row has to be off: chance does not come so near
Residuals = Callable[[Scene], Array]
SCALES = ((1000.0, "in metres, not millimetres", "multiply x, y and z by 1000"), (25.4, "in inches, not millimetres",
          "multiply x, y and z by 25.4"), (10.0, "in centimetres, not millimetres", "multiply x, y and z by 10"),
          (0.001, "in micrometres, not millimetres", "divide x, y and z by 1000"))
RAD = np.pi / 180


@dataclass(frozen=True, eq=False)
class Slip:
    """What is wrong in words, what to do about it, the readings (m, n) and positions (m, 3) as they would be without."""

    words: str
    remedy: str
    q: Array
    position: Array


def _slips(scene: Scene) -> Iterator[Slip]:
    q, x, turns = scene.data.q, scene.data.position, ~np.array(scene.robot.prismatic)
    yield from (Slip(words, remedy, q, x * scale) for scale, words, remedy in SCALES)
    for a, axis in enumerate("xyz"):
        yield Slip(f"given with the wrong sign of {axis}", f"change the sign of {axis}", q, x * (1 - 2 * np.eye(3)[a]))
        for b in range(a + 1, 3):
            order = np.arange(3)
            order[[a, b]] = b, a
            words, remedy = f"{axis} and {'xyz'[b]} in each other's place", f"let {axis} and {'xyz'[b]} change places"
            yield Slip(f"given with {words}", remedy, q, x[:, order])
    for factor, unit, others in ((1 / RAD, "radians", "degrees"), (RAD, "degrees", "radians")):
        words = f"given with readings in {unit}, not {others}"
        yield Slip(words, "convert the readings", np.where(turns, q * factor, q), x)


def slipped(scene: Scene, left: Residuals, rows: NDArray[np.bool_]) -> tuple[str, ...]:
    """A sentence for every slip that explains some of the `rows` (mask): how many, where, and how well they fit without. `left`:
    residuals (m, c) of a scene under the model; near is what the other rows leave."""
    data = scene.data
    points = np.ones(len(data), bool) if data.gauges is None else data.gauges.of("point")
    calm, rows = points & ~rows, points & rows
    if not rows.any() or not calm.any():
        return ()
    near = MATCH * max(scale_of(_length(left(scene.take(calm)))), 1e-6)
    some = scene.take(rows)
    before = _length(left(some))
    still, out = before > FAR * near, list[str]()
    for slip in (*_slips(some), _stale(scene, rows)):
        changed = some.anew(data=replace(some.data, q=slip.q, position=slip.position))
        after = _length(left(changed))
        good = still & (after < near)
        if good.any():
            count, median = int(good.sum()), float(np.median(after[good]))
            out.append(f"{count} row{' is' if count == 1 else 's are'} {slip.words} ({lines(some.data.row[good])}): corrected, "
                       f"{'it fits' if count == 1 else 'they fit'} to {median:.2g} mm in place of "
                       f"{float(np.median(before[good])):.3g} mm (median); {slip.remedy} there, or leave "
                       f"{'it' if count == 1 else 'them'} out.")
            still = still & ~good
    return tuple(out)


def _stale(scene: Scene, rows: NDArray[np.bool_]) -> Slip:
    """Of every row the readings of the one before: its position was not taken anew."""
    q = np.roll(scene.data.q, 1, axis=0)
    return Slip("given with the position of the row before", "measure them again", q[rows], scene.data.position[rows])


def _length(residual: Array) -> Array:
    return np.asarray(np.linalg.norm(residual[:, :3], axis=1))
