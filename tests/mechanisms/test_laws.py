"""Every registered mechanism on every built-in robot goes through the laws; and the laws see what
breaks them."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import cache

import laws
import numpy as np
import pytest
from builders import drawn, one
from slid_arms import put_on_slides

from modelsel.exceptions import StudyError
from modelsel.fitting import design
from modelsel.mechanisms.cause_formulas import parse
from modelsel.mechanisms.causes import Applied, Cause, Named, Number, cos, q, sin
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import BUILTIN, Scanned, build_mechanisms, every, mechanism
from modelsel.mechanisms.target_entries import PerTarget
from modelsel.mechanisms.terms import Mechanism, Screw, Term, unstorable
from modelsel.robot.files import builtin_names, load_robot
from modelsel.robot.kinematics import Robot

ROBOTS = {name: load_robot(name) for name in builtin_names()}
JOINED = (
    laws.law1_columns_are_derivatives,
    laws.law2_rows_are_local,
    laws.law3_linear_in_the_cause,
    laws.law7_inputs_stay,
)
# what takes a second for them all: on these in the stage `unit`
FIRST = ("puma760", "ur5e", "iiwa14")
EACH = [
    name if name in FIRST else pytest.param(name, marks=pytest.mark.integration) for name in ROBOTS
]
every_of = cache(every)


def picked(robot: Robot, rng: np.random.Generator) -> list[Mechanism]:
    """Every mechanism, but of one that is scanned over many constants one drawn and the last."""
    by_name: dict[str, list[Mechanism]] = {}
    for m in every_of(robot):
        by_name.setdefault(m.name, []).append(m)
    return [
        m
        for same in by_name.values()
        for m in dict.fromkeys([same[rng.integers(len(same))], same[-1]])
    ]


@pytest.mark.parametrize("robot", EACH)
def test_law6_a_value(robot, rng) -> None:
    check_each(laws.law6_a_value, ROBOTS[robot], rng)


@pytest.mark.slow
@pytest.mark.parametrize("robot", ROBOTS)
def test_law4_plant_and_recover(robot, rng) -> None:
    """Hundreds of fits."""
    check_each(laws.law4_plant_and_recover, ROBOTS[robot], rng)


def test_law4_of_every_name_on_one_arm(rng) -> None:
    fitted: set[str] = set()
    for robot in ROBOTS.values():
        check_each(laws.law4_plant_and_recover, robot, rng, fitted)
        fitted.update(m.name for m in every_of(robot))


def check_each(law, robot: Robot, rng: np.random.Generator, but: Collection[str] = ()) -> None:
    """Check the law of a robot's mechanisms `but` those of some names."""
    at = drawn(robot, rng, laws.CONFIGURATIONS)
    problems = []
    for m in picked(robot, rng):
        if m.name in but:
            continue
        laws.carried(m, at)
        try:
            law(m, at, rng)
        except AssertionError as error:
            problems.append(str(error).partition("\n")[0])
    assert not problems, "\n".join(problems)


@pytest.mark.parametrize("robot", EACH)
@pytest.mark.parametrize("law", JOINED, ids=lambda law: law.__name__)
def test_law_of_columns(law, robot, rng) -> None:
    at = drawn(ROBOTS[robot], rng, laws.CONFIGURATIONS)
    for some in laws.joined(picked(ROBOTS[robot], rng)):
        laws.carried(some, at)
        law(some, at, rng)


@pytest.mark.parametrize("robot", EACH)
def test_law5_symbols_and_units(robot, rng) -> None:
    at = drawn(ROBOTS[robot], rng, 2)
    for m in every_of(ROBOTS[robot]):
        laws.law5_symbols_and_units(m, at, rng)


@pytest.mark.parametrize("robot", ROBOTS)
def test_all_of_modelsels_own_can_be_stored(robot) -> None:
    """A study does not look whether they can."""
    assert not any(map(unstorable, every_of(ROBOTS[robot])))


def test_every_entry_is_tried() -> None:
    """No entry of the table escapes: each applies to at least one built-in robot, or to the gantry."""
    robots = [*ROBOTS.values(), put_on_slides(2)]
    assert {m.name.partition(":")[0] for robot in robots for m in every_of(robot)} == set(BUILTIN)


@pytest.mark.parametrize("name", ["backlash:3", "wrist-coupling", "tracker-drift"])
def test_whole_check_for_plugins(name, rng) -> None:
    laws.check_mechanism(mechanism(name, ROBOTS["puma760"]), ROBOTS["puma760"], rng)


def has_forms(entry: object) -> bool:
    return isinstance(entry, Scanned) or (isinstance(entry, PerTarget) and bool(entry.others))


@pytest.mark.parametrize("robot", ROBOTS)
def test_names(robot) -> None:
    """What is built under a name is found under it; only the constants of a scanned mechanism, and the
    forms of a target's, share one."""
    arm = ROBOTS[robot]
    found = every_of(arm)
    assert len({(m.name, m.terms) for m in found}) == len(found)
    counts = Counter(m.name for m in found)
    shared = {name.partition(":")[0] for name, count in counts.items() if count > 1}
    assert all(has_forms(BUILTIN[stem]) for stem in shared)
    for name in counts:
        assert build_mechanisms(name, arm) == tuple(m for m in found if m.name == name)


