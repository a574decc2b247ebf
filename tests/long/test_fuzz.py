"""Broken files of every kind: a clean result or one clear refusal; and defects that were found this
way, once by name.

The seed is drawn anew where MODELSEL_SEED says "draw", and stands in what a failure says.
"""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from fuzz_base import FLEET, ROBOT, STUDY, base_files
from fuzz_clean import result_problems
from fuzz_engine import Fuzzer, fleet_here, lay_out, merged, tried, words_of
from fuzz_judge import Outcome, in_process, refusal_problems
from fuzz_kinds import FIRST, KINDS, LATER, shares
from fuzz_urdf import DIAMONDS
from fuzz_words import SAME, Mutant

from modelsel.exceptions import NotEstimable

# mutants of a part, and parts, each of a stream of its own
MUTANTS, PARTS = {FIRST: 500, LATER: 150}, {FIRST: 4, LATER: 1}
COMMANDS = 50
SHARE_COMPUTED = (
    0.08  # of the mutants that can be read and need not be: the others stop after the checks
)
COMMAND = [
    sys.executable,
    "-W",
    "error",
    "-c",
    "from modelsel.cli.main import run_command_line; run_command_line(prog_name='modelsel')",
]


def seed_of() -> int:
    given = os.environ.get("MODELSEL_SEED", "1")
    return secrets.randbelow(10**9) if given == "draw" else int(given)


@pytest.fixture
def fuzz(tmp_path, monkeypatch) -> Fuzzer:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    fleet_here(monkeypatch.setattr)
    return Fuzzer(np.random.default_rng(seed_of()), tmp_path / "work" / "files", SHARE_COMPUTED)


@pytest.mark.parametrize(
    ("kinds", "part"),
    [
        pytest.param(kinds, part, id=f"{words}-{part}")
        for kinds, words in ((FIRST, "what-people-write"), (LATER, "what-is-left-and-read-beside"))
        for part in range(PARTS[kinds])
    ],
)
def test_mutants(fuzz, kinds, part) -> None:
    fuzz.rng = np.random.default_rng([seed_of(), part])
    state = fuzz.rng.bit_generator.state
    for _ in range(MUTANTS[kinds]):
        fuzz.one(str(fuzz.rng.choice(kinds, p=shares(kinds))))
    worst = [{k: v for k, v in d.items() if k != "content"} for d in fuzz.defects[:3]]
    assert not fuzz.defects, (
        f"of the stream {state}: {len(fuzz.defects)} defects: {json.dumps(worst, indent=1)}"
    )
    assert fuzz.counts.total() == MUTANTS[kinds]
    assert all(
        any(key.startswith(kind) and "refused" in key for key in fuzz.counts) for kind in kinds
    )
    assert sum(n for key, n in fuzz.counts.items() if "result" in key) > MUTANTS[kinds] // 40


def test_mutants_as_commands(fuzz, tmp_path) -> None:
    """The same in processes of their own, where a warning would be printed and a crash be one."""

    def one(k: int, kind: str, mutant: Mutant) -> list[str]:
        place, out = tmp_path / f"m{k}", tmp_path / f"out{k}"
        lay_out(kind, mutant.content, place)
        ran = subprocess.run(
            [*COMMAND, *words_of(KINDS[kind].commands[0], place, out)],
            capture_output=True,
            text=True,
            encoding="utf-8",
            check=False,
            timeout=60,
        )
        left = (
            {str(p.relative_to(out)): p.read_bytes() for p in out.rglob("*") if p.is_file()}
            if out.exists()
            else {}
        )
        found = Outcome(ran.returncode, ran.stdout, ran.stderr, left, 0.0)
        wrong = refusal_problems(found, mutant.exits) if ran.returncode else result_problems(found)
        return [f"{kind}, {mutant.name}: {w}; {found.said[:3]}" for w in wrong] + (
            ["refused, though it says the same"] if ran.returncode and mutant.expect == SAME else []
        )

    state = fuzz.rng.bit_generator.state
    drawn = [str(fuzz.rng.choice(FIRST[:5])) for _ in range(COMMANDS)]
    with ThreadPoolExecutor(2) as pool:
        each = pool.map(
            lambda job: one(*job), [(k, kind, fuzz.draw(kind)) for k, kind in enumerate(drawn)]
        )
        wrong = [what for some in each for what in some]
    assert not wrong, f"of the stream {state}: {wrong}"


