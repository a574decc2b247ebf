"""Mistakes in the data and the study that were believed: each is said first, with its numbers, and
clean studies raise none."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from builders import bind, drawn, planted, seeds
from click.testing import CliRunner
from report_studies import terminal_lines
from scipy.spatial.transform import Rotation

from modelsel._typing import Array
from modelsel.cli.main import run_command_line
from modelsel.config.study_tables import NoiseTable
from modelsel.exceptions import DataError, NotEstimable
from modelsel.fitting.noise import Floor, from_target_pairs
from modelsel.fitting.noise_check import lack, name_likeliest_mistake
from modelsel.measurements.measurements import build_measurements
from modelsel.measurements.reader import read_measurements
from modelsel.mechanisms.geometry import geometric
from modelsel.notices import ALARMS, HOPELESS_FIT, Note, list_alarms
from modelsel.results.sentences.study_sentences import opening_sentences
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward, pose
from modelsel.robot.rigid import from_rpy
from modelsel.setup.measured_orientations import describe_orientation_mistake
from modelsel.setup.mistakes import describe_setup_mistake
from modelsel.setup.other_robots import describe_other_robot
from modelsel.setup.registration import register
from modelsel.setup.target_labels import find_swapped_labels
from modelsel.study.pipeline.result import Result
from modelsel.study.pipeline.runner import rehearse_study, run_study
from modelsel.study.preparation.checks import (
    add_alarms_to_errors,
    check_chosen_model,
    check_setup,
    load_builtin_robots,
)
from modelsel.study.preparation.stated_noise import note_overlooked_noise

NOISE = 0.05
TOOLS = {"A": (40.0, -25.0, 100.0), "B": (-30.0, 40.0, 80.0)}
R, T = from_rpy(0.3, -0.5, 2.0), np.array([2500.0, -800.0, 400.0])  # where the tracker stands
ONE = ("A",)
Change = Callable[[pd.DataFrame], pd.DataFrame]


def frame(
    rng: np.random.Generator,
    m: int = 60,
    robot: str = "ur5",
    targets: tuple[str, ...] = ONE,
    registered: bool = True,
    path: bool = False,
    errors: float = 1.0,
) -> pd.DataFrame:
    """A campaign as a file has it: geometric errors of 0.3 mm and 0.5 mrad, noise of 0.05 mm per
    coordinate; along a slow `path` or anywhere."""
    arm = load_robot(robot)
    q = arm.draw(rng, m)
    if path:
        q = 0.8 * np.sin(
            np.linspace(0, 1, m)[:, None] * rng.uniform(8, 14, arm.n) + rng.uniform(0, 6, arm.n)
        )
    at = bind(arm, build_measurements(q, np.zeros((m, 3))), (0.0, 0.0, 0.0))
    terms = [t for t in geometric(arm).terms if t.screws[0].frame <= arm.n]
    theta = errors * rng.normal(0, [5e-4 if t.unit == "rad" else 0.3 for t in terms])
    parts = []
    for name in targets:
        some = bind(arm, at.data, TOOLS[name])
        x = planted(
            replace(
                some, data=replace(at.data, position=forward(arm, at.data.q, np.array(TOOLS[name])))
            ),
            terms,
            theta,
            rng,
            NOISE,
        ).data.position
        columns = {f"q{j + 1}_rad": at.data.q[:, j] for j in range(arm.n)}
        x = x @ R.T + T if registered else x
        parts.append(
            pd.DataFrame(
                columns
                | dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True))
                | ({"target": name, "configuration": np.arange(m)} if len(targets) > 1 else {})
            )
        )
    return pd.concat(parts).sort_index(kind="stable").reset_index(drop=True)


def studied(
    folder: Path, data: pd.DataFrame, robot: str = "ur5", registered: bool = True, more: str = ""
) -> Result:
    """The geometric model fitted to a frame."""
    data.to_csv(folder / "measurements.csv", index=False)
    tool = "register = true" if registered else f"tool_mm = {list(TOOLS['A'])}"
    (folder / "study.toml").write_text(
        f'name = "s"\n[robot]\nname = "{robot}"\n{tool}\n[measurements]\n'
        f'file = "measurements.csv"\n[model]\ncandidates = ["encoder-scale"]\n{more}'
    )
    return run_study(folder, sampling=False)


def said(result: Result, code: str) -> str:
    """The one warning of a code, which is told before the verdict on the terminal and on the first
    page; "" without one."""
    found = [w.sentence for w in result.warnings if w.code == code]
    if not found:
        return ""
    assert len(found) == 1
    if code in ALARMS and code != HOPELESS_FIT:
        first = [line for line in terminal_lines(result.record, result.details) if found[0] in line]
        assert len(first) == 1
        assert terminal_lines(result.record, result.details).index(first[0]) < len(
            list_alarms(result.warnings)
        )
        assert first[0] in opening_sentences(result.record)[: len(list_alarms(result.warnings))]
    assert found[0] in [w["sentence"] for w in result.record.to_dict()["warnings"]]
    return found[0]


def codes(result: Result) -> set[str]:
    return {w.code for w in result.warnings} & {
        *ALARMS,
        "lack-of-fit",
        "limit-below-left",
        "target-unseen",
    }


# -- no false alarm
# ------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
@seeds(1, 2)
@pytest.mark.parametrize("robot", ["ur5", "puma760", "iiwa14"])
def test_clean_studies_raise_none(robot, rng, tmp_path) -> None:
    """Stated as it is, two targets, registered or not: nothing is said."""
    spread = dict.fromkeys(("sx_mm", "sy_mm", "sz_mm"), NOISE)
    assert (
        codes(studied(tmp_path, frame(rng, 60, robot, ("A", "B")).assign(**spread), robot)) == set()
    )
    stated = f"[noise]\nfloor_mm = {NOISE}\n"
    assert (
        codes(studied(tmp_path, frame(rng, 60, robot, registered=False), robot, False, stated))
        == set()
    )


# -- A4, A27: uncertainties
# ----------------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize(
    ("stated", "words"),
    [
        (
            1e3,
            "micrometres stand where millimetres are expected: divide sx_mm, sy_mm, sz_mm by 1000",
        ),
        (1e-3, "metres stand where millimetres are expected: multiply sx_mm, sy_mm, sz_mm by 1000"),
        (2.0, "expanded uncertainty (k = 2 or 3)"),
        (20.0, "a tolerance, or in another unit"),
    ],
)
def test_stated_uncertainties_are_held_against_what_is_left(stated, words, rng, tmp_path) -> None:
    data = frame(rng).assign(**dict.fromkeys(("sx_mm", "sy_mm", "sz_mm"), stated * NOISE))
    result = studied(tmp_path, data)
    sentence = said(result, "stated-uncertainty")
    assert words in sentence
    assert (
        f"sx_mm, sy_mm, sz_mm: the standard uncertainty of one coordinate is stated as {stated * NOISE:.3g} mm"
        in sentence
    )
    assert "would be chance in 99.9 % of cases" in sentence
    assert result.run.floor.source == "estimated"  # not believed, in figures or criteria
    assert result.run.floor.coordinate_mm == pytest.approx(NOISE, rel=0.25)
    assert not result.split.known_sigma


@pytest.mark.slow
@pytest.mark.parametrize("times", [2.4, 0.1])
def test_a_stated_floor_far_from_what_is_left_is_said(times, rng, tmp_path) -> None:
    sentence = said(
        studied(tmp_path, frame(rng), more=f"[noise]\nfloor_mm = {times * NOISE}\n"),
        "stated-uncertainty",
    )
    stated = f"{times * NOISE:.3g} mm"
    assert sentence.startswith(
        f"[noise] floor_mm: the standard uncertainty of one coordinate is stated as {stated}"
    )


@pytest.mark.slow
def test_the_units_of_an_instrument_are_told_one_by_one(rng, tmp_path) -> None:
    stated = "[noise]\nrange_ppm = 6000\nangle_urad = 5000\n"
    sentence = said(studied(tmp_path, frame(rng), more=stated), "stated-uncertainty")
    assert "range_ppm in micrometres per metre, angle_urad in microradians" in sentence
    assert "micrometres stand" not in sentence


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "words"),
    [
        (1 / 1.5, "leaves more than the noise floor explains"),
        (1.37, "leaves less than the noise floor"),
    ],
)
def test_a_little_outside_is_a_note_and_no_alarm(times, words, rng, tmp_path) -> None:
    """Said with the figures of the result's own test: one figure for one question."""
    result = studied(tmp_path, frame(rng, 900), more=f"[noise]\nfloor_mm = {times * NOISE}\n")
    assert codes(result) == {"lack-of-fit"}
    assert result.run.floor.source == "stated"
    found = result.record.to_dict()["nothing_else"]["lack_of_fit"]
    assert found["f"] == pytest.approx(times**-2, rel=0.25)
    assert words in said(result, "lack-of-fit")
    assert f"F = {found['f']:.3g}" in said(result, "lack-of-fit")


