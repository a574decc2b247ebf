"""Effects to plant, drawn: the catalogue's, each by a formula of its own, and others that no
catalogue has."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from hidden_arm import Arm, Effect, State, Term

Draw = Callable[[np.random.Generator, Arm], Effect]
Values = Callable[[State], np.ndarray]


def at(frame: int, axis: str, values: Values) -> Term:
    """A screw of one frame (1-based), its size per row from the state."""

    def term(s: State) -> tuple[np.ndarray, np.ndarray]:
        twist = np.zeros((s.m, s.arm.n + 1, 6))
        twist[:, frame - 1, ("tx", "ty", "tz", "rx", "ry", "rz").index(axis)] = values(s)
        return twist, np.zeros((s.m, 3))

    return term


def together(*parts: Term) -> Term:
    """Several screws as one term."""

    def term(s: State) -> tuple[np.ndarray, np.ndarray]:
        all_ = [p(s) for p in parts]
        return np.asarray(sum(t for t, _ in all_)), np.asarray(sum(d for _, d in all_))

    return term


def shifted(values: Callable[[State, np.ndarray], np.ndarray]) -> Term:
    """A shift of the measured point from the state and the nominal target (m, 3)."""
    return lambda s: (np.zeros((s.m, s.arm.n + 1, 6)), values(s, s.places()[0]))


def sign(rng: np.random.Generator) -> float:
    return float(rng.choice([-1.0, 1.0]))


def origin(frame: int) -> Callable[[State], np.ndarray]:
    return lambda s: s.places()[1][frame - 1][:, :3, 3]


def forearm_end(arm: Arm) -> int:
    """Frame (1-based) at the forearm's end: the wrist's centre, or the first wrist joint where it
    lies parallel."""
    Z = np.linalg.multi_dot([arm.before[k][:3, :3] for k in range(2, 4)])
    return 4 if abs(Z[2, 2]) > 0.99 else 5


def pull(joint: int, frame: int) -> Values:
    """Gravity torque about a joint of 1 kg at a frame's origin."""
    return lambda s: s.torque_of(joint, origin(frame)(s))


def one(kind: str, words: str, term: Term, size: float) -> Effect:
    return Effect(kind, words, (term,), np.array([size]))


def pair(
    kind: str, words: str, frame: int, axis: str, angle: Values, rng: np.random.Generator
) -> Effect:
    """Sine and cosine of unknown phase at one place."""
    phase = rng.uniform(0, 2 * np.pi)
    return Effect(
        kind,
        words,
        (at(frame, axis, lambda s: np.sin(angle(s))), at(frame, axis, lambda s: np.cos(angle(s)))),
        np.array([np.cos(phase), np.sin(phase)]),
    )


# -- the catalogue's
# --------------------------------------------------------------------------------------------------------


def _twist2(rng: np.random.Generator, arm: Arm) -> Effect:
    far = forearm_end(arm)
    return Effect(
        "joint2-twist",
        f"joint 2 winds up under masses at frames 3 and {far}",
        (at(2, "rz", pull(2, 3)), at(2, "rz", pull(2, far))),
        rng.uniform(0.3, 1, 2),
    )


def _twist3(rng: np.random.Generator, arm: Arm) -> Effect:
    far = forearm_end(arm)
    return one(
        "joint3-twist",
        f"joint 3 winds up under a mass at frame {far}",
        at(3, "rz", pull(3, far)),
        1.0,
    )


def _twists(rng: np.random.Generator, arm: Arm) -> Effect:
    two, three = _twist2(rng, arm), _twist3(rng, arm)
    return Effect(
        "gravity-twist",
        "joints 2 and 3 wind up",
        two.terms + three.terms,
        np.r_[two.sizes, rng.uniform(0.3, 1)],
    )


def _compliance(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(2, 6))
    return one(
        "joint-compliance",
        f"joint {j} yields to its gravity torque",
        at(j, "rz", lambda s: s.moment(j)[:, 2]),
        1.0,
    )


def _lateral(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(2, 6))
    return Effect(
        "lateral-compliance",
        f"the bearing of joint {j} yields across",
        tuple(at(j, f"r{'xy'[a]}", lambda s, a=a: s.moment(j)[:, a]) for a in (0, 1)),
        rng.uniform(0.3, 1, 2),
    )


