"""The parts of the errors in a study: its file, what is simulated, what is looked for, and what is
said of those that the data cannot tell."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import drawn, study_of

from modelsel import Study, load_robot, run_study, simulate_study
from modelsel._typing import Array
from modelsel.config.study_tables import NoiseTable
from modelsel.exceptions import StudyError
from modelsel.fitting.shared_errors import MAX_BLOCK
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.registry import BUILTIN
from modelsel.robot.kinematics import forward
from modelsel.study.inputs.inputs import read_inputs
from modelsel.study.inputs.noise_parts import check_parts, note_untold_parts
from modelsel.study.inspection.inspection import inspect_measurements
from modelsel.study.inspection.inspection_text import format_inspection

ROBOT = load_robot("puma760")
TOOLS = {"a": [40.0, -25.0, 100.0], "b": [-60.0, 30.0, 100.0]}
JOINTS = [f"q{j}_rad" for j in range(1, 7)]
PLACE = ["x_mm", "y_mm", "z_mm"]
BASE = {
    "name": "does not repeat",
    "seed": 3,
    "robot": {"name": "puma760", "tools_mm": TOOLS},
    "measurements": "none.csv",
    "model": {"candidates": []},
}


def simulated(folder: Path, seed: int = 3, **table: object) -> pd.DataFrame:
    """What `modelsel simulate` makes of a table [simulate]."""
    return simulate_study(Study(**BASE | {"seed": seed, "simulate": table}), folder)


def shifts(frame: pd.DataFrame) -> Array:
    """How far (m, 3) the targets are from where the nominal arm has them [mm]."""
    tool = np.array([TOOLS[name] for name in frame["target"]])
    return frame[PLACE].to_numpy() - forward(ROBOT, frame[JOINTS].to_numpy(), tool)


def test_all_that_does_not_suit_the_robot_is_said_at_once(tmp_path: Path) -> None:
    robot = {**BASE["robot"], "gear_ratios": [100.0]}
    model, noise = {"base": ["geometrc"]}, {"parts": ["joint 9"]}
    study = Study(**BASE | {"robot": robot, "model": model, "noise": noise})
    with pytest.raises(StudyError) as refused:
        read_inputs(study, tmp_path, BUILTIN)
    places = [problem.partition(":")[0] for problem in refused.value.problems]
    assert places == ["robot.gear_ratios", "model.base", "noise.parts", "none.csv"]


@pytest.mark.parametrize(
    ("tables", "said"),
    [
        (
            {"noise": {"parts": ["jiont 2"]}},
            'noise: parts names "jiont 2", which is not a part of the noise (did you mean "joint 2"?).',
        ),
        (
            {"noise": {"fixed": {"joints": 1e-5}}},
            'noise: fixed names "joints", which is not a part of the noise (did you mean "joint 1"?).',
        ),
        (
            {"noise": {"fixed": {"joint 2": -1e-5}}},
            "noise.fixed.joint 2: expected more than 0, found '-1e-05'.",
        ),
        (
            {"noise": {"parts": ["joints"], "fixed": {"group": 0.1}}},
            (
                'noise: "group" is fixed, and parts forbids it; name it in parts, too, or leave it out '
                "of fixed."
            ),
        ),
        (
            {"noise": {"fixed": {"instrument z": 0.1}}},
            (
                'noise: "instrument z" cannot be fixed; state what the instrument has in each direction: '
                "sx_mm, sy_mm and sz_mm beside the measurements, or range_mm and angle_urad."
            ),
        ),
        (
            {"noise": {"fixed": {"instrument target a": 0.1}}},
            (
                'noise: "instrument target a" cannot be fixed; state what the instrument has in each row: '
                "sx_mm, sy_mm and sz_mm beside the measurements."
            ),
        ),
        (
            {"noise": {"fixed": {"lasting": 0.1}}},
            (
                'noise: "lasting" cannot be fixed, since its length is found together with its scale; '
                "leave it out of fixed."
            ),
        ),
        (
            {"simulate": {"parts": {"postures": 0.1}}},
            (
                'simulate: parts names "postures", which is not a part of the noise (did you mean '
                '"posture"?).'
            ),
        ),
    ],
)
def test_wrong_names_and_scales_are_said_in_one_sentence(tables, said) -> None:
    with pytest.raises(StudyError) as caught:
        Study(**BASE | tables)
    assert str(caught.value) == said


def test_joints_that_the_arm_does_not_have_are_refused(tmp_path) -> None:
    study = Study(
        **BASE,
        noise={"parts": ["joint 7", "joint 2"], "fixed": {"joint 2": 1e-5}},
        simulate={"parts": {"joint 12": 1e-5}},
    )
    said = 'noise.parts: "joint 7", but puma760 has 6 joints.\nsimulate.parts: "joint 12", but'
    with pytest.raises(StudyError, match=said):
        simulate_study(study, tmp_path)
    frame = simulated(tmp_path, configurations=20)
    with pytest.raises(StudyError, match=said):
        run_study(study.with_measurements(frame))


@pytest.mark.parametrize(
    ("name", "scale", "said"),
    [
        ("joint 2", 20, '"joint 2" = 20 is more than 0.1 rad, which no arm has; give .* in rad'),
        ("group", 500.0, '"group" = 500 is more than .* mm, which no arm has; give .* in mm'),
    ],
)
def test_scales_that_no_arm_has_are_refused(name, scale, said) -> None:
    """Microradians and micrometres, where rad and mm are expected."""
    with pytest.raises(StudyError, match=said):
        check_parts(Study(**BASE, noise={"fixed": {name: scale}}), ROBOT)
    check_parts(Study(**BASE, noise={"fixed": {name: scale / 1e3}}), ROBOT)


def test_studies_without_parts_keep_their_hash() -> None:
    written = Study(**BASE).model_dump_json()
    assert all(f'"{key}"' not in written for key in ("parts", "fixed", "repeats", "lasting_visits"))
    assert '"parts":[]' in Study(**BASE, noise={"parts": []}).model_dump_json()


# -- what is simulated
# --------------------------------------------------------------------------------------------


def test_a_joint_is_really_off_one_draw_a_visit(tmp_path) -> None:
    """The joint's angle that puts target a where it is puts b there, too; so much that first order
    would not do."""
    frame = simulated(tmp_path, configurations=40, repeats=2, noise_mm=0.0, parts={"joint 2": 1e-3})
    assert len(frame) == 2 * 2 * 40
    q = frame[JOINTS].to_numpy()[::2]
    a, b = (frame.loc[frame["target"] == name, PLACE].to_numpy() for name in "ab")

    def place(off: Array, tool: str) -> Array:
        moved = q.copy()
        moved[:, 1] += off
        return forward(ROBOT, moved, np.tile(TOOLS[tool], (len(q), 1)))

    off = np.zeros(len(q))
    for _ in range(4):  # Newton's method, one angle a visit
        slope = (place(off + 1e-6, "a") - place(off - 1e-6, "a")) / 2e-6
        off += ((a - place(off, "a")) * slope).sum(1) / np.square(slope).sum(1)
    np.testing.assert_allclose(place(off, "b"), b, atol=1e-6)
    # within four standard errors of the standard deviation of 80 draws
    assert off.std() == pytest.approx(1e-3, rel=4 / np.sqrt(2 * 80))
    first, again = off.reshape(2, 40)
    assert abs(np.corrcoef(first, again)[0, 1]) < 0.5  # a draw of its own at every visit


@pytest.mark.parametrize("part", ["configuration", "posture", "group"])
def test_what_is_shared_is_the_same_in_all_rows_of_a_level(tmp_path, part) -> None:
    frame = simulated(
        tmp_path, configurations=60, repeats=2, groups=24, noise_mm=0.0, parts={part: 0.05}
    )
    shift = shifts(frame)
    visit = frame["configuration"].to_numpy()
    level = {"configuration": visit, "posture": visit % 60, "group": frame["group"].to_numpy(int)}
    first = np.unique(level[part], return_index=True, return_inverse=True)
    np.testing.assert_allclose(shift, shift[first[1]][first[2]], atol=1e-9)
    own = shift[first[1]]
    assert len(own) == {"configuration": 120, "posture": 60, "group": 24}[part]
    assert len(np.unique(own.round(9), axis=0)) == len(own)
    assert 0.035 < own.std() < 0.065


def test_what_lasts_fades_over_its_length(tmp_path) -> None:
    frame = simulated(
        tmp_path, configurations=4000, noise_mm=0.0, parts={"lasting": 0.05}, lasting_visits=5.0
    )
    shift = shifts(frame)[::2]
    assert 0.045 < shift.std() < 0.055
    for lag in (1, 5, 10):
        correlation = (shift[lag:] * shift[:-lag]).mean() / np.square(shift).mean()
        assert correlation == pytest.approx(np.exp(-lag / 5), abs=0.05)


def test_the_instrument_is_louder_along_one_axis_in_every_row(tmp_path) -> None:
    """Beside its noise in all directions; two targets of a visit have a draw each."""
    frame = simulated(
        tmp_path,
        configurations=2000,
        noise_mm=0.03,
        parts={"instrument y": 0.08, "instrument z": 0.04},
    )
    shift = shifts(frame)
    np.testing.assert_allclose(shift.std(0), [0.03, np.hypot(0.03, 0.08), 0.05], rtol=0.05)
    assert np.abs(np.corrcoef(shift[::2, 1], shift[1::2, 1])[0, 1]) < 0.1


def test_the_instrument_is_louder_at_one_target_and_in_one_group(tmp_path) -> None:
    frame = simulated(
        tmp_path,
        configurations=2000,
        groups=2,
        noise_mm=0.03,
        parts={"instrument target b": 0.04, "instrument group 2": 0.12},
    )
    spread = shifts(frame)
    for target, group, size in [("a", "1", 0.03), ("b", "1", 0.05), ("b", "2", 0.13)]:
        rows = (frame["target"] == target) & (frame["group"] == group)
        np.testing.assert_allclose(spread[rows].std(0), size, rtol=0.08)


def test_more_noise_at_a_target_that_there_is_not_is_refused(tmp_path) -> None:
    parts = {"instrument target c": 0.1, "instrument group 3": 0.1}
    with pytest.raises(StudyError) as refused:
        simulated(tmp_path, groups=2, parts=parts)
    assert list(refused.value.problems) == [
        'simulate.parts: "instrument target c", but the targets are a and b.',
        'simulate.parts: "instrument group 3", but the groups are 1 and 2.',
    ]


def test_the_seed_decides_and_parts_leave_the_rest_as_it_is(tmp_path) -> None:
    table = {"configurations": 10, "repeats": 2, "groups": 4, "parts": {"joint 3": 1e-4}}
    frame = simulated(tmp_path, **table)
    pd.testing.assert_frame_equal(frame, simulated(tmp_path, **table))
    assert not frame[JOINTS].equals(simulated(tmp_path, seed=4, **table)[JOINTS])
    without = simulated(tmp_path, **table | {"parts": {}})
    assert frame[[*JOINTS, "group"]].equals(without[[*JOINTS, "group"]])
    assert frame["group"].value_counts().to_dict() == dict.fromkeys("1234", 10)
    data = read_measurements(frame, ROBOT)
    assert data.configurations == 20


# -- what is looked for
# --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def repeated(tmp_path_factory) -> pd.DataFrame:
    """Joints 2 and 4 do not repeat; postures are measured three times."""
    parts = {"joint 2": 1e-4, "joint 4": 2e-4}
    folder = tmp_path_factory.mktemp("repeated")
    return simulated(folder, configurations=30, repeats=3, noise_mm=0.02, parts=parts)


def found(frame: pd.DataFrame, **noise: object):
    """A study's result."""
    return run_study(Study(**BASE | {"measurements": frame}, noise=noise), sampling=False)


