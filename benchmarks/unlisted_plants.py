"""What `benchmarks.unlisted` plants: the kinds of its table, and what is true of each.

Kinematics, gravity and every formula are those of tests/support/hidden_arm.py and of this file; of
the package come only the robots' drawings. What is true, kind by kind:

| kind | place | drivers | registered names that are true |
|---|---|---|---|
| hardening spring: θj + c sign(τ) abs(τ)^1.5 | joint j | joints that turn its torque | joint-compliance:j and joint's twist: it does wind up under gravity |
| cable pull: θ4 + c tanh(q4) (1 + tanh(q1)) | joint 4 | q4, q1 | none |
| base sag: base down by c r³, r the target's horizontal distance | base | joints that change r | none |
| lag of all joints: θ - c last move, one c | joints | own last moves | fault:read-too-early, settle:j |
| growth: θj + c t sin(qj), t from 0 to 1 | joint j | qj, time | none: an eccentric gear does not grow |
| encoder jump: θj + c where qj > a | joint j | qj | none |
| sawtooth: θj + c times a saw of k teeth a turn, k 3 to 12 | joint j | qj | gear-ripple:j of k, 2 k … waves |
| random stiction: joint j stays c behind in a third of its moves | joint j | its last move | approach-backlash:j, which is its mean |
| exponential drift: base along x, y or z by c (1 - exp(-t/T)) | base | time | tracker-drift |
| coupling of 2 to 3: θ3 + c max(0, q2 - a)² | joint 3 | q2 | none |
| a link longer with load: along the link by c payload_kg | next frame | payload | none |
| noise that varies: up to 1 to 8 times louder with sin(qj) | - | - | none |
| constant tool error: the target off by c | - | - | none: geometry has it |
| lag of joints 1 to 3: each by its own share of its last move | joints 1 to 3 | own last moves | settle:1, settle:2, settle:3 |
| bump: θj + c exp(-(qj - a)²/2w²), w 0.2 rad | joint j | qj | none |
| play that gives way: θj + c sign(τ) max(0, abs(τ) - half its mean) | joint j | joints that turn its torque | as the spring |
| product: θj + c qa qb of two other joints | joint j | qa, qb | none |
| creep: θj + c qj sqrt(t) | joint j | qj, time | none |
| wrist that bends: the last frame along x by c exp(q of the joint before) | last frame | that joint | none |
| dent: θj + c (1 + cos(π (qj - a)/w)) within w of a, w 0.2 to 0.6 rad | joint j | qj | none |
| settling: θj + c sin(qj) log(1 + 9 t) | joint j | qj, time | none: an eccentric gear does not settle |
| soft lag: θj - c tanh(3 times its last move) | joint j | its last move | settle:j, approach-backlash:j: it is something of both |
| sway: base along x, y or z by c sin(2πt + φ) | base | time | none |
| difference: θ3 + c sin(2(q2 - q3) + φ) | joint 3 | q2, q3 | none |
| warm: θj + c times how far it moved lately, a running mean of abs(last move) over a tenth of the campaign | joint j | its last moves, time | none |
| any: a place and one or two drivers (a joint's reading, its last move, time, payload) that are drawn, and of these a smooth function that is drawn: a Gaussian process with a length of 0.3 to 1 in units of 2 rad | that | those | none |
| drag: θj + c y, y drawn along by qj once it is w ahead, w 0.6 to 1.5 rad (a play operator) | joint j | qj, its last move | approach-backlash:j: of long moves it is play |

The next five came later, when the search was finished. Three of them led to candidates or rivals
afterwards: products of two readings, errors around one reading (bump), and shapes that change along
the campaign (creep). Three more came after these; the soft lag then led to rivals, and the dent, told
as bumps are, was looked at when these became candidates. The last four came after that: the
difference led to waves of two readings at a joint that seems not to repeat, later as rivals, too, the
sway to slow waves along the campaign; what warms and what drags came last. What drags led to hysteresis
that remembers, as rivals and at a joint that seems not to repeat. With what warms, with what settles, with play
that gives way and with the wrist that bends, no candidate and no constant was chosen. What is drawn
came when the search was finished again; functions of any shape at a joint that seems not to repeat,
powers of covariates with few values, and prior probabilities of unlisted shapes followed from it.

Random stiction is an error that does not repeat. To say that the joint does not repeat is to tell its
place, by `repeatability` of the result as by a finding of its mean.

A place is true also where another axis moves the target exactly alike (joint 4's and the one across
it in frame 5, where they meet); what moves
the base may turn it, too, but not alone. A formula (a shape) is true if place and drivers are, and it holds
0.97 of what one part of the plant does to the target beyond the geometry; of a sawtooth, every wave
and every saw of a multiple of its teeth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from hidden_arm import Arm, Effect, State
from hidden_effects import Values, at, together

Array = np.ndarray
Generator = np.random.Generator

# the target's largest displacement by what is planted, over the noise; of the joints that lag alone
SIZES, LAGS = (1.0, 8.0), (4.0, 8.0)
# share of moves in which a joint sticks
STICKS = 1 / 3
# width of a bump [rad]
BUMP = 0.2
# share of the campaign over which a joint keeps its warmth
WARMS_FOR = 0.1
# waves of a function that is drawn
WAVES_DRAWN = 40
# share of a value's variance that goes with a driver: from which it must be named, and may be
NEEDED, ALLOWED = 0.2, 0.01


@dataclass(frozen=True, eq=False)
class Plant:
    """What is planted in a study, and what is true of it.

    `parts`: effects with a size each; `known`: as much of them as readings tell (None: all);
    `stems`: registered names that are true at a true place; `teeth`: of a sawtooth; `drivers`
    beyond the joints' readings: those that must be named; `joints`: whether readings of joints
    drive it; `louder`: over the plain noise, of every row; `base`: the base moves as a whole."""

    words: str
    parts: tuple[Effect, ...] = ()
    known: tuple[Effect, ...] | None = None
    stems: frozenset[str] = frozenset()
    teeth: int = 0
    drivers: frozenset[str] = frozenset()
    optional: frozenset[str] = frozenset()
    joints: bool = False
    louder: Values | None = None
    base: bool = False

    @property
    def told(self) -> tuple[Effect, ...]:
        """What the readings tell of the parts."""
        return self.parts if self.known is None else self.known


Draw = Callable[[Generator, Arm], Plant]
# kinds in the order in which they came to the benchmark
GROUPS = ("the first thirteen", "the next five", "three more", "the last four", "drawn")


@dataclass(frozen=True)
class Kind:
    """A line of the benchmark: how it is drawn; `exact`: the names that must be found, and no
    other; which of GROUPS it is in; `sizes`; whether the payload varies; whether geometry leaves something to find; whether it
    jumps: between two readings the data say nothing of where it does; and whether it `repeats`: what
    does not is rightly told in the budget of repeatability, too."""

    words: str
    draw: Draw
    exact: tuple[str, ...] = ()
    group: str = GROUPS[0]
    sizes: tuple[float, float] = SIZES
    payload: bool = False
    visible: bool = True
    jumps: bool = False
    repeats: bool = True


def turn(joint: int, values: Values) -> Effect:
    """A turn of a joint on top of its reading."""
    return one_part(f"joint {joint}", at(joint, "rz", values))


def one_part(words: str, *terms: object) -> Effect:
    """Screws that one number scales."""
    return Effect("planted", words, (together(*terms),), np.ones(1))  # type: ignore[arg-type]


def draw_joint(rng: Generator, arm: Arm) -> int:
    return int(rng.integers(1, arm.n + 1))


def draw_loaded(rng: Generator, arm: Arm) -> int:
    """Draw one of the two joints whose torque changes most."""
    probe = State(arm, arm.draw(np.random.default_rng(0), 100))
    loads = [probe.moment(j)[:, 2].std() for j in range(1, arm.n + 1)]
    return int(rng.choice(np.argsort(loads)[-2:])) + 1


def draw_spring(rng: Generator, arm: Arm) -> Plant:
    j = draw_loaded(rng, arm)

    def harden(s: State) -> Array:
        torque = s.moment(j)[:, 2]
        return np.sign(torque) * np.abs(torque) ** 1.5

    stems = frozenset(("joint-compliance", "joint2-twist", "joint3-twist"))
    return Plant(f"spring of joint {j} hardens", (turn(j, harden),), stems=stems, joints=True)


def draw_cable(rng: Generator, arm: Arm) -> Plant:
    def pull(s: State) -> Array:
        return np.tanh(s.q[:, 3]) * (1 + np.tanh(s.q[:, 0]))

    return Plant("a cable pulls joint 4", (turn(4, pull),), joints=True)


def draw_sag(rng: Generator, arm: Arm) -> Plant:
    def sag(s: State) -> Array:
        x, _ = s.places()
        return -((np.linalg.norm(x[:, :2], axis=1) / 1e3) ** 3)

    return Plant("the base sags", (one_part("base", at(1, "tz", sag)),), joints=True, base=True)


def stay_behind(joint: int) -> Values:
    return lambda s: -s.move[:, joint - 1]


def draw_lag(rng: Generator, arm: Arm) -> Plant:
    joints = range(1, arm.n + 1)
    every = one_part("all joints", *(at(j, "rz", stay_behind(j)) for j in joints))
    moves = frozenset(f"move{j}" for j in joints)
    stems = frozenset(("fault:read-too-early", "settle"))
    return Plant("all joints lag", (every,), stems=stems, optional=moves)


def draw_three_lags(rng: Generator, arm: Arm) -> Plant:
    parts = tuple(turn(j, stay_behind(j)) for j in (1, 2, 3))
    moves = frozenset(f"move{j}" for j in (1, 2, 3))
    return Plant("joints 1 to 3 lag", parts, stems=frozenset(("settle",)), drivers=moves)


def draw_growth(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)
    grow = turn(j, lambda s: s.progress * np.sin(s.q[:, j - 1]))
    return Plant(f"an error of joint {j} grows", (grow,), drivers=frozenset(("time",)), joints=True)


def draw_jump(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)
    low, high = arm.limits[j - 1]
    angle = low + rng.uniform(0.25, 0.75) * (high - low)
    jump = turn(j, lambda s: (s.q[:, j - 1] > angle).astype(float))
    return Plant(f"joint {j} jumps at {np.degrees(angle):.0f}°", (jump,), joints=True)


def draw_sawtooth(rng: Generator, arm: Arm) -> Plant:
    j, teeth, phase = draw_joint(rng, arm), int(rng.integers(3, 13)), rng.uniform(0, 2 * np.pi)

    def saw(s: State) -> Array:
        return np.mod(teeth * s.q[:, j - 1] + phase, 2 * np.pi) / np.pi - 1

    stems = frozenset(("gear-ripple",))
    words = f"joint {j}, a saw of {teeth} teeth"
    return Plant(words, (turn(j, saw),), stems=stems, teeth=teeth, joints=True)


def draw_stiction(rng: Generator, arm: Arm) -> Plant:
    j, seed = draw_joint(rng, arm), int(rng.integers(2**31))

    def stick(s: State) -> Array:
        sticks = np.random.default_rng((seed, s.m)).random(s.m) < STICKS
        return -np.sign(s.move[:, j - 1]) * sticks

    mean = turn(j, lambda s: -STICKS * np.sign(s.move[:, j - 1]))
    return Plant(
        f"joint {j} sticks at random",
        (turn(j, stick),),
        (mean,),
        frozenset(("approach-backlash",)),
        drivers=frozenset((f"move{j}",)),
    )


def draw_drift(rng: Generator, arm: Arm) -> Plant:
    axis, lasts = str(rng.choice(["tx", "ty", "tz"])), rng.uniform(0.05, 0.4)
    drift = one_part("base", at(1, axis, lambda s: 1 - np.exp(-s.progress / lasts)))
    return Plant(
        f"base drifts along {axis}",
        (drift,),
        stems=frozenset(("tracker-drift",)),
        drivers=frozenset(("time",)),
        base=True,
    )


def draw_coupling(rng: Generator, arm: Arm) -> Plant:
    low, high = arm.limits[1]
    angle = low + rng.uniform(0.3, 0.6) * (high - low)
    tighten = turn(3, lambda s: np.maximum(s.q[:, 1] - angle, 0) ** 2)
    return Plant(f"joint 2 turns joint 3 beyond {np.degrees(angle):.0f}°", (tighten,), joints=True)


def draw_link(rng: Generator, arm: Arm) -> Plant:
    shifts = [N[:3, :3].T @ N[:3, 3] for N in arm.before]
    long = [k for k in range(1, arm.n) if np.linalg.norm(shifts[k]) > 100]
    k = int(rng.choice(long))
    along = shifts[k] / np.linalg.norm(shifts[k])
    terms = [
        at(k + 1, f"t{'xyz'[a]}", lambda s, a=a: along[a] * s.covariates["payload_kg"])
        for a in np.flatnonzero(np.abs(along) > 1e-6)
    ]
    longer = one_part(f"link {k}", *terms)
    return Plant(f"link {k} longer with load", (longer,), drivers=frozenset(("payload",)))


def draw_uneven(rng: Generator, arm: Arm) -> Plant:
    j, most = draw_joint(rng, arm), rng.uniform(*SIZES)
    louder: Values = lambda s: most ** ((1 + np.sin(s.q[:, j - 1])) / 2)  # noqa: E731
    return Plant(f"up to {most:.1f} times louder with joint {j}", louder=louder)


def draw_tool(rng: Generator, arm: Arm) -> Plant:
    way = rng.standard_normal(3)
    terms = [at(arm.n + 1, f"t{'xyz'[a]}", lambda s, a=a: np.full(s.m, way[a])) for a in range(3)]
    return Plant("the tool is off", (one_part("tool", *terms),), ())


def draw_bump(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)
    low, high = arm.limits[j - 1]
    angle = low + rng.uniform(0.3, 0.7) * (high - low)
    bump = turn(j, lambda s: np.exp(-0.5 * np.square((s.q[:, j - 1] - angle) / BUMP)))
    return Plant(f"joint {j} has a bump at {np.degrees(angle):.0f}°", (bump,), joints=True)


def draw_dead_zone(rng: Generator, arm: Arm) -> Plant:
    j = draw_loaded(rng, arm)

    def give_way(s: State) -> Array:
        torque = s.moment(j)[:, 2]
        beyond = np.abs(torque) - 0.5 * np.abs(torque).mean()
        return np.sign(torque) * np.maximum(beyond, 0)

    stems = frozenset(("joint-compliance", "joint2-twist", "joint3-twist"))
    return Plant(f"joint {j} yields late", (turn(j, give_way),), stems=stems, joints=True)


def draw_product(rng: Generator, arm: Arm) -> Plant:
    j, a, b = (int(k) for k in rng.permutation(arm.n)[:3] + 1)
    both = turn(j, lambda s: s.q[:, a - 1] * s.q[:, b - 1])
    return Plant(f"joints {a} and {b} turn joint {j}", (both,), joints=True)


def draw_creep(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)
    creep = turn(j, lambda s: s.q[:, j - 1] * np.sqrt(s.progress))
    return Plant(f"joint {j} creeps", (creep,), drivers=frozenset(("time",)), joints=True)


def draw_bent_wrist(rng: Generator, arm: Arm) -> Plant:
    bend = one_part("wrist", at(arm.n, "tx", lambda s: np.exp(s.q[:, arm.n - 2])))
    return Plant("the wrist bends", (bend,), joints=True)


def draw_dent(rng: Generator, arm: Arm) -> Plant:
    j, width = draw_joint(rng, arm), rng.uniform(0.2, 0.6)
    low, high = arm.limits[j - 1]
    angle = low + rng.uniform(0.3, 0.7) * (high - low)

    def dip(s: State) -> Array:
        share = np.minimum(np.abs(s.q[:, j - 1] - angle) / width, 1)
        return 1 + np.cos(np.pi * share)

    return Plant(f"joint {j} has a dent at {np.degrees(angle):.0f}°", (turn(j, dip),), joints=True)


def draw_settling(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)
    settle = turn(j, lambda s: np.sin(s.q[:, j - 1]) * np.log1p(9 * s.progress))
    return Plant(f"joint {j} settles", (settle,), drivers=frozenset(("time",)), joints=True)


def draw_soft_lag(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)
    lag = turn(j, lambda s: -np.tanh(3 * s.move[:, j - 1]))
    stems = frozenset(("settle", "approach-backlash"))
    drivers = frozenset((f"move{j}",))
    return Plant(f"joint {j} lags softly", (lag,), stems=stems, drivers=drivers)


def draw_sway(rng: Generator, arm: Arm) -> Plant:
    axis, phase = str(rng.choice(["tx", "ty", "tz"])), rng.uniform(0, 2 * np.pi)
    sway = one_part("base", at(1, axis, lambda s: np.sin(2 * np.pi * s.progress + phase)))
    drivers = frozenset(("time",))
    return Plant(f"base sways along {axis}", (sway,), drivers=drivers, base=True)


def draw_difference(rng: Generator, arm: Arm) -> Plant:
    phase = rng.uniform(0, 2 * np.pi)
    differ = turn(3, lambda s: np.sin(2 * (s.q[:, 1] - s.q[:, 2]) + phase))
    return Plant("joint 3 turns with q2 - q3", (differ,), joints=True)


def draw_warm(rng: Generator, arm: Arm) -> Plant:
    j = draw_joint(rng, arm)

    def warmth(s: State) -> Array:
        kept = np.exp(-1 / (WARMS_FOR * s.m))
        warm, level = np.zeros(s.m), 0.0
        for row, moved in enumerate(np.abs(s.move[:, j - 1])):
            level = kept * level + (1 - kept) * moved
            warm[row] = level
        return warm

    optional = frozenset(("time", f"move{j}"))
    return Plant(f"joint {j} warms with its motion", (turn(j, warmth),), optional=optional)


def draw_drag(rng: Generator, arm: Arm) -> Plant:
    j, width = draw_joint(rng, arm), rng.uniform(0.6, 1.5)

    def dragged(s: State) -> Array:
        q = s.q[:, j - 1]
        y = np.empty(s.m)
        y[0] = q[0]
        for row in range(1, s.m):
            y[row] = np.clip(y[row - 1], q[row] - width, q[row] + width)
        return y - q

    optional = frozenset((f"move{j}", f"q{j}"))
    return Plant(
        f"joint {j} drags {width:.2f} rad",
        (turn(j, dragged),),
        stems=frozenset(("approach-backlash",)),
        optional=optional,
    )


def draw_any(rng: Generator, arm: Arm) -> Plant:
    """Draw a place, one or two drivers, and a smooth function of them: nothing is chosen."""
    frame, axis = draw_place(rng, arm)
    names = draw_drivers(rng, arm, frame)
    function = draw_function(rng, len(names))
    any_effect = one_part("drawn", at(frame, axis, lambda s: function(read_drivers(s, names))))
    beyond = frozenset(name for name in names if not name.startswith("q"))
    return Plant(
        f"frame {frame} {axis}, a drawn function of {' and '.join(names)}",
        (any_effect,),
        drivers=beyond,
        joints=any(name.startswith("q") for name in names),
        base=frame == 1 and axis != "rz",
    )


def draw_place(rng: Generator, arm: Arm) -> tuple[int, str]:
    """Draw a frame and an axis: a joint's turn half the time, else any."""
    if rng.random() < 0.5:
        return draw_joint(rng, arm), "rz"
    return draw_joint(rng, arm), str(rng.choice(["tx", "ty", "tz", "rx", "ry"]))