@pytest.mark.integration
def test_a_figure_far_off_is_no_lack_of_fit_besides(rng, tmp_path) -> None:
    assert codes(
        studied(tmp_path, frame(rng, 120), more=f"[noise]\nfloor_mm = {NOISE / 10}\n")
    ) == {"stated-uncertainty"}


def test_the_range_holds_what_chance_gives(rng) -> None:
    """Both tests against drawn residuals: 1 in 1,000 outside; a floor that is measured itself is
    less sure."""
    freedom, own = 150, 40
    chi = np.sqrt(rng.chisquare(freedom, 20_000) / freedom)
    stated = lack(Floor(1.0, "stated"), 1.0, freedom)
    assert ((chi < stated.low) | (chi > stated.high)).mean() == pytest.approx(1e-3, abs=8e-4)
    pairs = lack(Floor(1.0, "repeats", own), 1.0, freedom)
    assert pairs.low < stated.low < stated.high < pairs.high
    assert "another unit" in name_likeliest_mistake(30.0, "x")
    assert "degrees stand where radians" in name_likeliest_mistake(57.0, "x", "rad")


@pytest.mark.slow
def test_markers_of_one_rigid_body_show_no_noise(rng, tmp_path) -> None:
    """Their distance is kept to the last digit, and no floor is taken from it; rounded to a
    micrometre, it is refuted."""
    data = frame(rng, targets=("A", "B"))
    at = read_measurements(data, load_robot("ur5").prismatic)
    assert from_target_pairs(at).coordinate_mm == pytest.approx(NOISE, rel=0.3)
    other = at.target == 1
    direction = at.position[other] - at.position[~other]
    direction *= (
        np.linalg.norm(np.subtract(TOOLS["A"], TOOLS["B"]))
        / np.linalg.norm(direction, axis=1)[:, None]
    )
    x = at.position.copy()
    x[other] = x[~other] + direction
    assert from_target_pairs(replace(at, position=x)) is None
    result = studied(
        tmp_path, data.assign(**dict(zip(("x_mm", "y_mm", "z_mm"), x.round(3).T, strict=True)))
    )
    assert "whether the tracking software computes the markers from one rigid body" in said(
        result, "floor-unlike"
    )
    assert result.run.floor.source == "estimated"