def test_runs_are_put_together_once() -> None:
    """Whatever is merged again, in whatever order, stands there once; the counts are sums."""

    def run(seed: int, mutants: int, defects: int) -> dict[str, object]:
        return {
            "seed": seed,
            "mutants": mutants,
            "defects": defects,
            "by_kind": {"csv": {"clean result": mutants}},
            "python": "3",
            "numpy": "2",
            "seconds": seed,
        }

    before = {
        "what": "w",
        "mutants": 5,
        "defects": 1,
        "runs": [run(1, 5, 1) | {"note": "mended since"}],
    }
    whole = merged([run(1, 5, 1), run(2, 7, 0)], before)
    assert whole == {
        "what": "w",
        "mutants": 12,
        "defects": 1,
        "runs": [*before["runs"], run(2, 7, 0)],
    }
    assert merged([run(2, 7, 0)], whole) == whole


# -- what was found
# -----------------------------------------------------------------------------------------------------


def csv_with(**columns: str) -> str:
    """The good table with one value in a whole column."""
    header, *rows = [
        line.split(",") for line in base_files()["measurements.csv"].decode().splitlines()
    ]
    for name, value in columns.items():
        for row in rows:
            row[header.index(name)] = value
    return "\n".join(",".join(row) for row in [header, *rows]) + "\n"


def table(change: str, to: str) -> str:
    return base_files()["measurements.csv"].decode().replace(change, to, 1)


URDF = base_files()["robot.urdf"].decode()
FOUND = {
    "semicolons": (
        "csv",
        lambda: base_files()["measurements.csv"].decode().replace(",", ";"),
        0,
        "",
    ),
    "decimal commas": (
        "csv",
        lambda: csv_with(x_mm='"1,5"'),
        3,
        "Numbers need a decimal point, not a comma.",
    ),
    "a far joint": (
        "csv",
        lambda: table("operator", "q9_rad"),
        3,
        "the file has a joint q9, but the robot has 3 joints",
    ),
    "beyond all measure": ("csv", lambda: csv_with(y_mm="1e308"), 3, "between -1e+09 and 1e+09"),
    "all at one far place": (
        "csv",
        lambda: csv_with(x_mm="10000.0", y_mm="10000.0", z_mm="10000.0"),
        3,
        "Every row has the same position",
    ),
    "uncertainty of nothing": (
        "csv",
        lambda: (
            table("operator", "sx_mm")
            .replace("order", "sy_mm")
            .replace("payload_kg", "sz_mm")
            .replace("Ann", "1e-300")
        ),
        3,
        "1e-09 at least",
    ),
    "not estimated at all": ("csv", lambda: csv_with(x_mm="191.3", payload_kg="1"), 0, ""),
    "no name": (
        "study",
        lambda: STUDY.replace("[split]", 'columns = { q1_rd = "q1_rad" }\n[split]'),
        2,
        'measurements.columns: unknown column "q1_rd". Did you mean "q1_rad"?',
    ),
    "one for two": (
        "study",
        lambda: STUDY.replace("[split]", 'columns = { x_mm = "q1_rad", y_mm = "q1_rad" }\n[split]'),
        2,
        '"q1_rad" is mapped to twice',
    ),
    "a number of 400 digits": (
        "study",
        lambda: STUDY.replace("0.05", "1" + "0" * 400),
        2,
        "noise.floor_mm",
    ),
    "a number of 5000 digits": (
        "study",
        lambda: STUDY.replace("seed = 3", "seed = 1" + "0" * 5000),
        2,
        "too many digits",
    ),
    "a key of 100 000 parts": (
        "study",
        lambda: ".".join("z" * 100_000) + " = 1\n" + STUDY,
        2,
        "nested too deeply",
    ),
    "a file name with a null": (
        "study",
        lambda: STUDY.replace("measurements.csv", "a\\u0000b"),
        2,
        "measurements.file",
    ),
    "a mark at the start": ("study", lambda: "\ufeff" + STUDY, 0, ""),
    "more than a computer holds": (
        "study",
        lambda: STUDY.replace("= 36", "= 1_000_000_000_000"),
        2,
        "simulate.configurations",
    ),
    "words of a library": (
        "study",
        lambda: "noise = 3\n" + STUDY.replace("[noise]\nfloor_mm = 0.05\n", ""),
        2,
        "noise: expected a table, found '3'.",
    ),
    "letters of a terminal": (
        "study",
        lambda: STUDY.replace('"geometric"]\ncand', '"\\u001b[2Jx"]\ncand'),
        2,
        "\\x1b[2Jx",
    ),
    "an axis of almost nothing": (
        "robot",
        lambda: ROBOT.replace("[0, 0, 1]\nmass", "[0, 0, 1e-320]\nmass"),
        2,
        "no length",
    ),
    "an endless link": ("robot", lambda: ROBOT.replace("350", "1e308"), 2, "below 1e+09"),
    "two ways to a link": (
        "urdf",
        lambda: URDF.replace("</robot>", DIAMONDS + "</robot>"),
        2,
        "hangs on another joint too",
    ),
    "a joint that follows": (
        "urdf",
        lambda: URDF.replace('<axis xyz="0 0 1"', '<mimic joint="joint1"/><axis xyz="0 0 1"', 1),
        2,
        "mimics another joint",
    ),
    "a joint of no kind": (
        "urdf",
        lambda: URDF.replace('type="revolute"', 'type="floating"', 1),
        2,
        'type "floating"',
    ),
    "a link not there": (
        "urdf",
        lambda: URDF.replace('<parent link="base"', '<parent link="nowhere"'),
        2,
        "is not a <link>",
    ),
    "out of the folder": (
        "fleet",
        lambda: FLEET.replace('name = "again"', 'name = ".."'),
        2,
        '".." is not a name for a folder',
    ),
    "no pattern": ("fleet", lambda: FLEET.replace("*/study.toml", "."), 2, 'no file matches "."'),
}