def draw_drivers(rng: Generator, arm: Arm, frame: int) -> tuple[str, ...]:
    """Draw what drives it: the reading of this joint or another, its last move, time, payload."""
    other = draw_joint(rng, arm)
    names = (f"q{frame}", f"q{other}", f"move{frame}", "time", "payload")
    first = str(rng.choice(names, p=(0.3, 0.3, 0.1, 0.2, 0.1)))
    second = str(rng.choice(names[:2]))
    alone = first == second or rng.random() < 0.5
    return (first,) if alone else (first, second)


def read_drivers(s: State, names: Sequence[str]) -> Array:
    """Read what drives an effect (m, drivers), each in about -1 to 1."""
    columns = []
    for name in names:
        if name == "time":
            columns.append(2 * s.progress - 1)
        elif name == "payload":
            columns.append(s.covariates["payload_kg"] / 5 - 1)
        else:
            values = s.move if name.startswith("move") else s.q
            columns.append(values[:, int(name.lstrip("moveq")) - 1] / 2)
    return np.stack(columns, axis=1)


def draw_function(rng: Generator, drivers: int) -> Callable[[Array], Array]:
    """Draw a smooth function of drivers: random waves, of a Gaussian process with a length of 0.3 to 1."""
    length = rng.uniform(0.3, 1.0)
    waves = rng.standard_normal((drivers, WAVES_DRAWN)) / length
    phases = rng.uniform(0, 2 * np.pi, WAVES_DRAWN)
    return lambda x: np.cos(x @ waves + phases).sum(1)


