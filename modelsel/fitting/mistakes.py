"""Which simple mistake of the set-up explains the positions: a joint's sense or zero, columns, units, a mirrored axis, the tool.

Every mistake is a change of the readings, q -> A q + c, or of the positions. All are tried at once: for given readings the best
free affine map from the tracker to frame 0 and the best target are linear, and what they leave is what registration leaves at
least. Whatever does well is then registered as it stands. Nothing is applied: the sentence says what would fit.
"""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from ..machine.robot import Robot, pose
from ..matrix.design import residuals
from ..matrix.scene import Scene
from ..words.errors import DataError, NotEstimable
from ..words.rigid import Array
from .register import register

ROWS = 120            # that are looked at, spread over the file
LEAST = 10            # configurations, below which chance fits too much; twice as many for two mistakes at once
BAD, FAR = 3e-3, 0.01 # of the reach: a median residual from which one mistake is looked for, from which the tool's or several
FACTOR = 4.0          # a mistake explains the positions if without it they fit so much better,
GOOD = 0.05           # and to this share of what they spread (median)
ALIKE = 1.5           # mistakes that fit as well as the best, within this factor, are told with it
TOLD = 2              # mistakes in a sentence
TRIED = 8             # of the linear solutions that are registered
NEAR = 0.1            # of the logarithm of a scale, for a unit to be tried
REWEIGHT = 8
TOGETHER = 64         # in one block of the linear solution
RAD = np.pi / 180
SCALES = {1000.0: ("are metres", "name them x_m y_m z_m"),
          0.001: ("are a thousandth of what they say", "check whether x_m y_m z_m hold millimetres, or the robot file metres"),
          25.4: ("are inches", "convert them to mm"), 10.0: ("are centimetres", "convert them to mm")}
MIRRORED = ("stand in a left-handed frame (an axis mirrored)", "check the signs and the order of x, y and z")


@dataclass(frozen=True, eq=False)
class Mistake:
    """What would mend it, as `words` after "if", and where to `look`; readings q (m, n) become q Aᵀ + c, positions x Bᵀ; of how
    many simple mistakes it consists."""

    words: str
    look: str
    A: Array
    c: Array
    B: Array
    parts: int = 1

    def then(self, other: Mistake) -> Mistake:
        """Both, this one first."""
        look = self.look if other.look == self.look else f"{self.look}, and {other.look}"
        return Mistake(f"{self.words} and {other.words}", look, other.A @ self.A,
                       other.A @ self.c + other.c, other.B @ self.B, self.parts + other.parts)


NOTHING = Mistake("", "", np.eye(0), np.zeros(0), np.eye(3))
REGISTER = replace(NOTHING, words="the tracker's frame and the target on the flange are found", look="[robot] register = true")


def _of_joints(robot: Robot) -> Iterator[Mistake]:
    """One joint's sense, zero, unit, or what it counts from; two joints' columns; all units, all columns."""
    n, eye, turns = robot.n, np.eye(robot.n), [not slides for slides in robot.prismatic]

    def one(words: str, look: str, A: Array = eye, c: Array | None = None) -> Mistake:
        return Mistake(words, look, A, np.zeros(n) if c is None else c, np.eye(3))

    for j in range(n):
        name, scaled = f"joint {j + 1}", eye.copy()
        scaled[j, j] = -1.0
        yield one(f"{name} {'turns' if turns[j] else 'moves'} the other way",
                  f"check the sign of q{j + 1} and the robot file's axis", scaled)
        if turns[j]:
            for degrees in (90, -90, 180):
                yield one(f"{abs(degrees)}° is {'added to' if degrees > 0 else 'taken from'} q{j + 1}",
                          f"check where {name} is nought in the controller and in the robot file", c=eye[j] * degrees * RAD)
        for k in range(j + 1, n):
            if turns[j] == turns[k]:
                order = np.arange(n)
                order[[j, k]] = k, j
                yield one(f"q{j + 1} and q{k + 1} change places", "check the columns of the joint readings", eye[order])
        if j and turns[j] and turns[j - 1]:
            for sign in (1.0, -1.0):
                coupled = eye.copy()
                coupled[j, j - 1] = sign
                yield one(f"q{j} is {'added to' if sign > 0 else 'taken from'} q{j + 1}",
                          f"check whether the controller counts joint {j + 1} from the link before it or from the base", coupled)
    for factor, words in ((1 / RAD, "radians, not degrees"), (RAD, "degrees, not radians")):
        unit = "_deg" if factor < 1 else "_rad"
        for j in (j for j in range(n) if turns[j]):
            scaled = eye.copy()
            scaled[j, j] = factor
            yield one(f"q{j + 1} is in {words}", f"name its column q{j + 1}{unit}", scaled)
        yield one(f"all readings are in {words}", f"name their columns q1{unit} and so on", np.diag(np.where(turns, factor, 1.0)))
    if len(set(turns)) == 1 and n > 2:
        yield one("the joints are counted from the flange", f"check the order of the columns q1 to q{n}", eye[::-1])


