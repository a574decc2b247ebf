"""An arm of the tests' own: exact kinematics, screws, gravity and effects to plant, in plain numpy.

Nothing of modelsel's is used but the robots' drawings (the transforms before the joints, limits,
masses): the chain, the displacement of a screw, weights and every effect are written again here, so
that an error in the tool's columns cannot hide in the data that test it. Lengths in mm, angles in
rad. H_k sits between N_k and joint k's rotation; frame n+1 is the target. An effect is a list of
terms; a term gives per row the twist of every frame (m, n+1, 6) and a shift of the measured point
(m, 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

AXES = ("tx", "ty", "tz", "rx", "ry", "rz")
PUMA_LIMITS = np.radians(
    [[-160, 160], [-45, 60], [-120, 45], [-110, 170], [-100, 100], [-180, 180]]
)
G = 9.81
Term = Callable[["State"], tuple[np.ndarray, np.ndarray]]


def turned(axis: int, angle: np.ndarray) -> np.ndarray:
    """(m, 4, 4) rotations about axis 0, 1, 2."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = [(1, 2), (2, 0), (0, 1)][axis]
    out = np.tile(np.eye(4), (len(c), 1, 1))
    out[:, i, i], out[:, j, j], out[:, i, j], out[:, j, i] = c, c, -s, s
    return out


def moved(twist: np.ndarray) -> np.ndarray:
    """(m, 4, 4) Trans(a, b, c) Rx Ry Rz of twists (m, 6)."""
    out = np.tile(np.eye(4), (len(twist), 1, 1))
    out[:, :3, 3] = twist[:, :3]
    for a in range(3):
        if twist[:, 3 + a].any():
            out = out @ turned(a, twist[:, 3 + a])
    return out