KINDS: Mapping[str, Kind] = {
    "spring": Kind("spring, c|tau|^1.5", draw_spring),
    "cable": Kind("cable pull, tanh(q4, q1)", draw_cable),
    "sag": Kind("base sag ~ reach^3", draw_sag),
    "lag": Kind("lag of all joints", draw_lag),
    "growth": Kind("growth, t sin q", draw_growth),
    "jump": Kind("encoder jump at one angle", draw_jump, jumps=True),
    "sawtooth": Kind("sawtooth of a joint", draw_sawtooth, jumps=True),
    "stiction": Kind("random stiction", draw_stiction, repeats=False),
    "drift": Kind("exponential drift", draw_drift),
    "coupling": Kind("coupling of 2 to 3", draw_coupling),
    "link": Kind("link longer with load", draw_link, payload=True),
    "noise": Kind("noise that varies", draw_uneven, visible=False),
    "tool": Kind("constant tool error", draw_tool, visible=False),
    "lag-123": Kind(
        "lag of joints 1 to 3", draw_three_lags, ("settle:1", "settle:2", "settle:3"), sizes=LAGS
    ),
    "bump": Kind("bump of a joint", draw_bump, group=GROUPS[1]),
    "dead-zone": Kind("play that gives way", draw_dead_zone, group=GROUPS[1]),
    "product": Kind("product of two joints", draw_product, group=GROUPS[1]),
    "creep": Kind("creep, q sqrt(t)", draw_creep, group=GROUPS[1]),
    "wrist": Kind("wrist that bends, exp(q)", draw_bent_wrist, group=GROUPS[1]),
    "dent": Kind("dent of a joint", draw_dent, group=GROUPS[2]),
    "settling": Kind("settling, log(1 + 9t) sin q", draw_settling, group=GROUPS[2]),
    "soft-lag": Kind("soft lag, tanh(3 moves)", draw_soft_lag, group=GROUPS[2]),
    "sway": Kind("base sways, sin(2 pi t)", draw_sway, group=GROUPS[3]),
    "difference": Kind("sin 2(q2 - q3) at joint 3", draw_difference, group=GROUPS[3]),
    "warm": Kind("joint that its motion warms", draw_warm, group=GROUPS[3]),
    "drag": Kind("cable that is drawn along", draw_drag, group=GROUPS[3]),
    "any": Kind("anything, drawn", draw_any, group=GROUPS[4], payload=True),
}