def _of_positions(n: int, framed: bool) -> Iterator[Mistake]:
    """Units and handedness; axis by axis where the positions are said to stand in the robot's own frame."""
    def one(words: str, look: str, B: Array) -> Mistake:
        return Mistake(words, look, np.eye(n), np.zeros(n), B)

    for scale, (words, look) in SCALES.items():
        yield one(f"the positions {words}", look, np.eye(3) * scale)
    if not framed:
        yield one(f"the positions {MIRRORED[0]}", MIRRORED[1], -np.eye(3))
        return
    for a, axis in enumerate("xyz"):
        yield one(f"{axis} counts the other way", f"check the sign of {axis}", np.diag(1 - 2 * np.eye(3)[a]))
        for b in range(a + 1, 3):
            order = np.arange(3)
            order[[a, b]] = b, a
            yield one(f"{axis} and {'xyz'[b]} change places", "check the columns of the positions", np.eye(3)[order])


def mistake(scene: Scene, use: NDArray[np.bool_], registered: bool, per_group: bool = False) -> str | None:
    """A sentence that says which simple mistake of the set-up explains what the rows `use` (mask) of a scene leave at its
    placement and tools, with the median distance before and after; None where they leave little, or no mistake explains it.
    `registered`: placement and tools were found from the rows; else they are what the study says."""
    some = _sample(scene, use, per_group)
    reach = scene.robot.reach + float(np.linalg.norm(scene.tools, axis=1).max(initial=0))
    if some is None or (before := _left(some)) < BAD * reach:
        return None
    singles, also = tuple(_of_joints(scene.robot)), ""
    if registered:
        some = _registered(some)
        before = _left(some)
        if before < BAD * reach:                         # orientations were at odds with the positions
            return None
    limit, several = before / FACTOR, before > FAR * reach
    if not registered:
        stated = ((m, _explained(_changed(some, m))) for m in (*singles, *_of_positions(scene.robot.n, True)))
        found = _best([*(_tool(some) if several else []), *stated], limit)
        if not found and several and (left := _explained(_registered(some))) <= limit:
            found = [(REGISTER, left)]
        if found:
            return _sentence(before, found)
        also = "the tracker's frame and the target on the flange are found ([robot] register = true), and "
    found = _best(_tried(some, singles, 1), limit)
    if not found and several and len(np.unique(some.data.block)) >= 2 * LEAST:
        found = _best(_tried(some, singles, 2), limit)
    return _sentence(before, found, also) if found else None


def _sentence(before: float, found: Sequence[tuple[Mistake, float]], also: str = "") -> str:
    after = min(left for _, left in found)
    better = f"{before / after:.0f} times better" if before < 1e4 * after else "far better"
    looks = list(dict.fromkeys(m.look for m, _ in found))
    return (f"The positions fit {better} ({_mm(after)} in place of {_mm(before)}, median) if {also}"
            f"{', or if '.join(m.words for m, _ in found)}: {', or '.join(looks)}.")


def _mm(value: float) -> str:
    return f"{value:.0f} mm" if value >= 100 else f"{value:.2g} mm"


def _sample(scene: Scene, use: NDArray[np.bool_], per_group: bool) -> Scene | None:
    """At most ROWS measured positions of one target, and of one group where each has its placement; None where too few."""
    data = scene.data
    rows = np.flatnonzero(use if data.gauges is None else use & data.gauges.of("point"))
    for index in (data.target, *([data.group] if per_group else [])):
        if len(rows):
            rows = rows[index[rows] == np.bincount(index[rows]).argmax()]
    rows = rows[np.unique(np.linspace(0, len(rows) - 1, min(len(rows), ROWS)).astype(int))] if len(rows) else rows
    if len(np.unique(data.block[rows])) < LEAST:
        return None
    some = scene.take(rows)
    data = replace(some.data, rotation=None, sigma_rotation=None, gauges=None)
    return some.anew(data=data, tool_rotations=None, whiten=1.0)


def _left(some: Scene) -> float:
    return float(np.median(np.linalg.norm(residuals(some), axis=1)))


def _explained(some: Scene) -> float:
    """What is left, infinite where it is much of what the positions spread: positions that hardly move fit anything."""
    x, left = some.data.position, _left(some)
    return left if left <= GOOD * float(np.median(np.linalg.norm(x - np.median(x, axis=0), axis=1))) else np.inf


def _registered(some: Scene) -> Scene:
    return register(some, np.ones(len(some), bool), per_group=False)


def _changed(some: Scene, m: Mistake) -> Scene:
    data = replace(some.data, q=some.data.q @ m.A.T + m.c, position=some.data.position @ m.B.T)
    return some.anew(data=data)


def _best(tried: Sequence[tuple[Mistake, float]], limit: float) -> list[tuple[Mistake, float]]:
    """The mistakes that leave least, best first: those within the limit and as good as the best, of the fewest parts."""
    least = min((left for _, left in tried), default=np.inf)
    good = [(m, left) for m, left in tried if left <= min(limit, ALIKE * least)]
    fewest = min((m.parts for m, _ in good), default=0)
    return sorted((each for each in good if each[0].parts == fewest), key=lambda each: each[1])[:TOLD]


