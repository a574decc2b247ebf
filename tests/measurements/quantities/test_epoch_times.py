"""Times since 1970 in seconds and smaller units, as controllers and ROS write them."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from click.testing import CliRunner

from modelsel.cli.main import run_command_line
from modelsel.measurements.formats.table import load_table
from modelsel.measurements.quantities.epoch_times import find_epoch_unit
from modelsel.measurements.quantities.point_times import find_times
from modelsel.measurements.reader import read_measurements
from modelsel.measurements.recognition.optional_columns import guess_optional_columns
from modelsel.robot.files import load_robot
from modelsel.robot.kinematics import forward

SECONDS = 1_732_600_000 + 12.5 * np.arange(30)
SIZES = {"": 1.0, "milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def tabulate(rng: np.random.Generator, name: str, size: float) -> pd.DataFrame:
    q = rng.uniform(-1, 1, (len(SECONDS), 6))
    table = pd.DataFrame({f"q{j}_rad": q[:, j - 1] for j in range(1, 7)})
    # where the arm is: of an arm that is not there `init` looks long for what is wrong
    table[["x_mm", "y_mm", "z_mm"]] = forward(load_robot("ur5"), q, np.array([40.0, 0.0, 120.0]))
    table[name] = (SECONDS * size).astype(np.int64)
    return table


@pytest.mark.parametrize("unit", SIZES)
def test_time_is_read_in_the_unit_it_has(unit: str, rng) -> None:
    table = tabulate(rng, "time_s", SIZES[unit])
    read = read_measurements(table, "ur5")
    np.testing.assert_allclose(read.covariates["time_s"], SECONDS, rtol=0, atol=0.6)
    said = [note.sentence for note in read.notes if note.code == "units-converted"]
    assert said == ([f'Converted: "time_s", {unit} since 1970, to s.'] if unit else [])


@pytest.mark.parametrize("name", ["timestamp", "%time", "rosbagTimestamp"])
@pytest.mark.parametrize("unit", SIZES)
def test_init_takes_it_for_the_time(unit: str, name: str, rng, tmp_path) -> None:
    tabulate(rng, name, SIZES[unit]).to_csv(tmp_path / "m.csv", index=False)
    words = ["init", tmp_path / "m.csv", "--robot", "ur5", "--yes", "--out", tmp_path / "s"]
    ran = CliRunner().invoke(run_command_line, list(map(str, words)))
    assert f'"{name}" as time_s (0 to 36' in ran.output, ran.output
    assert f'time_s = "{name}"' in (tmp_path / "s" / "study.toml").read_text()
    assert not unit or f'Converted: "{name}", {unit} since 1970, to s.' in ran.output


def test_of_two_clocks_of_one_moment_the_first_is_taken(rng) -> None:
    """As ROS writes the time of a message and that of its receipt."""
    table = tabulate(rng, "%time", 1e9)
    table["field.header.stamp"] = table["%time"] - 10**6
    (found,) = guess_optional_columns(load_table(table), [])
    assert found.columns == {"time_s": "%time"}
    table["field.header.stamp"] -= 3600 * 10**9
    assert not guess_optional_columns(load_table(table), [])


@pytest.mark.parametrize("unit", SIZES)
def test_clocks_of_two_files_agree_whatever_their_units(unit: str, rng) -> None:
    times = find_times(load_table(tabulate(rng, "timestamp", SIZES[unit])))
    assert times is not None
    assert (times.absolute, times.dated) == (True, True)
    np.testing.assert_allclose(times.seconds, SECONDS, rtol=0, atol=0.6)


def test_ticks_of_another_beginning_are_no_times_since_1970() -> None:
    ticks = np.array([6.384e17, 6.3841e17])  # .NET: 100 ns since the year 1
    windows = np.array([1.337e17, 1.3371e17])  # 100 ns since 1601
    assert find_epoch_unit(ticks) is None
    assert find_epoch_unit(windows) is None
    assert find_epoch_unit(np.zeros(0)) is None
    assert find_epoch_unit(np.array([1.7e12, np.nan])) is None