def scale_parts(plant: Plant, state: State, sizes: Array) -> Plant:
    """The same plant, the target's largest displacement by every part of a size [mm] (parts,)."""
    J = state.arm.screws(state.q)
    factors = [
        size / np.linalg.norm((part.columns(state, J) @ part.sizes).reshape(-1, 3), axis=1).max()
        for part, size in zip(plant.parts, sizes, strict=True)
    ]
    parts = tuple(part.scaled(f) for part, f in zip(plant.parts, factors, strict=True))
    known = plant.known
    if known:
        known = tuple(part.scaled(f) for part, f in zip(known, factors, strict=True))
    return replace(plant, parts=parts, known=known)


@dataclass(frozen=True)
class Truth:
    """What is true of a plant on a campaign: places (frame, axis), of which those `aside` are true
    with others only; drivers that must be named, and that may be."""

    places: frozenset[tuple[int, str]] = frozenset()
    aside: frozenset[tuple[int, str]] = frozenset()
    needed: frozenset[str] = frozenset()
    allowed: frozenset[str] = frozenset()

    def holds_place(self, places: frozenset[tuple[int, str]]) -> bool:
        """Whether something that moves these places is where the plant is."""
        return places <= self.places and not places <= self.aside


def find_truth(plant: Plant, state: State, rng: Generator) -> Truth:
    """Find what is true of a plant, on configurations drawn anew."""
    parts = plant.told
    if not parts:
        return Truth()
    twist = sum(np.abs(part.perturbation(state)[0]) for part in parts).max(0)
    axes = ("tx", "ty", "tz", "rx", "ry", "rz")
    own = [(int(f), int(a)) for f, a in zip(*np.nonzero(twist))]
    places = find_alike(state, own)
    if plant.base:
        places |= {(0, a) for a in range(6)}
    shares = measure_drivers(lambda s: sum(p.perturbation(s)[0] for p in parts), state, rng)
    joints = shares if plant.joints else {}
    return Truth(
        frozenset((f + 1, axes[a]) for f, a in places),
        frozenset(((1, "rz"),) if plant.base else ()),
        plant.drivers | {j for j, share in joints.items() if share > NEEDED},
        plant.drivers | plant.optional | {j for j, share in joints.items() if share > ALLOWED},
    )