def _bending(rng: np.random.Generator, arm: Arm) -> Effect:
    f = int(rng.integers(2, 6))
    return one(
        "link-bending",
        f"link {f - 1} bends",
        together(*(at(f, f"r{'xyz'[a]}", lambda s, a=a: s.moment(f)[:, a]) for a in range(3))),
        1.0,
    )


def _payload(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(2, 6))
    return one(
        "payload-deflection",
        f"joint {j} yields under the payload",
        at(j, "rz", lambda s: s.covariates["payload_kg"] * s.torque_of(j, s.places()[0])),
        1.0,
    )


def _counterbalance(rng: np.random.Generator, arm: Arm) -> Effect:
    probe = np.zeros((2, arm.n))
    probe[1, 1] = np.pi / 2
    lever = pull(2, 3)(State(arm, probe))
    phase = float(np.arctan2(-lever[1], lever[0]))
    return Effect(
        "counterbalance",
        "a spring at joint 2",
        (
            at(2, "rz", lambda s: np.sin(s.q[:, 1] + phase)),
            at(2, "rz", lambda s: np.sin(2 * (s.q[:, 1] + phase))),
        ),
        rng.uniform(0.3, 1, 2) * [sign(rng), sign(rng)],
    )


def _droop(rng: np.random.Generator, arm: Arm) -> Effect:
    def across(a: int) -> Values:
        return lambda s: -s.places()[1][-1][:, 2, a]

    return one(
        "tool-droop",
        "the tool droops",
        together(at(arm.n + 1, "tx", across(0)), at(arm.n + 1, "ty", across(1))),
        1.0,
    )


def _backlash(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(2, 5))
    torque = pull(3, forearm_end(arm)) if j == 3 else (lambda s: s.moment(j)[:, 2])
    return one(
        "backlash",
        f"gravity takes up the play of joint {j}",
        at(j, "rz", lambda s: np.sign(torque(s))),
        sign(rng),
    )


def _approach(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(1, arm.n + 1))
    return one(
        "approach-backlash",
        f"joint {j} stops short",
        at(j, "rz", lambda s: np.sign(s.move[:, j - 1])),
        sign(rng),
    )


def _settle(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(1, arm.n + 1))
    return one(
        "settle", f"joint {j} read too early", at(j, "rz", lambda s: s.move[:, j - 1]), sign(rng)
    )


def _waves(kind: str, waves: Callable[[np.random.Generator], int]) -> Draw:
    def draw(rng: np.random.Generator, arm: Arm) -> Effect:
        j, k = int(rng.integers(1, arm.n + 1)), waves(rng)
        return pair(kind, f"joint {j}, {k} waves a turn", j, "rz", lambda s: k * s.q[:, j - 1], rng)

    return draw


def _scale(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(1, arm.n + 1))
    return one(
        "encoder-scale", f"encoder of joint {j}", at(j, "rz", lambda s: s.q[:, j - 1]), sign(rng)
    )


def _wobble(rng: np.random.Generator, arm: Arm) -> Effect:
    j, k, phase, turns = (
        int(rng.integers(1, arm.n + 1)),
        int(rng.integers(1, 3)),
        rng.uniform(0, 2 * np.pi),
        sign(rng),
    )
    terms = tuple(
        at(j, axis, lambda s, f=f: f(k * s.q[:, j - 1]))
        for axis in ("rx", "ry")
        for f in (np.sin, np.cos)
    )
    return Effect(
        "axis-wobble",
        f"axis {j} wobbles {k} times a turn",
        terms,
        np.array([np.cos(phase), np.sin(phase), -turns * np.sin(phase), turns * np.cos(phase)]),
    )


def _wrist(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(arm.n - 1, arm.n + 1))
    terms = tuple(at(j, "rz", lambda s, d=d: s.q[:, d - 1]) for d in range(arm.n - 2, j))
    return Effect(
        "wrist-coupling",
        f"joint {j} turns with the wrist's earlier joints",
        terms,
        np.array([sign(rng) * rng.uniform(0.3, 1) for _ in terms]),
    )


def _tilt(rng: np.random.Generator, arm: Arm) -> Effect:
    terms = tuple(
        shifted(lambda s, x, a=a: s.moment(0)[:, a, None] * np.cross(np.eye(3)[a], x))
        for a in (0, 1)
    )
    return Effect("base-tilt", "the base tilts under the arm", terms, rng.uniform(0.5, 1, 2))