@pytest.mark.parametrize("case", FOUND)
def test_found_before(case, tmp_path, monkeypatch) -> None:
    kind, content, status, words = FOUND[case]
    monkeypatch.chdir(tmp_path)
    fleet_here(monkeypatch.setattr)
    ran = tried(tmp_path, kind, content().encode(), KINDS[kind].commands[0])
    assert ran.status == status, ran.stderr
    assert words in ran.stderr
    assert not (
        refusal_problems(ran, (status,))
        if status
        else []
        if kind == "fleet"
        else result_problems(ran)
    )
    assert not Path("pwned").exists()


def test_simulated_data_keep_what_is_known(tmp_path) -> None:
    """Groups, order and directions of approach of the configurations that are measured anew."""
    from modelsel.measurements.reader import read_measurements

    place = tmp_path / "work" / "files"
    text = base_files()["measurements.csv"].decode().splitlines()
    rng = np.random.default_rng(1)
    lines = [
        f"{text[0]},approach1,approach2,approach3",
        *(
            f"{line},{a},{b},{c}"
            for line, (a, b, c) in zip(
                text[1:], rng.choice([-1, 1], (len(text) - 1, 3)), strict=True
            )
        ),
    ]
    lay_out("csv", ("\n".join([lines[0], *reversed(lines[1:])]) + "\n").encode(), place)
    ran = in_process(
        ["simulate", str(place / "study.toml"), "--out", str(tmp_path / "out" / "new.csv")],
        tmp_path / "out",
    )
    assert not ran.status, ran.stderr
    old, new = (
        read_measurements(p, [False] * 3)
        for p in (place / "measurements.csv", tmp_path / "out" / "new.csv")
    )
    for name in ("q", "approach", "move", "order", "group", "configuration"):
        np.testing.assert_allclose(getattr(new, name), getattr(old, name), atol=1e-8, err_msg=name)
    assert old.groups == new.groups
    assert np.abs(new.position - old.position).max() < 5.0  # the same arm, measured anew


def test_a_fold_that_cannot_be_left_out_is_said(tmp_path, monkeypatch) -> None:
    """Where a model cannot be fitted without one of the folds, its cross-validation is null, and a
    warning says so."""

    def refuses(*_: object) -> None:
        raise NotEstimable("without fold 1 of 4 the model is not estimable")

    monkeypatch.setattr("modelsel.selection.evaluation.cross_validate_fit", refuses)
    place, out = tmp_path / "work" / "files", tmp_path / "out"
    lay_out("study", STUDY.encode(), place)
    ran = in_process(
        ["study", str(place / "study.toml"), "--out", str(out), "--no-sampling", "--no-report"], out
    )
    result = json.loads(ran.left["result.json"])
    assert None in [rung["cv_rms_mm"] for rung in result["ladder"]]
    said = {w["code"]: w["sentence"] for w in result["warnings"]}
    assert "No cross-validation of geometric" in said["cv-not-estimable"]