def parts_of(result) -> dict[str, tuple[float, float, float]]:
    """What the errors' parts are found to be."""
    errors = result.run.diagnosis.search.errors
    return {part.name: (part.low, part.scale, part.high) for part in errors.parts}


@pytest.mark.slow
def test_parts_may_be_looked_for_forbidden_or_fixed(repeated) -> None:
    free = parts_of(found(repeated))
    assert list(free) == ["instrument", "joint 2", "joint 4"]
    assert free["joint 2"][0] < 1e-4 < free["joint 2"][2]
    assert not parts_of(found(repeated, parts=[]))
    assert list(parts_of(found(repeated, parts=["joint 2"]))) == ["instrument", "joint 2"]
    joints = parts_of(found(repeated, parts=["joints"]))
    assert list(joints) == list(free)
    for name, (low, scale, high) in joints.items():
        # where other parts may be there, too, the instrument's interval holds theirs
        least, likely, most = free[name]
        assert least <= low < high <= most
        assert likely == scale
        assert (least, most) == (low, high) or name == "instrument"

    # a fixed part is taken as it is, never tested, and the others are found beside it
    result = found(repeated, fixed={"joint 1": 2e-6, "joint 2": 8e-5})
    fixed = parts_of(result)
    assert fixed["joint 1"] == pytest.approx((2e-6,) * 3)
    assert fixed["joint 2"] == pytest.approx((8e-5,) * 3)
    assert fixed["joint 4"][0] < 2e-4 < fixed["joint 4"][2]
    assert fixed["instrument"][0] < 0.02 < fixed["instrument"][2]
    sentences = [part.sentence for part in result.record.repeatability]
    (said,) = (sentence for sentence in sentences if sentence.startswith("Joint 2"))
    assert said.startswith(
        "Joint 2 does not repeat better than 80.0 µrad (as the study gives it): "
    )