def _along(arm: Arm, link: int) -> Term:
    N = arm.before[link] if link < arm.n else arm.last
    v = N[:3, :3].T @ N[:3, 3]
    return together(
        *(
            at(link + 1, f"t{'xyz'[a]}", lambda s, a=a: v[a] * (s.covariates["temperature_C"] - 20))
            for a in range(3)
        )
    )


def _growth(rng: np.random.Generator, arm: Arm) -> Effect:
    long = [k for k in range(1, arm.n) if np.linalg.norm(arm.before[k][:3, 3]) > 30]
    k = int(rng.choice(long))
    return one("thermal-growth", f"link {k} grows", _along(arm, k), 1.0)


def _expansion(rng: np.random.Generator, arm: Arm) -> Effect:
    return one(
        "thermal-expansion",
        "the arm grows",
        together(*(_along(arm, k) for k in range(arm.n + 1))),
        1.0,
    )


def _zero(rng: np.random.Generator, arm: Arm) -> Effect:
    j = int(rng.integers(1, arm.n + 1))
    return one(
        "thermal-zero",
        f"the zero of joint {j} wanders",
        at(j, "rz", lambda s: s.covariates["temperature_C"] - 20),
        sign(rng),
    )


def _rigid(
    kind: str, words: str, of_time: Callable[[np.ndarray], np.ndarray], rng: np.random.Generator
) -> Effect:
    terms = [
        shifted(lambda s, x, a=a: of_time(s.progress)[:, None] * np.tile(np.eye(3)[a], (s.m, 1)))
        for a in range(3)
    ]
    terms += [
        shifted(lambda s, x, a=a: of_time(s.progress)[:, None] * np.cross(np.eye(3)[a], x))
        for a in range(3)
    ]
    return Effect(
        kind, words, tuple(terms), rng.normal(size=6) * np.r_[np.ones(3), np.full(3, 1e-3)]
    )


def _drift(rng: np.random.Generator, arm: Arm) -> Effect:
    return _rigid("tracker-drift", "the tracker drifts", lambda t: t, rng)


def _step(rng: np.random.Generator, arm: Arm) -> Effect:
    when = rng.uniform(0.15, 0.85)
    return _rigid(
        "tracker-step", f"the tracker was bumped at {when:.2f}", lambda t: np.sign(t - when), rng
    )


def _refraction(rng: np.random.Generator, arm: Arm) -> Effect:
    return one(
        "refraction",
        "the beam is bent",
        shifted(lambda s, x: np.square(x).sum(1)[:, None] * [0, 0, 1.0]),
        sign(rng),
    )


REGISTERED: Mapping[str, Draw] = {
    "joint2-twist": _twist2,
    "joint3-twist": _twist3,
    "gravity-twist": _twists,
    "joint-compliance": _compliance,
    "lateral-compliance": _lateral,
    "link-bending": _bending,
    "payload-deflection": _payload,
    "counterbalance": _counterbalance,
    "tool-droop": _droop,
    "backlash": _backlash,
    "approach-backlash": _approach,
    "settle": _settle,
    "gear-eccentricity": _waves("gear-eccentricity", lambda rng: 1),
    "encoder-eccentricity": _waves("encoder-eccentricity", lambda rng: 2),
    "gear-ripple": _waves("gear-ripple", lambda rng: int(rng.integers(3, 61))),
    "encoder-scale": _scale,
    "axis-wobble": _wobble,
    "wrist-coupling": _wrist,
    "base-tilt": _tilt,
    "thermal-growth": _growth,
    "thermal-expansion": _expansion,
    "thermal-zero": _zero,
    "tracker-drift": _drift,
    "tracker-step": _step,
    "refraction": _refraction,
}


# -- what no catalogue has
# ----------------------------------------------------------------------------------------------------


def _place(rng: np.random.Generator, arm: Arm) -> tuple[int, str]:
    return int(rng.integers(1, arm.n + 1)), str(rng.choice(["tx", "ty", "tz", "rx", "ry", "rz"]))