@dataclass(frozen=True, eq=False)
class Arm:
    """A drawing with errors: `before` (n, 4, 4), `last`, the target on the flange, what the
    assembly really is (n+1, 6)."""

    name: str
    before: np.ndarray
    last: np.ndarray
    tool: np.ndarray
    limits: np.ndarray
    errors: np.ndarray
    masses: np.ndarray  # (b,) kg
    bodies: tuple[
        tuple[int, tuple[float, ...]], ...
    ]  # (frame the body moves with, its place there [mm])

    @property
    def n(self) -> int:
        return len(self.before)

    def chain(
        self, q: np.ndarray, twist: np.ndarray | None = None, exact: bool = True
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Target (m, 3) and the frames (m, 4, 4) before each joint's rotation; `exact=False`: the
        drawing."""
        m = len(q)
        T, frames = np.tile(np.eye(4), (m, 1, 1)), []
        for k in range(self.n + 1):
            N = self.before[k] if k < self.n else self.last @ _shift(self.tool)
            T = T @ N
            if exact:
                T = T @ moved(np.broadcast_to(self.errors[k], (1, 6)))
            if twist is not None and twist[:, k].any():
                T = T @ moved(twist[:, k])
            frames.append(T)
            if k < self.n:
                T = T @ turned(2, q[:, k])
        return T[:, :3, 3], frames

    def screws(self, q: np.ndarray, exact: bool = True) -> np.ndarray:
        """(m, n+1, 6, 3): displacement of the target per unit screw at every frame."""
        x, frames = self.chain(q, exact=exact)
        J = np.zeros((len(q), self.n + 1, 6, 3))
        for k, F in enumerate(frames):
            for a in range(3):
                J[:, k, a] = F[:, :3, a]
                J[:, k, 3 + a] = np.cross(F[:, :3, a], x - F[:, :3, 3])
        return J

    def draw(self, rng: np.random.Generator, m: int, reach: float = np.pi) -> np.ndarray:
        """(m, n) configurations, uniform in the limits and within ± reach."""
        return rng.uniform(
            np.maximum(self.limits[:, 0], -reach), np.minimum(self.limits[:, 1], reach), (m, self.n)
        )


def _shift(t: Sequence[float]) -> np.ndarray:
    out = np.eye(4)
    out[:3, 3] = t
    return out


def arm(robot: object, rng: np.random.Generator, tool: Sequence[float] = (0.0, 0.0, 100.0)) -> Arm:
    """The built-in robot with geometric errors drawn as an assembled arm has them: 0.5 mm, 2 mrad,
    5 mrad at the joints."""
    joints = robot.joints  # type: ignore[attr-defined]
    n = len(joints)
    limits = np.array([j.limits or (-np.pi, np.pi) for j in joints]).clip(-np.pi, np.pi)
    errors = np.zeros((n + 1, 6))
    errors[:n] = rng.normal(size=(n, 6)) * [0.5, 0.5, 0.5, 2e-3, 2e-3, 5e-3]
    if any(j.mass for j in joints):
        masses = np.array([j.mass or 0.0 for j in joints])
        bodies = tuple((k, tuple(j.com)) for k, j in enumerate(joints))
    else:
        masses, bodies = np.ones(n), (*((k, ()) for k in range(1, n)), (n, ()))
    name = robot.name  # type: ignore[attr-defined]
    return Arm(
        name,
        np.stack([j.before for j in joints]),
        np.asarray(robot.last),
        np.array(tool, float),  # type: ignore[attr-defined]
        PUMA_LIMITS if name == "puma760" else limits,
        errors,
        masses,
        bodies,
    )


@dataclass(frozen=True, eq=False)
class State:
    """One campaign: configurations in the order of motion, and what was read beside them."""

    arm: Arm
    q: np.ndarray
    covariates: Mapping[str, np.ndarray] = field(default_factory=dict)

    @property
    def m(self) -> int:
        return len(self.q)

    @property
    def progress(self) -> np.ndarray:
        return np.arange(self.m) / (self.m - 1)

    @property
    def move(self) -> np.ndarray:
        """(m, n) signed last motion of every joint, nought at the first configuration."""
        return np.vstack([np.zeros(self.arm.n), np.diff(self.q, axis=0)])

    def places(self) -> tuple[np.ndarray, list[np.ndarray]]:
        """Target and frames of the drawing."""
        return self.arm.chain(self.q, exact=False)

    def weights(self) -> list[tuple[int, float, np.ndarray]]:
        """(frame it moves with, mass, position (m, 3)) of the bodies that gravity pulls at."""
        x, frames = self.places()
        out = []
        for mass, (k, com) in zip(self.arm.masses, self.arm.bodies, strict=True):
            if not com:
                out.append(
                    (min(self.arm.n, k), mass, x if k == self.arm.n else frames[k][:, :3, 3])
                )
            else:
                F = frames[k] @ turned(2, self.q[:, k])
                out.append((k, mass, F[:, :3, 3] + F[:, :3, :3] @ np.array(com)))
        return out

    def moment(self, frame: int) -> np.ndarray:
        """(m, 3) moment [N m] of the weight beyond joint `frame` (1-based) about the axes of its
        frame; 0: about frame 0."""
        _, frames = self.places()
        F = frames[frame - 1] if frame else np.tile(np.eye(4), (self.m, 1, 1))
        total = sum(
            mass * np.cross(p - F[:, :3, 3], [0, 0, -G]) / 1e3
            for k, mass, p in self.weights()
            if k > frame - 1 or (k == frame - 1 and self.arm.bodies[0][1])
        )
        return np.einsum("mia,mi->ma", F[:, :3, :3], total)

    def torque_of(self, joint: int, p: np.ndarray) -> np.ndarray:
        """(m,) gravity torque [N m/kg] about a joint (1-based) of 1 kg at p (m, 3)."""
        F = self.places()[1][joint - 1]
        return np.einsum("mi,mi->m", F[:, :3, 2], np.cross(p - F[:, :3, 3], [0, 0, -G]) / 1e3)


def measured(
    arm: Arm,
    state: State,
    effects: Sequence[Effect],
    rng: np.random.Generator | None = None,
    noise: float = 0.0,
) -> np.ndarray:
    """(m, 3) where the arm with its errors and effects has the target, with noise [mm] where `rng`
    is given."""
    twist, shift = np.zeros((state.m, arm.n + 1, 6)), np.zeros((state.m, 3))
    for effect in effects:
        t, s = effect.perturbation(state)
        twist, shift = twist + t, shift + s
    x = arm.chain(state.q, twist)[0] + shift
    return x if rng is None else x + rng.normal(0, noise, x.shape)


@dataclass(frozen=True, eq=False)
class Effect:
    """What is planted: `terms` with their `sizes`; `kind` is the catalogue's name, or "cell" and
    the like."""

    kind: str
    words: str
    terms: tuple[Term, ...]
    sizes: np.ndarray

    def perturbation(self, state: State) -> tuple[np.ndarray, np.ndarray]:
        """Twist and shift of all terms at their sizes."""
        parts = [term(state) for term in self.terms]
        return (
            np.asarray(sum(a * t for a, (t, _) in zip(self.sizes, parts, strict=True))),
            np.asarray(sum(a * s for a, (_, s) in zip(self.sizes, parts, strict=True))),
        )

    def columns(self, state: State, J: np.ndarray) -> np.ndarray:
        """(3 m, k) displacement per unit of every term, from screws J (m, n+1, 6, 3)."""
        return np.stack(
            [
                (np.einsum("mfa,mfac->mc", t, J) + s).ravel()
                for t, s in (term(state) for term in self.terms)
            ],
            1,
        )

    def scale(self, columns: np.ndarray) -> np.ndarray:
        """(k,) norms of its columns, those of terms that move nothing kept from nought."""
        size = np.linalg.norm(columns, axis=0)
        return np.maximum(size, 1e-9 * size.max())

    def displacement(self, state: State) -> np.ndarray:
        """(3 m,) what the effect alone does to the target, exactly."""
        return (measured(state.arm, state, [self]) - measured(state.arm, state, [])).ravel()

    def scaled(self, factor: float) -> Effect:
        """The same effect, larger or smaller."""
        return Effect(self.kind, self.words, self.terms, self.sizes * factor)


# -- judging
# -------------------------------------------------------------------------------------------------------------


def geometry(J: np.ndarray) -> np.ndarray:
    """Orthonormal basis (3 m, r) of the constant screws of every frame."""
    A = J.reshape(len(J), -1, 3).transpose(0, 2, 1).reshape(3 * len(J), -1)
    A = A[
        :, np.setdiff1d(np.arange(A.shape[1]), np.arange(A.shape[1])[-3:])
    ]  # the target's own rotations move nothing
    size = np.linalg.norm(A, axis=0)
    A = A[:, size > 1e-9 * size.max()]
    U, S, _ = np.linalg.svd(A / np.linalg.norm(A, axis=0), full_matrices=False)
    return U[:, 1e-7 * S[0] < S]


def off(Q: np.ndarray, A: np.ndarray) -> np.ndarray:
    """Columns (or a vector) with the span of Q taken out."""
    return A - Q @ (Q.T @ A)


def said(mechanism: object, problem: object, J: np.ndarray) -> np.ndarray:
    """(3 m, k) what an explanation moves per unit of its terms: its places and causes, displaced by
    the arm's own screws."""
    out = []
    for term in mechanism.terms:  # type: ignore[attr-defined]
        d = np.zeros((len(J), 3))
        for s in term.screws:
            d += (
                J[:, s.frame - 1, AXES.index(s.axis)]
                * np.broadcast_to(s.cause.of(problem), len(J))[:, None]
            )
        out.append(d.ravel())
    return np.stack(out, 1)


def holds(A: np.ndarray, b: np.ndarray, Q: np.ndarray) -> float:
    """Share of the norm of b that the span of A holds, both cleared of Q."""
    A, b = off(Q, A / np.maximum(np.linalg.norm(A, axis=0), 1e-300)), off(Q, b)
    U, S, _ = np.linalg.svd(A, full_matrices=False)
    U = U[:, S > 1e-6]
    return float(np.linalg.norm(U.T @ b) / max(np.linalg.norm(b), 1e-300))