@pytest.mark.slow
def test_a_part_that_the_data_cannot_tell_is_noted_and_left_out(repeated) -> None:
    result = found(repeated, parts=["joint 2", "group"], fixed={"group": 0.1})
    assert list(parts_of(result)) == ["instrument", "joint 2"]
    (note,) = (note for note in result.warnings if note.code == "part-untold")
    assert note.sentence == (
        '[noise] names "group", which these data cannot tell: it takes 5 groups or more, of a few '
        "rows each. It is left out."
    )
    few = repeated[:36]
    (note,) = (n for n in found(few, fixed={"joint 2": 1e-4}).warnings if n.code == "part-untold")
    assert "it takes 20 configurations; 18 estimate" in note.sentence


def test_more_noise_that_rows_cannot_tell_is_not_looked_for(rng) -> None:
    at = drawn("puma760", rng, 30)
    only = at.data.targets[0]
    named = [f"instrument target {only}", "instrument target B", "instrument group s2"]
    notes = note_untold_parts(NoiseTable(parts=named), study_of(at))
    reasons = [note.sentence.partition("tell: ")[2] for note in notes]
    assert reasons == [
        (
            "it takes 10 estimating rows of that target, as many of others, no more than 12 targets, and fewer than 100,000 rows. "
            "It is left out."
        ),
        "there is no such target. It is left out.",
        "there is no such group. It is left out.",
    ]


