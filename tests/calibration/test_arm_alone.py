"""What an instrument measures wrongly goes neither into commands nor into a file for another program."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from wide_calibration import wide

from modelsel.calibration.arm_alone import describe_left_out_instrument, leave_out_instrument
from modelsel.calibration.calibration import Calibration
from modelsel.calibration.commands.compensation import correct
from modelsel.calibration.export import export_grid
from modelsel.calibration.export.grid_options import GridOptions
from modelsel.calibration.prediction import predict
from modelsel.fitting.design import Model
from modelsel.mechanisms.instrument import MISREADINGS
from modelsel.mechanisms.registry import mechanism


@pytest.fixture(scope="module")
def calibration() -> Calibration:
    c, _ = wide(np.random.default_rng(4))
    arms = [one for one in c.model.mechanisms if one.stem not in MISREADINGS]
    model = Model(tuple(arms))
    own = [term.key for term in model.terms]
    every = [term.key for term in c.terms]
    places = [every.index(key) for key in own]
    return replace(
        c,
        model=model,
        theta=c.theta[places],
        factor=c.factor[places],
        kept=tuple(range(len(places))),
        tracker=(3000.0, -1000.0, 500.0),
    )


def misread(c: Calibration, name: str) -> Calibration:
    """The same calibration with an error of the instrument of a mm, known to a tenth."""
    seen = mechanism(name, c.robot)
    count = len(seen.terms)
    model = Model((*c.model.mechanisms, seen))
    theta = np.append(c.theta, np.full(count, 1.0 if name == "tracker-range" else 1e-3))
    factor = np.zeros((len(theta), c.factor.shape[1] + count))
    factor[: len(c.theta), : c.factor.shape[1]] = c.factor
    factor[len(c.theta) :, c.factor.shape[1] :] = 0.1 * np.eye(count)
    return replace(c, model=model, theta=theta, factor=factor, kept=tuple(range(len(theta))))


def plan(c: Calibration, rng: np.random.Generator) -> dict[str, np.ndarray]:
    q = c.robot.draw(rng, 20)
    table = {f"q{j}_rad": q[:, j - 1] for j in range(1, c.robot.n + 1)}
    return table | {"temperature_C": np.full(20, 21.0)}


@pytest.mark.parametrize("name", ["tracker-range", "tracker-scale"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_commands_do_not_correct_what_the_instrument_measures_wrongly(
    name: str, calibration: Calibration, rng: np.random.Generator
) -> None:
    import pandas as pd

    wrong = misread(calibration, name)
    table = pd.DataFrame(plan(calibration, rng)).assign(target="a", group="mon")
    with pytest.warns(UserWarning, match=f"^{name} is an error of the instrument, not of the arm"):
        found = correct(wrong, table)
    pd.testing.assert_frame_equal(found, correct(calibration, table))
    # what the instrument will read has it
    at = wrong.problem(calibration_rows(wrong, table))
    alone = leave_out_instrument(wrong)
    moved = np.linalg.norm(predict(wrong, at) - predict(alone, at), axis=1)
    assert moved.min() > 0.05
    assert describe_left_out_instrument(calibration) == []
    assert leave_out_instrument(calibration) is calibration


def calibration_rows(c: Calibration, table: object):  # type: ignore[no-untyped-def]
    from modelsel.calibration.commands.compensation import read_planned

    return read_planned(c, table)  # type: ignore[arg-type]


def test_a_table_of_corrections_has_the_arms_errors_alone(calibration: Calibration) -> None:
    options = GridOptions((2,))
    wrong = export_grid(misread(calibration, "tracker-range"), options)
    assert wrong.text == export_grid(calibration, options).text
    assert any("error of the instrument" in note for note in wrong.notes)
    # whoever prints them adds the full stop
    assert not any(note.endswith(".") for note in wrong.notes)