def _tool(some: Scene) -> list[tuple[Mistake, float]]:
    """The target elsewhere on the flange: where most rows have it (median)."""
    R, t = some.placement
    at = pose(some.robot, some.data.q, np.zeros(3))
    base = np.einsum("mji,mj->mi", R[some.data.group], some.data.position - t[some.data.group])
    offset = np.median(np.einsum("aim,mi->ma", at.axes[-1, :3], base - at.target.T), axis=0)
    moved = some.anew(tools=np.tile(offset, (len(some.tools), 1)))
    name = some.data.targets[some.data.target[0]]
    called = f"target {name}" if len(some.tools) > 1 else "the target"
    words = f"{called} sits at {', '.join(f'{v:.1f}' for v in offset)} mm on the flange"
    return [(replace(NOTHING, words=words, look="check tool_mm in the study"), _explained(moved))]


def _tried(some: Scene, singles: Sequence[Mistake], count: int) -> list[tuple[Mistake, float]]:
    """Up to `count` mistakes at once, with what is left once registered; of what does best in the linear solution alone."""
    n = some.robot.n
    nothing = replace(NOTHING, A=np.eye(n), c=np.zeros(n), parts=0)
    joints = [nothing, *singles] if count == 1 else [*singles, *(a.then(b) for a, b in combinations(singles, 2)), *_senses(n)]
    score, factor = _linear(some, joints)
    order = np.lexsort((score, np.where(score <= ALIKE * score.min(), [m.parts for m in joints], np.inf)))
    out = []
    for k in order[:TRIED]:
        of_joints = joints[k]
        several = [of_joints] if of_joints.parts else []
        if of_joints.parts < count:
            several += [of_joints.then(m) if of_joints.parts else m
                        for m, scale in zip(_of_positions(n, False), (*SCALES, -1.0), strict=True)
                        if factor[k] * scale > 0 and abs(np.log(factor[k] / scale)) < NEAR]
        for m in several:
            try:
                out.append((m, _explained(_registered(_changed(some, m)))))
            except (DataError, NotEstimable):
                continue
    return out


def _senses(n: int) -> Iterator[Mistake]:
    """Three joints and more that turn the other way."""
    for size in range(3, n + 1 if n <= 8 else 0):
        for some in combinations(range(n), size):
            sign = np.ones(n)
            sign[list(some)] = -1.0
            names = ", ".join(str(j + 1) for j in some[:-1]) + f" and {some[-1] + 1}"
            yield Mistake(f"joints {names} turn the other way", "check the signs of the readings and the robot file's axes",
                          np.diag(sign), np.zeros(n), np.eye(3), size)


def _linear(some: Scene, joints: Sequence[Mistake]) -> tuple[Array, Array]:
    """((H,) median distance that the best affine map from the tracker to frame 0 and the best target leave of the readings as
    each of H mistakes has them, over the mapped positions' own: a map may shrink the world; (H,) the map's scale, negative where
    it mirrors). Cauchy weights."""
    x = some.data.position - np.median(some.data.position, axis=0)
    span, m = max(float(np.abs(x).max()), 1e-6), len(some)
    row = np.concatenate([x / span, np.ones((m, 1))], 1)
    left, scale = np.empty(len(joints)), np.empty(len(joints))
    for start in range(0, len(joints), TOGETHER):
        part = joints[start:start + TOGETHER]
        at = pose(some.robot, np.concatenate([some.data.q @ k.A.T + k.c for k in part]), np.zeros(3))
        flange = np.concatenate([at.target[:, None], at.axes[-1, :3].transpose(1, 0, 2)], 1)          # (3, 1 + 3, H m)
        y = flange.transpose(2, 0, 1).reshape(len(part), m, 12)
        weight = np.ones((len(part), m))
        for _ in range(REWEIGHT):
            wide = weight[:, None] * row.T                                                            # (H, 4, m)
            map_ = np.linalg.pinv(wide @ row, rcond=1e-12, hermitian=True) @ (wide @ y)
            rest = (y - row @ map_).reshape(len(part), m, 3, 4)
            o, F = rest[..., :1].reshape(len(part), -1, 1), rest[..., 1:].reshape(len(part), -1, 3)
            heavy = np.repeat(weight, 3, axis=1)[:, None] * F.transpose(0, 2, 1)
            t = -np.linalg.pinv(heavy @ F, rcond=1e-9, hermitian=True) @ (heavy @ o)
            size = np.linalg.norm((o + F @ t).reshape(len(part), m, 3), axis=2)
            middle = np.median(size, axis=1)
            weight = 1 / (1 + (size / np.maximum(3 * middle, 1e-6)[:, None]) ** 2) ** 2
        A = map_.reshape(-1, 4, 3, 4)[:, :3] @ np.concatenate([np.ones((len(part), 1, 1)), t], 1)[:, None]
        mapped = np.median(np.linalg.norm(row[:, :3] @ A[..., 0], axis=2), axis=1)
        block = slice(start, start + len(part))
        left[block], scale[block] = middle / np.maximum(mapped, 1e-9), np.cbrt(np.linalg.det(A[..., 0])) / span
    return left, scale