@pytest.mark.parametrize(
    ("name", "right", "remedy"),
    [
        ("sx_um", "sx_mm", "Multiply it by 0.001"),
        ("q1_grad", "q1_deg", "Multiply it by 0.9"),
        ("x_um", "x_mm", "by 0.001"),
        ("y_ft", "y_mm", "by 304.8"),
        ("srx_deg", "srx_rad", "by 0.01745329252"),
        ("temperature_K", "temperature_C", "Subtract 273.15"),
        ("time_ms", "time_s", "by 0.001"),
        ("payload_g", "payload_kg", "by 0.001"),
        ("SY_mm", "sy_mm", "Rename it to sy_mm"),
    ],
)
def test_other_units_are_no_covariates(name, right, remedy, rng, tmp_path) -> None:
    frame(rng, 5).assign(**{name: 1.0}).to_csv(tmp_path / "d.csv", index=False)
    with pytest.raises(DataError, match=rf"d\.csv, line 1, column {name}: .*\"{right}\".*{remedy}"):
        read_measurements(tmp_path / "d.csv", load_robot("ur5").prismatic)


@pytest.mark.parametrize(
    ("wanted", "given"), [("q1_rad", "J1_deg"), ("q1_rad", "A1 [deg]"), ("x_mm", "X [inch]")]
)
def test_a_mapping_to_another_unit_is_refused(wanted, given, rng) -> None:
    data = frame(rng, 5).assign(sx_mm=0.1, sy_mm=0.1, sz_mm=0.1).rename(columns={wanted: given})
    with pytest.raises(
        DataError, match=rf'it is given for {wanted}, but its name says "\w+", not "(rad|mm)"'
    ):
        read_measurements(data, load_robot("ur5").prismatic, {wanted: given})
    read_measurements(
        data.rename(columns={given: "J1"}), load_robot("ur5").prismatic, {wanted: "J1"}
    )


@pytest.mark.parametrize(
    ("wanted", "given", "size"),
    [("x_mm", "X (cm)", 10.0), ("z_m", "Z [µm]", 1e-6), ("q2_deg", "J2 [gon]", 0.9)],
)
def test_a_mapping_to_a_unit_of_no_name_is_converted(wanted, given, size, rng) -> None:
    """No name of the contract has that unit: the column's own name says what is to be done."""
    prismatic = load_robot("ur5").prismatic
    data = frame(rng, 5)
    own = wanted.replace("z_m", "z_mm").replace("deg", "rad")
    right = read_measurements(data, prismatic)
    factor = {"x_mm": 1.0, "z_m": 1e-3, "q2_deg": 180 / np.pi}[wanted]
    other = data.drop(columns=own).assign(**{given: data[own] * factor / size})
    read = read_measurements(other, prismatic, {wanted: given})
    np.testing.assert_allclose(read.position, right.position, rtol=1e-12)
    np.testing.assert_allclose(read.q, right.q, rtol=1e-12)
    (note,) = [note.sentence for note in read.notes if note.code == "units-converted"]
    assert f'Converted: "{given}" from' in note


def test_columns_of_other_names_stay_covariates(rng) -> None:
    more = dict.fromkeys(("current_A", "hose_mm", "qx2_deg", "load_g", "X_MM"), 1.0)
    assert set(
        read_measurements(frame(rng, 5).assign(**more), load_robot("ur5").prismatic).covariates
    ) == set(more)


# -- A5: orientations
# ----------------------------------------------------------------------------------------------------------


