"""Campaigns of which some targets slip on the flange, by exact chains of the tests' own."""

from __future__ import annotations

import numpy as np
from builders import study_of
from hidden_arm import Arm, arm

from modelsel.diagnosis.findings.effects import Effect
from modelsel.diagnosis.procedure import diagnose_split
from modelsel.diagnosis.separation import Inquiry
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import BUILTIN, build_faults, every, mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import Robot

ROBOTS = ("irb120", "ur5e", "puma560")
SIGMA = 0.02
NAMES = ("A", "B", "C", "D", "E")
TOOLS = np.array(
    [
        [40.0, -30.0, 110.0],
        [40.0, 60.0, 90.0],
        [-50.0, 10.0, 120.0],
        [-20.0, -70.0, 80.0],
        [75.0, 5.0, 60.0],
    ]
)
Rng = np.random.Generator


def measure(
    body: Arm,
    q: np.ndarray,
    tools: np.ndarray,
    shifts: np.ndarray,
    rng: Rng,
    zeros: np.ndarray | float = 0.0,
) -> np.ndarray:
    """Positions (m, T, 3) of targets that are shifted (m, T, 3) on the flange, with noise; joint 3
    is off its reading by `zeros` (m,)."""
    twist = np.zeros((len(q), body.n + 1, 6))
    twist[:, 2, 5] = zeros
    positions = []
    for target, tool in enumerate(tools):
        own = twist.copy()
        own[:, -1, :3] = shifts[:, target]
        carried = Arm(**{**body.__dict__, "tool": tool})
        place, _ = carried.chain(q, own)
        positions.append(place)
    exact = np.stack(positions, axis=1)
    return exact + rng.normal(0, SIGMA, exact.shape)


def draw_slip(rng: Rng) -> np.ndarray:
    """A shift (3,) of 0.2 to 0.5 mm."""
    direction = rng.normal(size=3)
    return rng.uniform(0.2, 0.5) * direction / np.linalg.norm(direction)


def draw_campaign(rng: Rng, moved: list[int], count: int = 3) -> tuple[Problem, int, np.ndarray]:
    """A campaign whose `moved` targets slip together at a drawn configuration, by 0.2 to 0.5 mm."""
    robot = load_robot(ROBOTS[int(rng.integers(len(ROBOTS)))])
    body = arm(robot, rng)
    m = int(rng.integers(60, 100))
    row = int(rng.integers(m // 4, 3 * m // 4))
    slip = draw_slip(rng)
    q = body.draw(rng, m, 2.6)
    shifts = np.zeros((m, count, 3))
    shifts[row:, moved] = slip
    position = measure(body, q, TOOLS[:count], shifts, rng)
    return bind_targets(robot, q, position), row, slip


def bind_targets(
    robot: Robot, q: np.ndarray, position: np.ndarray, keep: np.ndarray | None = None
) -> Problem:
    """Positions (m, T, 3) of every target, of which some (m, T) are kept."""
    m, count, _ = position.shape
    kept = np.ones(m * count, bool) if keep is None else keep.ravel()
    target = np.tile(NAMES[:count], m)[kept]
    readings = np.repeat(q, count, axis=0)[kept]
    data = build_measurements(readings, position.reshape(-1, 3)[kept], target=target)
    order = [NAMES.index(name) for name in data.targets]
    return Problem(robot, data, TOOLS[order])


def slip_each(rng: Rng, rows: dict[int, int]) -> Problem:
    """A campaign of 80 configurations and three targets, of which some slip, each from a row on."""
    robot = load_robot("irb120")
    body = arm(robot, rng)
    q = body.draw(rng, 80, 2.6)
    shifts = np.zeros((80, 3, 3))
    for target, row in rows.items():
        shifts[row:, target] = draw_slip(rng)
    return bind_targets(robot, q, measure(body, q, TOOLS[:3], shifts, rng))


def explain(at: Problem) -> tuple[Effect, ...]:
    """The effects beyond the geometry and where each target sits, as a study has them."""
    robot = at.robot
    offsets = build_setup(robot, len(at.data.targets), 1, register=False, orientation=False)
    base = Model((offsets, mechanism("geometric", robot)))
    offered = (*build_faults(robot), *offer(at))
    return diagnose_split(study_of(at), Inquiry(base, offered, 1, cells=True))[1].effects


def offer(at: Problem) -> tuple[Mechanism, ...]:
    """Every registered mechanism, steps of the campaign's targets among them."""
    registry = set_targets(BUILTIN, at.data.targets)
    return every(at.robot, registry)
