"""modelsel doctor: does this installation work?"""

from __future__ import annotations

import os
import re
import sys
from importlib.metadata import PackageNotFoundError, requires, version
from typing import Any

import click

from ..exceptions import CHECK_FAILED
from ._options import json_option, print_json


@click.command("doctor")
@json_option
def doctor_command(as_json: bool) -> None:
    """Whether this installation works, and with what: libraries, plug-ins, data, and a small
    calibration from scratch."""
    checks = [*_libraries(), *_plugins(), _data(), _calibration()]
    python, *_ = sys.version.split()
    own_version = version("modelsel")
    if as_json:
        print_json({"checks": checks})
    else:
        click.echo(f"Python {python}, modelsel {own_version}")
        for check in checks:
            verdict = "ok   " if check["ok"] else "WRONG"
            what = check["what"]
            says = check["says"]
            click.echo(f"{verdict}  {what}: {says}")
    is_ok = all(check["ok"] for check in checks)
    if not is_ok:
        raise SystemExit(CHECK_FAILED)


def _check(what: str, ok: bool, says: str) -> dict[str, Any]:
    return {"what": what, "ok": ok, "says": says}


def _libraries() -> list[dict[str, Any]]:
    """Check every required library against the lowest version that is asked for."""
    out = []
    for line in requires("modelsel") or []:
        name, least = re.match(r"([\w-]+)(?:>=([\d.]+))?", line.partition(";")[0]).groups()  # type: ignore[union-attr]
        if "extra" in line:
            continue
        try:
            found = version(name)
        except PackageNotFoundError:
            out.append(_check(name, False, f"is not installed; pip install '{name}>={least}'"))
            continue
        ok = least is None or _numbers(found) >= _numbers(least)
        out.append(
            _check(
                name,
                ok,
                found if ok else f"{found} is older than {least}; pip install --upgrade {name}",
            )
        )
    return out


def _numbers(text: str) -> tuple[int, ...]:
    words = re.findall(r"\d+", text)
    first = words[:3]
    numbers = map(int, first)
    return tuple(numbers)


def _plugins() -> list[dict[str, Any]]:
    from ..mechanisms.registry import BUILTIN, with_plugins
    from ..robot.files import load_robot

    table, broken = with_plugins(robot=load_robot("puma760"))
    return [
        *(_check(f"plug-in {name}", False, why) for name, why in broken.items()),
        _check(
            "mechanisms",
            True,
            f"{len(BUILTIN)} built in, {len(table) - len(BUILTIN)} from plug-ins",
        ),
    ]


def _data() -> dict[str, Any]:
    root = os.environ.get("MODELSEL_DATA")
    if root is None:
        return _check(
            "MODELSEL_DATA", True, "not set; measurements are looked for beside the study file"
        )
    there = os.path.isdir(root)  # noqa: PTH112  a plain string from the environment
    return _check("MODELSEL_DATA", there, "is a folder" if there else f"{root} is not a folder")


def _calibration() -> dict[str, Any]:
    """Plant the geometry and a backlash on the PUMA, fit, and look whether they come back."""
    import numpy as np

    from ..mechanisms.registry import mechanism
    from ..robot.files import load_robot
    from ..testing import LawBroken, check_mechanism

    robot = load_robot("puma760")
    try:
        for name in ("geometric", "backlash:3"):
            check_mechanism(mechanism(name, robot), robot, np.random.default_rng(0))
    except LawBroken as error:
        return _check("a small calibration", False, str(error))
    return _check("a small calibration", True, "what was planted came back")
