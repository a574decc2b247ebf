"""What is wrong with what a command made of a broken file that it took; and whether it is what the
good file gives."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from fuzz_judge import INSIDE, Outcome

from modelsel.results.storage import WRITES

WRITTEN = set(WRITES)
NONE = re.compile(rb"\b-?(nan|inf|infinity)\b", re.IGNORECASE)


def _finite(value: Any) -> bool:
    if isinstance(value, dict):
        return all(map(_finite, value.values()))
    if isinstance(value, list):
        return all(map(_finite, value))
    return not isinstance(value, float) or math.isfinite(value)


def result_problems(ran: Outcome) -> list[str]:
    """A clean study: its files whole and alone, its numbers finite and possible."""
    problems = [] if set(ran.left) == WRITTEN else [f"files: {sorted(ran.left)}"]
    try:
        result = json.loads(ran.left["result.json"], parse_constant=lambda c: math.nan)
        json.loads(ran.left["calibration.json"]), json.loads(ran.left["details.json"])
    except (KeyError, ValueError) as error:
        return [*problems, f"result: {error!r}"]
    if not _finite(result):
        problems.append("a number that is none")
    for rung in result["ladder"]:
        errors = rung["estimation"]
        if (
            not 0
            <= errors["mean_mm"]
            <= errors["rms_mm"] * (1 + 1e-9)
            <= errors["max_mm"] * (1 + 2e-9)
        ):
            problems.append(f"impossible errors: {errors}")
        if rung["cv_rms_mm"] is None and not any(
            w["code"] == "cv-not-estimable" for w in result["warnings"]
        ):
            problems.append("cv null, and nothing said")
    if not all(0 < f["p_value"] <= 1 for f in result["findings"] if f["p_value"] is not None):
        problems.append("a probability that is none")
    if extra := [line for line in ran.said if not line.startswith("modelsel: ")]:
        problems.append(f"said: {extra[0][:200]}")
    return problems


def alike(a: Any, b: Any) -> bool:
    """Two results with the same numbers, whatever was said on reading: files and warnings may
    differ."""
    if isinstance(a, dict) and isinstance(b, dict):
        skip = {"provenance", "warnings"}
        return a.keys() == b.keys() and all(alike(a[k], b[k]) for k in a if k not in skip)
    if isinstance(a, list) and isinstance(b, list):
        return len(a) == len(b) and all(map(alike, a, b))
    if isinstance(a, float) and isinstance(b, (int, float)):
        return math.isclose(a, b, rel_tol=1e-4, abs_tol=1e-6)
    return bool(a == b) or isinstance(a, str)


def fleet_problems(ran: Outcome, good: Outcome) -> list[str]:
    return [f"said: {line}" for line in ran.said if INSIDE.search(line)]


# -- the commands that tell something, as JSON, and may write a file
# ---------------------------------------------------------


def told_problems(ran: Outcome, good: Outcome) -> list[str]:
    """What was told is JSON with a number wherever the good file gives one; the files are the good
    file's, and as whole."""
    problems = (
        []
        if ran.left.keys() == good.left.keys()
        else [f"files: {sorted(ran.left)}, expected {sorted(good.left)}"]
    )
    try:
        told = json.loads(ran.stdout)
    except ValueError as error:
        return [*problems, f"told: {error!r}: {ran.stdout[:200]}"]
    problems += [
        f"a number that is none: {place}" for place in _hollow(told, json.loads(good.stdout))
    ][:3]
    for name in ran.left.keys() & good.left.keys():
        if name.endswith(".csv"):
            written, wanted = _columns(ran.left[name]), _columns(good.left[name])
            numbers = [
                key
                for key in wanted.keys() & written.keys()
                if not any(isinstance(v, str) for v in wanted[key])
            ]
            hollow = [key for key in numbers if not _finite(written[key]) or "" in written[key]]
            problems += [f"{name}, {key}: a number that is none" for key in hollow]
        elif (
            not name.endswith((".pdf", ".html"))
            and NONE.search(ran.left[name])
            and not NONE.search(good.left[name])
        ):
            problems.append(f"{name}: a number that is none")
    if extra := [
        line for line in ran.said if not line.startswith("modelsel: ") or INSIDE.search(line)
    ]:
        problems.append(f"said: {extra[0][:200]}")
    return problems


def _hollow(told: Any, good: Any, place: str = "") -> list[str]:
    """Where nothing stands in the place of a number."""
    if isinstance(good, dict) and isinstance(told, dict):
        return [
            p for k in good.keys() & told.keys() for p in _hollow(told[k], good[k], f"{place}.{k}")
        ]
    if isinstance(good, list) and isinstance(told, list):
        return [
            p
            for k, (a, b) in enumerate(zip(told, good, strict=False))
            for p in _hollow(a, b, f"{place}.{k}")
        ]
    return [place] if told is None and isinstance(good, (int, float)) else []


def _columns(content: bytes) -> dict[str, list[Any]]:
    """A CSV's columns by name, numbers as numbers."""

    def cell(text: str) -> Any:
        try:
            return float(text)
        except ValueError:
            return text

    header, *rows = csv.reader(io.StringIO(content.decode()))
    return {name: [cell(row[k]) for row in rows] for k, name in enumerate(header)}


def _in_radians(columns: dict[str, list[Any]]) -> dict[str, list[Any]]:
    """Columns of degrees as columns of radians: a table of commands has the units of its targets."""
    return {
        name.replace("_deg", "_rad"): [
            math.radians(v) if isinstance(v, float) else v for v in values
        ]
        if name.endswith("_deg")
        else values
        for name, values in columns.items()
    }


def told_alike(ran: Outcome, good: Outcome) -> bool:
    if ran.status != good.status or not alike(json.loads(ran.stdout), json.loads(good.stdout)):
        return False
    return all(
        alike(_in_radians(_columns(ran.left[name])), _in_radians(_columns(good.left[name])))
        if name.endswith(".csv")
        else ran.left[name] == good.left[name]
        for name in good.left
    )


@dataclass(frozen=True)
class Judge:
    """Of a command: whether it took the file, what is wrong with what it made of it, whether that
    is the good file's."""

    took: Callable[[Outcome], bool]
    problems: Callable[[Outcome, Outcome], list[str]]
    alike: Callable[[Outcome, Outcome], bool]


def _study_alike(ran: Outcome, good: Outcome) -> bool:
    return alike(json.loads(ran.left["result.json"]), json.loads(good.left["result.json"]))


STUDY = Judge(lambda ran: not ran.status, lambda ran, good: result_problems(ran), _study_alike)
FLEET = Judge(
    lambda ran: not ran.status or "summary.csv" in ran.left, fleet_problems, lambda ran, good: True
)
TOLD = Judge(
    lambda ran: ran.status in (0, 5), told_problems, told_alike
)  # 5: done, but a check failed


def judge_of(command: str) -> Judge:
    return {"study": STUDY, "fleet": FLEET}.get(command.split(maxsplit=1)[0], TOLD)