def turned(rng: np.random.Generator, m: int = 60, registered: bool = True) -> pd.DataFrame:
    """A campaign of the nominal arm with orientations in scipy's own words: the target frame turned
    on the flange, noise of
    0.5 mrad."""
    data = frame(rng, m, errors=0.0, registered=registered)
    q = data[[f"q{j}_rad" for j in range(1, 7)]].to_numpy()
    flange = pose(load_robot("ur5"), q, np.zeros(3)).axes[-1, :3].transpose(2, 1, 0)
    placed, fixed = (
        Rotation.from_matrix(R if registered else np.eye(3)),
        Rotation.from_euler("xyz", [0.4, 1.0, -2.0]),
    )
    seen = (
        placed
        * Rotation.from_matrix(flange)
        * fixed
        * Rotation.from_rotvec(rng.normal(0, 5e-4, (m, 3)))
    )
    return data.assign(**dict(zip(("qx", "qy", "qz", "qw"), seen.as_quat().T, strict=True)))


ORIENTATIONS = {
    "inverse": (lambda d: d.assign(qw=-d.qw), "inverted (the turn from target to instrument"),
    "xyzw": (
        lambda d: d.rename(columns={"qx": "qw", "qy": "qx", "qz": "qy", "qw": "qz"}),
        "qw qx qy qz hold x, y, z, w",
    ),
    "wxyz": (
        lambda d: d.rename(columns={"qw": "qx", "qx": "qy", "qy": "qz", "qz": "qw"}),
        "qw qx qy qz hold z, w, x, y",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ORIENTATIONS)
def test_mistaken_quaternions_are_said(name, rng, tmp_path) -> None:
    change, words = ORIENTATIONS[name]
    data = turned(rng)
    at = bind("ur5", read_measurements(change(data), load_robot("ur5").prismatic), (0.0, 0.0, 0.0))
    use = np.ones(len(at), bool)
    assert words in (describe_orientation_mistake(register(at, use, False), use, True) or "")
    result = studied(tmp_path, change(turned(rng, registered=False)), registered=False)
    assert words in said(result, "orientation-mistake")
    assert "of orientation are left" in result.record.verdict[0]
    assert " The orientation error " in result.record.verdict[1]


def test_quaternions_that_are_inverted_in_some_rows_are_said(rng) -> None:
    data = turned(rng)
    first = len(data) * 6 // 10
    names = ["qx", "qy", "qz"]
    data.loc[first:, names] = -data.loc[first:, names]
    at = bind("ur5", read_measurements(data, load_robot("ur5").prismatic), (0.0, 0.0, 0.0))
    use = np.arange(len(at)) % 3 > 0  # rows that are held out are looked at, too
    sentence = describe_orientation_mistake(register(at, use, False), use, True) or ""
    # the inverse of half a turn is the turn itself: such a row has nothing to say
    count = int(sentence.partition(" ")[0])
    assert 0.85 * (len(data) - first) <= count <= len(data) - first
    assert f"{count} rows have inverted quaternions (rows {first}" in sentence


def test_check_counts_what_is_determined_for_the_target_that_it_finds(rng, tmp_path) -> None:
    """Off the last axis, the last joint's zero moves it; on it, as where none is found, not."""
    data = frame(rng)
    data.to_csv(tmp_path / "d.csv", index=False)
    words = ["check", str(tmp_path / "d.csv"), "--robot", "ur5"]
    ran = CliRunner().invoke(run_command_line, words)
    assert "(target where it was found, below)" in ran.output
    assert "moves no measured coordinate" not in ran.output
    data.head(4).to_csv(tmp_path / "d.csv", index=False)
    few = CliRunner().invoke(run_command_line, words)
    assert "(target assumed at 0, 0, 100 mm)" in few.output


def test_check_says_it_too(rng, tmp_path) -> None:
    data = turned(rng)
    data.assign(qw=-data.qw).to_csv(tmp_path / "d.csv", index=False)
    ran = CliRunner().invoke(run_command_line, ["check", str(tmp_path / "d.csv"), "--robot", "ur5"])
    assert ran.exit_code == 0, ran.output
    assert "Check the orientations: The orientations fit " in ran.output


@pytest.mark.slow
def test_orientations_as_they_are(rng, tmp_path) -> None:
    result = studied(tmp_path, turned(rng))
    assert codes(result) == set()
    before, after = (
        result.record.verdict[0]
        .partition(" The orientation error ")[2]
        .partition(" from ")[2]
        .split(" to ")
    )
    assert float(before.removesuffix(" mrad")) == pytest.approx(0.5 * np.sqrt(3), rel=0.3)
    assert float(after.partition(" mrad rms.")[0]) == pytest.approx(0.5 * np.sqrt(3), rel=0.3)


# -- A9, A24: the wrong robot, and fits without hope
# -------------------------------------------------------------------------


@pytest.mark.slow
def test_the_wrong_robot_is_said(rng, tmp_path) -> None:
    """UR5e data with the UR10e's file."""
    result = studied(tmp_path, frame(rng, 80, "ur5e"), "ur10e")
    assert said(result, "other-robot").startswith('The readings fit robot "ur5e" ')
    assert "mm, median" in said(result, "other-robot")
    assert codes(result) & SET_UP == {"other-robot"}


def test_a_robot_file_with_a_built_in_name_is_held_against_that_robot(rng) -> None:
    """The UR5e's rows read in another convention, under its name: not another robot is named."""
    arm = load_robot("ur5e")
    twisted = [
        replace(joint, before=np.linalg.inv(joint.before) if k == 2 else joint.before)
        for k, joint in enumerate(arm.joints)
    ]
    at = drawn("ur5e", rng, 60)
    wrong = replace(at, robot=replace(arm, joints=tuple(twisted)))
    use = np.ones(60, bool)
    sentence = describe_other_robot(wrong, use, load_builtin_robots) or ""
    assert 'fit the built-in robot "ur5e" far better than the given robot of that name' in sentence
    assert "check the convention" in sentence
    assert describe_other_robot(at, use, load_builtin_robots, always=True) is None


SET_UP = {"setup-mistake", "other-robot", "beyond-tolerance"}


@pytest.mark.slow
@pytest.mark.parametrize(("degrees", "code"), [(17.0, "setup-mistake"), (2.0, "beyond-tolerance")])
def test_one_cause_is_one_alarm(degrees, code, rng, tmp_path) -> None:
    """A zero that is off: said as such where it is large, and the parameter that makes up for it is
    then no alarm of its own."""
    data = frame(rng, 80)
    result = studied(tmp_path, data.assign(q3_rad=data.q3_rad - np.radians(degrees)))
    assert codes(result) & SET_UP == {code}
    sentence = said(result, code)
    if code == "setup-mistake":
        off = float(sentence.partition("joint 3's zero is off by ")[2].partition(" ")[0])
        assert off == pytest.approx(degrees, abs=0.3)  # the arm has errors of its own
    else:
        assert "beyond what makers' tolerances allow (1 to 5 mm, 1°)" in sentence
        assert " ± " in sentence


@pytest.mark.slow
def test_another_robots_links_are_no_mistake_in_this_ones(rng, tmp_path) -> None:
    """A robot file with one long link: the built-in robot that fits is said, and the link is not.
    Without that robot it is."""
    own = load_robot("ur5")
    joints = list(own.joints)
    before = joints[2].before.copy()
    before[:3, 3] *= 1.2
    joints[2] = replace(joints[2], before=before)
    wrong = replace(own, name="mine", joints=tuple(joints))
    at = bind("ur5", read_measurements(frame(rng, 60), own.prismatic), (0.0, 0.0, 0.0))
    at = replace(at, robot=wrong)
    use = np.ones(len(at), bool)
    placed = register(at, use, False)
    assert {n.code for n in check_setup(placed, use, True, False)} == {"other-robot"}
    assert "the nominal arm's" in (describe_setup_mistake(placed, use, True) or "")
    assert describe_setup_mistake(placed, use, True, links=False) is None


@pytest.mark.slow
def test_a_fit_without_hope_says_so_first(rng, tmp_path) -> None:
    """30 mm of anything: first line of the verdict, and nothing drowns in a noise that is
    misfit."""
    data = frame(rng, 60)
    result = studied(
        tmp_path,
        data.assign(**{c: data[c] + rng.normal(0, 30, 60) for c in ("x_mm", "y_mm", "z_mm")}),
    )
    first = result.record.verdict[0]
    assert first.startswith(
        "This fit explains the data poorly, and nothing that follows can be relied on: "
    )
    assert "of the length of the arm's links and target in all" in first
    assert (
        "Likeliest reasons: the wrong robot file; positions that belong to other readings; an instrument or target moved"
        in first
    )
    assert sum(first in line for line in terminal_lines(result.record, result.details)) == 1
    assert not any("Nothing" in line for line in result.record.verdict)
    assert not any(
        "drowns in the noise" in u["sentence"] for u in result.record.to_dict()["unidentifiable"]
    )


@pytest.mark.slow
def test_a_fit_without_hope_names_the_readings_that_never_change(rng, tmp_path) -> None:
    data = frame(rng, 60)
    column = str(rng.choice([name for name in data if name.startswith("q")][1:5]))
    first = studied(tmp_path, data.assign(**{column: 0.3})).record.verdict[0]
    joint = column[1]
    assert (
        f"The readings of joint {joint} never change: if the arm moved there, correct that first."
        in first
    )


@pytest.mark.slow
def test_a_detection_limit_far_below_what_is_left_is_no_comfort(rng, tmp_path) -> None:
    """0.024 mm beside 0.2 mm left, where noise leaves less: said; where the noise is what is left,
    not."""
    result = studied(tmp_path, frame(rng))
    left = result.models.chosen.estimation.rms_mm
    known, estimated = Floor(left / 10, "repeats", 100), Floor(left / np.sqrt(3), "estimated", 100)
    (note,) = check_chosen_model(result.split, result.models.chosen, known, left / 8, (), False)
    assert note.code == "limit-below-left"
    assert (
        f"The detection limit of {left / 8:#.2g} mm rms is that of one single cause: {left:#.2g} mm rms are"
        in note.sentence
    )
    assert (
        check_chosen_model(result.split, result.models.chosen, estimated, left / 8, (), False) == ()
    )
    assert check_chosen_model(result.split, result.models.chosen, known, left / 2, (), False) == ()


@pytest.mark.slow
@pytest.mark.parametrize("by", [1, -2])
def test_rows_that_went_with_the_next_are_said(by, rng, tmp_path) -> None:
    """A slow path, its positions joined to readings a row off."""
    path = frame(rng, 80, path=True)
    moved = path.assign(**{c: np.roll(path[c].to_numpy(), by) for c in ("x_mm", "y_mm", "z_mm")})
    moved.to_csv(tmp_path / "measurements.csv", index=False)
    (tmp_path / "study.toml").write_text(
        'name = "s"\n[robot]\nname = "ur5"\nregister = true\n[measurements]\n'
        'file = "measurements.csv"\n'
    )
    found = {w["code"]: w["sentence"] for w in rehearse_study(tmp_path)["warnings"]}
    assert (
        f"the position {abs(by)} row{'s' * (abs(by) > 1)} further {'down' if by > 0 else 'up'}"
        in found["rows-shifted"]
    )


def test_what_cannot_be_estimated_is_refused_with_what_looks_wrong() -> None:
    with (
        pytest.raises(
            NotEstimable, match=r"it does not settle\. Check the rows: shifted\."
        ) as caught,
        add_alarms_to_errors((Note("rows-shifted", "shifted."), Note("gravity-unknown", "down."))),
    ):
        raise NotEstimable("it does not settle.", parameters=["a1"])
    assert caught.value.parameters == ("a1",)
    assert "down" not in str(caught.value)


# -- A11: labels and rows
# ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share", [0.1, 0.4, 0.5])
@pytest.mark.parametrize("registered", [True, False])
def test_swapped_labels_are_said(share, registered, rng) -> None:
    data = frame(rng, 60, targets=("A", "B"), registered=registered)
    late = np.arange(120) >= round(120 * (1 - share) / 2) * 2
    mixed = data.assign(target=np.where(late, data.target.map({"A": "B", "B": "A"}), data.target))
    at = bind("ur5", read_measurements(mixed, load_robot("ur5").prismatic), TOOLS["A"])
    at = replace(at, tools=np.array([TOOLS[name] for name in at.data.targets]))
    use = np.ones(len(at), bool)
    swapped = find_swapped_labels(register(at, use, False) if registered else at, use, registered)
    assert swapped is not None
    sentence = swapped.sentence
    assert swapped.rows == tuple(np.flatnonzero(late).tolist()) or share == 0.5
    assert sentence.startswith(
        f"In {late.sum()} of 120 rows targets have each other's names (rows "
    )
    if share < 0.5:
        assert f"(rows {np.argmax(late)} to 119, counted from 0)" in sentence
    assert '"A" is "B" and "B" is "A" there' in sentence


@pytest.mark.slow
def test_swapped_labels_of_a_study(rng, tmp_path) -> None:
    data = frame(rng, 60, targets=("A", "B"))
    late = np.arange(120) >= 72
    result = studied(
        tmp_path,
        data.assign(target=np.where(late, data.target.map({"A": "B", "B": "A"}), data.target)),
    )
    assert "(lines 74 to 121)" in said(result, "labels-swapped")
    assert result.diagnosis.faults == ()
    assert "what the warnings say about the targets" in result.record.verdict[0]


@pytest.mark.slow
@seeds(1, 3)
def test_few_swapped_labels_are_said_once(rng, tmp_path) -> None:
    """As an alarm, which says of the same rows what to correct, or as a fault where too few for
    one; never as both."""
    data = frame(rng, 60, targets=("A", "B"))
    few = np.isin(np.arange(120), data.index[data.configuration.isin([7, 30])])
    result = studied(
        tmp_path,
        data.assign(target=np.where(few, data.target.map({"A": "B", "B": "A"}), data.target)),
    )
    alarm = said(result, "labels-swapped")
    assert len(result.diagnosis.faults) == (alarm == "")
    assert "In 4 of 120 rows" in alarm or result.diagnosis.faults[0].rows.tolist() == [
        14,
        15,
        60,
        61,
    ]


@pytest.mark.slow
def test_rows_in_the_wrong_order_are_said_once(rng, tmp_path) -> None:
    """Three rows whose positions went round: a fault with a name, and not two of them with the
    position of the row before."""
    data = frame(rng, 80)
    for c in ("x_mm", "y_mm", "z_mm"):
        data.loc[[20, 21, 22], c] = data.loc[[22, 20, 21], c].to_numpy()
    result = studied(tmp_path, data)
    (fault,) = result.diagnosis.faults
    assert fault.name == "row-order"
    assert fault.rows.tolist() == [20, 21, 22]
    assert said(result, "rows-mistaken") == ""


SLIPS: dict[str, tuple[Callable[[Array], Array], str]] = {
    "metres": (lambda x: x / 1000, "in metres, not millimetres"),
    "inches": (lambda x: x / 25.4, "in inches, not millimetres"),
    "sign": (lambda x: x * [1, -1, 1], "given with the wrong sign of y"),
    "axes": (lambda x: x[:, [2, 1, 0]], "given with x and z exchanged"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "share"),
    [("metres", 0.1), ("inches", 0.1), ("axes", 0.1), ("metres", 0.25), ("sign", 0.25)],
)
def test_rows_set_aside_are_said_for_what_they_are(name, share, rng, tmp_path) -> None:
    change, words = SLIPS[name]
    data = frame(rng, 80)
    rows = np.sort(rng.choice(80, round(80 * share), replace=False))
    x = data[["x_mm", "y_mm", "z_mm"]].to_numpy(copy=True)
    x[rows] = change(x[rows])
    try:
        sentence = said(
            studied(tmp_path, data.assign(**dict(zip(("x_mm", "y_mm", "z_mm"), x.T, strict=True)))),
            "rows-mistaken",
        )
    except DataError as refused:  # where not even the placement could be found
        sentence = refused.remedy
    assert sentence.startswith(f"{len(rows)} rows are {words} (lines {rows[0] + 2}")


@pytest.mark.slow
def test_a_wild_number_is_no_slip(rng, tmp_path) -> None:
    """A kilometre away after the correction, too."""
    data = frame(rng, 80)
    data.loc[4, "x_mm"] = 1e9
    try:
        notes = studied(tmp_path, data).record.warnings
        said = " ".join(note.sentence for note in notes)
    except DataError as refused:
        said = str(refused)
    assert "micrometres" not in said


@pytest.mark.integration
def test_a_position_of_the_row_before(rng, tmp_path) -> None:
    data = frame(rng, 80)
    for c in ("x_mm", "y_mm", "z_mm"):
        data.loc[[10, 40], c] = data.loc[[9, 39], c].to_numpy() + 0.01
    assert "2 rows are given with the position of the row before (lines 12, 42)" in said(
        studied(tmp_path, data), "rows-mistaken"
    )


# -- A25: targets nobody estimated
# ---------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_targets_of_held_out_rows_alone(rng, tmp_path) -> None:
    data = frame(rng, 80, targets=("A", "B"))
    role = np.where(data.configuration < 60, "estimation", "held-out")
    data = data.assign(role=role)[(data.target == "A") | (role == "held-out")]
    result = studied(tmp_path, data, more='[split]\ncolumn = "role"\n')
    assert said(result, "target-unseen").startswith(
        '20 held-out rows are left out: no estimation row measures target "B"'
    )
    assert result.models.gain.held_out_rms_after_mm == pytest.approx(NOISE * np.sqrt(3), rel=0.5)
    assert result.record.outliers == []
    alone = studied(
        tmp_path,
        data[(data.target == "A") == (data.role == "estimation")],
        more='[split]\ncolumn = "role"\n',
    )
    assert {"target-unseen", "nothing-held-out"} <= {w.code for w in alone.warnings}


# -- validate
# ------------------------------------------------------------------------------------------------------------------


def calibrated(folder: Path, data: pd.DataFrame, more: str = "") -> Path:

    folder.mkdir()
    studied(folder, data, more=more).save(folder)
    return folder


def validated(folder: Path, data: pd.DataFrame, *more: str) -> tuple[int, dict[str, object], str]:
    data.to_csv(folder / "new.csv", index=False)
    ran = CliRunner().invoke(
        run_command_line, ["validate", str(folder), str(folder / "new.csv"), "--json", *more]
    )
    assert ran.exit_code in (0, 5), ran.output
    plain = CliRunner().invoke(
        run_command_line, ["validate", str(folder), str(folder / "new.csv"), *more]
    )
    return ran.exit_code, json.loads(ran.output), plain.output


@pytest.mark.integration
def test_validate_does_not_believe_a_stated_uncertainty(rng, tmp_path) -> None:
    """Micrometres called millimetres, stored by an earlier version as well: an arm that is 4 mm off
    has drifted."""
    data = frame(rng, 120)
    new = data.iloc[60:].reset_index(drop=True)
    folder = calibrated(
        tmp_path / "a", data.iloc[:60].assign(**dict.fromkeys(("sx_mm", "sy_mm", "sz_mm"), 40.0))
    )
    assert validated(folder, new)[1]["drifted"] is False
    assert validated(folder, new.assign(x_mm=new.x_mm + 4))[1]["drifted"] is True
    record = json.loads((folder / "calibration.json").read_text())
    for held, drifted, words in (
        (0.09, True, "which is expected here instead"),
        (None, False, "Drift cannot be judged"),
    ):
        old = record | {
            "noise_floor": {"coordinate_mm": 40.0, "source": "stated", "freedom": None},
            "held_out_rms_mm": held,
        }
        (folder / "calibration.json").write_text(json.dumps(old))
        _, found, text = validated(folder, new.assign(x_mm=new.x_mm + 4))
        assert found["drifted"] is drifted
        assert text.startswith("Check the data: ")
        assert words in text
        assert "divide floor_mm or sx_mm, sy_mm, sz_mm of its study by 1000" in text or not drifted


@pytest.mark.slow
def test_validate_says_what_is_mistaken_in_the_new_data(rng, tmp_path) -> None:
    data = frame(rng, 120)
    new = data.iloc[60:].reset_index(drop=True)
    folder = calibrated(tmp_path / "a", data.iloc[:60])
    _, found, text = validated(folder, new)
    assert all(
        "beyond" in line for line in found["warnings"]
    )  # readings that the calibration has not seen
    assert text.startswith("The calibration is still valid within noise")
    _, found, text = validated(
        folder, new.assign(**dict.fromkeys(("sx_mm", "sy_mm", "sz_mm"), 50.0))
    )
    assert "divide sx_mm, sy_mm, sz_mm by 1000" in found["warnings"][0]
    metres = new.assign(**{c: new[c] / 1000 for c in ("x_mm", "y_mm", "z_mm")})
    metres.loc[20:] = new.loc[20:]
    _, found, text = validated(folder, metres)
    assert found["warnings"][0].startswith("20 rows are in metres, not millimetres (lines 2 to 21)")
    assert text.startswith("Check the data: 20 rows are in metres")


@pytest.mark.slow
def test_validate_finds_a_new_target_where_it_registers(rng, tmp_path) -> None:
    """It advised --register, and refused with it."""
    data = frame(rng, 120, targets=("A", "B"))
    folder = calibrated(tmp_path / "a", data[data.configuration < 60])
    late = data[data.configuration >= 60]
    new = late.assign(target=late.target.map({"A": "A", "B": "C"}))
    _, found, text = validated(folder, new, "--register")
    assert found["drifted"] is False
    assert 'Target "C" was not calibrated: its place was found from the new data' in text
    assert found["registered"]["target_mm"] < 0.2
    only = new[new.target == "C"]
    assert validated(folder, only, "--register")[1]["drifted"] is False
    ran = CliRunner().invoke(run_command_line, ["validate", str(folder), str(folder / "new.csv")])
    assert ran.exit_code == 3
    assert "--register" in ran.output


@pytest.mark.slow
def test_several_targets_are_not_taken_for_the_one_that_was_calibrated(rng, tmp_path) -> None:
    """Their rows were judged at one place: a calibration that holds had drifted by 28 mm."""
    data = frame(rng, 160, targets=("A", "B"))
    early = data[data.configuration < 60]
    folder = calibrated(tmp_path / "a", early[early.target == "A"])
    late = data[data.configuration >= 60]
    late.to_csv(folder / "new.csv", index=False)
    ran = CliRunner().invoke(run_command_line, ["validate", str(folder), str(folder / "new.csv")])
    assert ran.exit_code == 3
    said = " ".join(ran.output.split())
    assert 'the file names 2 targets, "A" and "B"; the calibration has one, "A".' in said
    assert "Keep the rows of that one, or run `modelsel validate --register`" in said
    one = late[late.target == "A"]
    assert validated(folder, one.assign(target="C"))[1]["drifted"] is False  # by another name
    _, found, text = validated(folder, late, "--register")
    assert found["drifted"] is False
    assert 'Target "B" was not calibrated: its place was found from the new data' in text
    assert found["registered"]["target_mm"] < 0.2
    _, _, text = validated(folder, late.assign(target=late.target.str.lower()), "--register")
    assert 'Targets "a" and "b" were not calibrated: their places were found' in text


def test_drawn_scenes_have_no_slips(rng) -> None:
    """The nominal arm with the errors of an assembled one, gross rows in random directions: no slip
    explains these."""
    from modelsel.diagnosis.faults.mistaken_rows import describe_slips
    from modelsel.fitting.design import residuals

    for _ in range(20):
        at = drawn("puma760", rng, 60)
        x = at.data.position + rng.normal(0, 0.5, (60, 3))
        gross = np.arange(60) < 9
        direction = rng.normal(size=(60, 3))
        x += (
            np.where(gross, rng.uniform(50, 500, 60), 0.0)[:, None]
            * direction
            / np.linalg.norm(direction, axis=1)[:, None]
        )
        assert (
            describe_slips(replace(at, data=replace(at.data, position=x)), residuals, gross) == ()
        )


def test_noise_that_is_stated_more_than_once_is_said(rng) -> None:
    """What stands in the file goes first, then the floor, then the instrument."""
    q = rng.uniform(-1, 1, (4, 6))
    bare, stated = (build_measurements(q, q[:, :3], sigma=sigma) for sigma in (None, q[:, :3] ** 2))
    floor, instrument = {"floor_mm": 0.1}, {"range_mm": 0.02}
    for data, table, words in (
        (bare, floor, ""),
        (bare, instrument, ""),
        (stated, {}, ""),
        (bare, floor | instrument, "from floor_mm, not from range_mm, range_ppm and angle_urad."),
        (stated, floor, "from the uncertainties in the file, not from floor_mm."),
        (
            stated,
            floor | instrument,
            "from the uncertainties in the file, not from floor_mm and ra",
        ),
    ):
        notes = note_overlooked_noise(NoiseTable(**table), data)
        assert [note.code for note in notes] == ["noise-stated-twice"] * bool(words)
        assert all(words in note.sentence for note in notes)