def find_alike(state: State, own: list[tuple[int, int]]) -> set[tuple[int, int]]:
    """Find the places (frame, axis), counted from 0, that move the target as one of these does."""
    J = state.arm.screws(state.q, exact=False)
    flat = J.transpose(1, 2, 0, 3).reshape(J.shape[1], 6, -1)
    unit = flat / np.maximum(np.linalg.norm(flat, axis=-1, keepdims=True), 1e-12)
    alike = [np.abs(unit @ unit[f, a]) > 0.999 for f, a in own]
    return {(int(f), int(a)) for hits in alike for f, a in zip(*np.nonzero(hits))}


def measure_drivers(
    values: Callable[[State], Array], state: State, rng: Generator
) -> dict[str, float]:
    """Measure the share of the variance of a function of the state that goes with every joint's
    reading: its total effect, by readings exchanged between configurations."""
    plain = values(state)
    varies = float(np.square(plain - plain.mean(0)).sum())
    order = rng.permutation(state.m)
    shares = {}
    for j in range(state.arm.n):
        q = state.q.copy()
        q[:, j] = q[order, j]
        changed = float(np.square(values(replace(state, q=q)) - plain).sum())
        shares[f"q{j + 1}"] = changed / (2 * varies) if varies else 0.0
    return shares