@pytest.mark.slow
@pytest.mark.parametrize("factor", [10.0, 0.1])
@pytest.mark.parametrize("planted", [True, False])
def test_stated_uncertainties_are_held_against_the_instrument(
    repeated, tmp_path, factor, planted
) -> None:
    """A part that does not repeat is no excuse for a wrong figure, nor a reason to doubt a right
    one."""
    frame = repeated
    if not planted:
        frame = simulated(tmp_path, configurations=30, repeats=3, noise_mm=0.02)

    def notes(sigma: float) -> list[str]:
        result = found(frame.assign(**dict.fromkeys(("sx_mm", "sy_mm", "sz_mm"), sigma)))
        assert ("joint 2" in parts_of(result)) == planted
        return [n.sentence for n in result.warnings if n.code == "stated-uncertainty"]

    assert notes(0.02) == []
    (said,) = notes(0.02 * factor)
    beside = " beside the parts of the errors that were found" if planted else ""
    left = re.search(rf"what the model leaves{beside} \((0\.\d+) mm;", said)
    assert left is not None, said
    assert 0.018 < float(left[1]) < 0.022
    assert ("The figure is not used" in said) == (factor > 1)
    # how well joints repeat was looked for, and is told by itself
    assert "how well the arm itself repeats" not in said
    assert ("a mean of many readings" in said) == (factor < 1)


@pytest.mark.slow
@pytest.mark.parametrize("part", ["lasting", "posture", "configuration", "group"])
def test_repeats_are_the_pure_error_whatever_rows_share(tmp_path, part) -> None:
    """The lack-of-fit test of a model that lacks nothing finds the instrument's noise and nothing
    beyond it."""
    frame = simulated(
        tmp_path, configurations=30, repeats=3, groups=9, noise_mm=0.02, parts={part: 0.06}
    )
    result = found(frame)
    assert {part, "configuration"} & set(parts_of(result))
    lack = result.record.nothing_else.lack_of_fit
    assert lack.floor_mm == pytest.approx(0.02, rel=0.2)
    assert 0.001 < lack.p < 0.999


# -- what `check` says
# --------------------------------------------------------------------------------------------


def test_check_says_what_the_data_can_tell_and_what_would_tell_the_rest(tmp_path) -> None:
    def told(frame: pd.DataFrame) -> tuple[dict[str, str], str]:
        found = inspect_measurements(ROBOT, read_measurements(frame, ROBOT))
        lines = format_inspection(found)
        first = lines.index("What does not repeat:")
        return found["repeatability"]["parts"], "\n".join(lines[first:])

    pairs = simulated(tmp_path, configurations=30)
    parts, said = told(pairs)
    assert parts["joint 2"] == parts["configuration"] == "targets"
    assert "30 rows beyond the first of their visit" in said
    assert parts["instrument target a"] == parts["instrument target b"] == "sizes"
    assert "Whether one target is measured with more noise than others: judged by the sizes" in said
    assert "Whether one group is" not in said

    parts, said = told(pairs[pairs["target"] == "a"])
    assert parts["joint 2"] == "directions"
    assert "configuration" not in parts
    assert "Whether one target is" not in said
    assert "No posture was measured twice: what a joint does not repeat is seen by the dir" in said
    assert "10 postures measured 3 times each, in separate rounds, would tell them apart." in said
    assert "a second target would tell it" in said
    assert f"it takes 5 groups of 2 to {MAX_BLOCK} rows; the file has 1." in said

    parts, said = told(simulated(tmp_path, configurations=20, repeats=2, groups=5))
    assert parts["joint 6"] == "repeats"
    assert parts["group"] == "groups"
    assert parts["lasting"] == "order"
    assert "told by 20 visits to postures measured before" in said
    assert "told by 5 groups" in said

    parts, said = told(simulated(tmp_path, configurations=19))
    assert not parts
    assert "It takes 20 configurations to tell any of it; the file has 19." in said