def _coupling(rng: np.random.Generator, arm: Arm) -> Effect:
    j, k = rng.choice(np.arange(1, arm.n + 1), 2, replace=False)
    return one(
        "odd coupling",
        f"joint {j} turns with joint {k}",
        at(int(j), "rz", lambda s: s.q[:, k - 1]),
        sign(rng),
    )


def _cell_wave(rng: np.random.Generator, arm: Arm) -> Effect:
    (f, a), j, k = _place(rng, arm), int(rng.integers(1, arm.n + 1)), int(rng.integers(1, 3))
    return pair(
        "wave at a cell", f"frame {f} {a} with {k} q{j}", f, a, lambda s: k * s.q[:, j - 1], rng
    )


def _cell_single(rng: np.random.Generator, arm: Arm) -> Effect:
    (f, a), j, k = _place(rng, arm), int(rng.integers(1, arm.n + 1)), int(rng.integers(1, 3))
    return one(
        "sine at a cell",
        f"frame {f} {a} with sin({k} q{j})",
        at(f, a, lambda s: np.sin(k * s.q[:, j - 1])),
        sign(rng),
    )


def _cell_sum(rng: np.random.Generator, arm: Arm) -> Effect:
    (f, a), j, pm = _place(rng, arm), int(rng.integers(1, arm.n)), sign(rng)
    return pair(
        "wave of two joints",
        f"frame {f} {a} with q{j} {'+' if pm > 0 else '-'} q{j + 1}",
        f,
        a,
        lambda s: s.q[:, j - 1] + pm * s.q[:, j],
        rng,
    )


def _cell_approach(rng: np.random.Generator, arm: Arm) -> Effect:
    (f, a), j = _place(rng, arm), int(rng.integers(1, arm.n + 1))
    return one(
        "approach at a cell",
        f"frame {f} {a} with the direction of joint {j}",
        at(f, a, lambda s: np.sign(s.move[:, j - 1])),
        sign(rng),
    )


def _cell_warm(rng: np.random.Generator, arm: Arm) -> Effect:
    f, a = _place(rng, arm)
    return one(
        "temperature at a cell",
        f"frame {f} {a} with temperature",
        at(f, a, lambda s: s.covariates["temperature_C"] - 20),
        sign(rng),
    )


def _shape(rng: np.random.Generator, arm: Arm) -> Effect:
    j, c, w = int(rng.integers(1, arm.n + 1)), rng.uniform(-0.5, 0.5), rng.uniform(0.15, 0.4)
    return one(
        "shape of one joint",
        f"joint {j}: a smooth step at {c:.2f}",
        at(j, "rz", lambda s: np.tanh((s.q[:, j - 1] - c) / w)),
        sign(rng),
    )


def _fold(rng: np.random.Generator, arm: Arm) -> Effect:
    j, c = int(rng.integers(1, arm.n + 1)), rng.uniform(-0.5, 0.5)
    return one(
        "kink of one joint",
        f"joint {j}: |q - {c:.2f}|",
        at(j, "rz", lambda s: np.abs(s.q[:, j - 1] - c)),
        sign(rng),
    )


def _product(rng: np.random.Generator, arm: Arm) -> Effect:
    (f, a), (j, k) = _place(rng, arm), rng.choice(np.arange(1, arm.n + 1), 2, replace=False)
    return one(
        "product of joints",
        f"frame {f} {a} with sin q{j} sin q{k}",
        at(f, a, lambda s: np.sin(s.q[:, j - 1]) * np.sin(s.q[:, k - 1])),
        sign(rng),
    )


def _fraction(rng: np.random.Generator, arm: Arm) -> Effect:
    j, k = int(rng.integers(1, arm.n + 1)), int(rng.integers(3, 30)) + 0.5
    return pair(
        "fractional ripple",
        f"joint {j}, {k} waves a turn",
        j,
        "rz",
        lambda s: k * s.q[:, j - 1],
        rng,
    )


UNREGISTERED: Mapping[str, Draw] = {
    "odd coupling": _coupling,
    "wave at a cell": _cell_wave,
    "sine at a cell": _cell_single,
    "wave of two joints": _cell_sum,
    "approach at a cell": _cell_approach,
    "temperature at a cell": _cell_warm,
    "shape of one joint": _shape,
    "kink of one joint": _fold,
    "product of joints": _product,
    "fractional ripple": _fraction,
}