@pytest.mark.parametrize(
    "cause",
    [
        Number(1.0),
        cos(q(2) + q(3)),
        sin(2.0 * q(4)),
        Named("torque2", "N m"),
        Named("approach3"),
        Named("move3", "rad"),
        Named("payload_kg", "kg") * cos(q(2)),
        Named("range_mm", "mm"),
        Named("reach_mm", "mm"),
        Named("beam_azimuth", "rad"),
        Named("beam_face_y"),
        Applied("saw", 3.0 * q(2)),
        Named("temperature_C", "°C") - 20.0,
        Named("moment_x", "N m") / (Number(2.0) + q(1) * q(1)),
    ],
    ids=str,
)
def test_any_screw_obeys(cause, rng) -> None:
    """What the error map will scan: every place times a cause of each kind."""
    at = drawn("puma760", rng, laws.CONFIGURATIONS)
    terms = tuple(
        Term(f"{f}{axis}", (Screw(f, axis, cause),)) for f in range(1, 8) for axis in laws.AXES
    )
    whole = Mechanism("cells", terms, "All.", "H", "here")
    for law in (
        laws.law1_columns_are_derivatives,
        laws.law2_rows_are_local,
        laws.law3_linear_in_the_cause,
    ):
        law(whole, at, rng)
    for f, axis in itertools.product(range(1, 8), laws.AXES):
        single = replace(one(f, axis, cause), sentence="One.", equation="H", source="here")
        laws.law6_a_value(single, at, rng)


@dataclass(frozen=True)
class Centred(Cause):
    """A cause that looks at all rows: L2's prey."""

    inner: Cause

    def of(self, state):
        values = self.inner.of(state)
        return values - values.mean()

    @property
    def unit(self) -> str:
        return self.inner.unit

    def names(self):
        return self.inner.names()

    def __str__(self) -> str:
        return str(self.inner)


def broken_l2() -> Mechanism:
    return one(2, "rz", Centred(q(2)))


def broken_l4() -> Mechanism:
    return one(7, "rz", Number(1.0))  # turns the target about its own axis: moves no point


def broken_l5() -> Mechanism:
    return Mechanism("twice", 2 * (Term("k", (Screw(2, "rz", q(2)),)),), "Twice.", "k", "here")


def broken_l6() -> Mechanism:
    return one(2, "rz", Centred(q(2)))  # prints as q2, which it is not


@pytest.mark.parametrize(
    ("law", "wrong"),
    [
        (laws.law2_rows_are_local, broken_l2),
        (laws.law4_plant_and_recover, broken_l4),
        (laws.law5_symbols_and_units, broken_l5),
        (laws.law6_a_value, broken_l6),
    ],
    ids=["L2", "L4", "L5", "L6"],
)
def test_laws_can_fail(law, wrong, rng) -> None:
    with pytest.raises((AssertionError, NameError)):
        law(wrong(), drawn("puma760", rng, laws.CONFIGURATIONS), rng)


def test_law1_can_fail(rng, monkeypatch) -> None:
    """A field with the lever the wrong way round is no derivative."""
    right = design.fill_screw_field

    def wrong(field, *others):
        right(field, *others)
        field[:, 3:] *= -1

    monkeypatch.setattr(design, "fill_screw_field", wrong)
    with pytest.raises(AssertionError, match="L1"):
        laws.law1_columns_are_derivatives(
            mechanism("backlash:3", ROBOTS["puma760"]), drawn("puma760", rng, 20), rng
        )


def test_setup_columns_with_orientation(rng) -> None:
    """The rotational rows are derivatives too: tracker, target offset and target orientation,
    measured in six components."""
    robot = ROBOTS["ur5"]
    at = drawn(robot, rng, 20)
    turned = at.pose(slice(None)).rotation.transpose(2, 0, 1)
    from modelsel.fitting.problem import Problem
    from modelsel.measurements.measurements import Orientation, build_measurements

    data = build_measurements(at.data.q, at.data.position, orientation=Orientation(turned))
    six = Problem(robot, data, at.tools)
    assert six.components == 6
    whole = build_setup(robot, 1, 1, True, True)
    both = Mechanism("all", (*whole.terms, *mechanism("wrist-coupling", robot).terms))
    from modelsel.fitting.design import compute_design, residuals

    columns, residual = compute_design(six, both.terms)
    assert np.abs(residual).max() < 1e-9
    for j, term in enumerate(both.terms):
        h, zero = laws.step_size(term, six), np.zeros(len(both.terms))
        up, down = zero.copy(), zero.copy()
        up[j], down[j] = h, -h
        difference = (residuals(six, both.terms, down) - residuals(six, both.terms, up)) / (2 * h)
        for part in (slice(0, 3), slice(3, 6)):
            size = max(np.abs(difference[:, part]).max(), 1e-2)
            np.testing.assert_allclose(
                columns[:, part, j], difference[:, part], atol=1e-6 * size, err_msg=term.symbol
            )


@pytest.mark.filterwarnings("ignore:divide by zero")
def test_a_formula_of_numbers_is_no_error(rng) -> None:
    """A division by zero is not finite, of numbers as of readings; a number that none is is refused."""
    state = drawn("ur5", rng, 5).state
    assert parse("1/(2-2)", {}).of(state) == np.inf
    assert parse("3/4", {}).of(state) == 0.75
    with pytest.raises(StudyError, match="is not a cause"):
        parse(f"1{'0' * 400}", {})


def test_a_long_formula_is_refused_whole() -> None:
    """Its end would be missing."""
    units = {"q1": "rad", "q2": "rad"}
    longest = "+".join(["q1"] * 167)
    assert len(longest) == 500
    parse(f" {longest} ", units)
    with pytest.raises(StudyError, match=r'model.x: "q1\+.*…" has 508 characters; at most 500'):
        parse(f"{longest}+1000*q2", units, "model.x")
