"""Steps of a base that have no moment stand where they fit best, whatever steps."""

from __future__ import annotations

import numpy as np
import pytest
from hidden_arm import arm
from slipped_targets import TOOLS, Rng, bind_targets, draw_slip, measure

from modelsel.diagnosis.chosen_moments import choose_step_moments, list_scanned_steps
from modelsel.fitting.design import Model
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.campaign_registry import set_targets
from modelsel.mechanisms.geometry import build_setup
from modelsel.mechanisms.registry import BUILTIN, mechanism
from modelsel.mechanisms.step_moments import list_step_moments
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import load_robot

pytestmark = pytest.mark.unit

ROBOT = load_robot("irb120")
REGISTRY = set_targets(BUILTIN, ("A", "B", "C"))


def draw_steps(rng: Rng) -> Problem:
    """Of 60 configurations the first and the third target slip alike at the 40th, the second one at the
    20th; the zero of joint 3 steps at the 30th."""
    body = arm(ROBOT, rng)
    q = body.draw(rng, 60, 2.6)
    shifts = np.zeros((60, 3, 3))
    shifts[40:, [0, 2]] = draw_slip(rng)
    shifts[20:, 1] = draw_slip(rng)
    zeros = 2e-3 * (np.arange(60) >= 30)
    return bind_targets(ROBOT, q, measure(body, q, TOOLS[:3], shifts, rng, zeros))


def choose(at: Problem, *names: str) -> dict[str, Mechanism]:
    offsets = build_setup(ROBOT, 3, 1, register=False, orientation=False)
    others = Model((offsets, mechanism("geometric", ROBOT)))
    steps = {name: list_scanned_steps(name, ROBOT, REGISTRY) for name in names}
    return choose_step_moments(at, np.ones(len(at), bool), others, steps)


@pytest.mark.integration
def test_every_kind_of_step_is_placed_where_it_fits_best(rng: Rng) -> None:
    """Each stood at the first moment that is scanned, 0.5 % of the campaign."""
    at = draw_steps(rng)
    names = ("target-step:A & C", "zero-step:3", "target-step:B")
    chosen = choose(at, *names)
    rows = (40, 30, 20)
    for name, row in zip(names, rows, strict=True):
        (moment,) = list_step_moments(chosen[name].terms)
        assert chosen[name].name == name
        assert abs(moment - (row - 0.5) / 59) < 0.03


@pytest.mark.integration
def test_a_name_of_several_steps_has_each_at_its_moment(rng: Rng) -> None:
    at = draw_steps(rng)
    chosen = choose(at, "zero-step")["zero-step"]
    assert len(chosen.terms) == 6
    (third,) = [term for term in chosen.terms if term.symbol == "z3"]
    (moment,) = list_step_moments([third])
    assert abs(moment - 29.5 / 59) < 0.03


@pytest.mark.parametrize(
    "name", ["target-step:B:0.5", "zero-step:3:0.5", "geometric", "gear-ripple:4"]
)
def test_what_has_its_moment_or_is_no_step_is_not_placed(name: str) -> None:
    assert not list_scanned_steps(name, ROBOT, REGISTRY)


@pytest.mark.parametrize("name", ["tracker-step", "zero-step:3", "target-step:B"])
def test_bad_shots_do_not_move_a_step(rng: Rng, name: str) -> None:
    """Of a step of a millimetre and rows that are off by many the latter were what fitted best."""
    body = arm(ROBOT, rng)
    q = body.draw(rng, 60, 2.6)
    moment = int(rng.integers(15, 45))
    is_after = np.arange(60) >= moment
    shifts = np.zeros((60, 3, 3))
    zeros = np.zeros(60)
    if name == "zero-step:3":
        zeros = 1.5e-3 * is_after
    elif name == "target-step:B":
        shifts[moment:, 1] = draw_slip(rng)
    seen = measure(body, q, TOOLS[:3], shifts, rng, zeros)
    if name == "tracker-step":
        seen[moment:] += rng.choice([-0.5, 0.5], 3)
    bad = rng.choice(np.setdiff1d(np.arange(60), [moment - 1, moment]), 4, replace=False)
    seen[bad, rng.integers(3, size=4)] += rng.uniform(4, 20, (4, 3))
    at = bind_targets(ROBOT, q, seen)
    (found,) = list_step_moments(choose(at, name)[name].terms)
    assert (moment - 1) / 59 < found < moment / 59


def test_bad_shots_may_be_all_that_carry_a_column_of_the_base(rng: Rng) -> None:
    """Without them the base's columns depended on each other, and no moment was found at all."""
    body = arm(ROBOT, rng)
    q = body.draw(rng, 80, 2.6)
    moment = int(rng.integers(20, 60))
    seen = measure(body, q, TOOLS[:1], np.zeros((80, 1, 3)), rng)[:, 0]
    seen[moment:] += rng.choice([-0.5, 0.5], 3)
    loaded = rng.choice(np.setdiff1d(np.arange(80), [moment - 1, moment]), 3, replace=False)
    seen[loaded] += rng.choice([-1, 1], (3, 3)) * rng.uniform(8, 20, (3, 3))
    kg = np.zeros(80)
    kg[loaded] = 5.0
    data = build_measurements(q, seen, covariates={"payload_kg": kg})
    at = Problem(ROBOT, data, TOOLS[:1])
    others = Model((mechanism("geometric", ROBOT), mechanism("payload-deflection:2", ROBOT)))
    steps = {"tracker-step": list_scanned_steps("tracker-step", ROBOT, REGISTRY)}
    chosen = choose_step_moments(at, np.ones(80, bool), others, steps)
    (found,) = list_step_moments(chosen["tracker-step"].terms)
    assert (moment - 1) / 79 < found < moment / 79
