"""The catalogue of mechanisms: every entry of the registry, its equation, parameters, picture, what
moves the arm like it."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import arm
import numpy as np

from modelsel._typing import Array
from modelsel.diagnosis.inference.scan import compute_basis
from modelsel.fitting.design import compute_design
from modelsel.fitting.problem import Problem
from modelsel.measurements.measurements import build_measurements
from modelsel.mechanisms.registry import BUILTIN, Registry, Scanned, build_mechanisms
from modelsel.mechanisms.serialization import describe_mechanism
from modelsel.mechanisms.terms import Mechanism
from modelsel.robot.files import builtin_names, load_robot
from modelsel.robot.kinematics import Robot, forward

ROBOT = "puma760"
TEXTS = Path(__file__).with_name("mechanisms.toml")
COUNT, SEED = 200, 760  # configurations drawn to see what moves the arm alike
ALIKE = 0.3  # share of the displacement that another must explain to be named
MOST, ROWS = 4, 6
COVARIATES = ("payload_kg", "temperature_C")


def texts(registry: Registry = BUILTIN) -> dict[str, dict[str, str]]:
    """The physics and the telling apart of every registered mechanism. Raises KeyError with what is
    missing or too much."""
    written = tomllib.loads(TEXTS.read_text(encoding="utf-8"))
    missing = [
        name
        for name in registry
        if not all(written.get(name, {}).get(key, "").strip() for key in ("physics", "apart"))
    ]
    strange = [name for name in written if name not in registry]
    if missing or strange:
        raise KeyError(
            f"{TEXTS.name}: no physics or no apart for {', '.join(missing) or 'none'}; not registered: "
            f"{', '.join(strange) or 'none'}"
        )
    return written


def shown(stem: str, robot: Robot, registry: Registry = BUILTIN) -> Mechanism:
    """The one that stands for a name: the first joint it applies to, the first constant (the middle
    of a continuous range)."""
    entry, each = registry[stem], build_mechanisms(stem, robot, registry)
    return (
        each[len(each) // 2] if isinstance(entry, Scanned) and entry.range is not None else each[0]
    )


def host(stem: str, registry: Registry = BUILTIN) -> Robot:
    """The robot that a mechanism is shown on: the catalogue's own, with slides for one that it lacks."""
    robot = load_robot(ROBOT)
    return robot if build_mechanisms(stem, robot, registry) else arm.put_on_slides(robot)


def drawn(robot: Robot) -> Problem:
    """Configurations drawn within the limits, every covariate varied, measured where the nominal
    model has them."""
    rng = np.random.default_rng(SEED)
    q = robot.draw(rng, COUNT)
    more = {"payload_kg": rng.uniform(0, 5, COUNT), "temperature_C": rng.uniform(15, 35, COUNT)}
    data = build_measurements(q, forward(robot, q, np.array(arm.TOOL)), covariates=more)
    return replace(Problem(robot, data, np.array([arm.TOOL])), tracker=arm.TRACKER)


def beyond(
    at: Problem, robot: Robot, registry: Registry = BUILTIN
) -> tuple[dict[str, float], dict[str, Array]]:
    """({name: share of its displacement that geometry absorbs}, {name: basis (3m, k) of what is
    left}) of every name a joint."""
    Q = compute_basis(
        compute_design(at, build_mechanisms("geometric", robot)[0].terms)[0].reshape(
            3 * len(at), -1
        )
    )
    absorbed, left = {}, {}
    for stem in registry:
        for m in {m.name: m for m in reversed(build_mechanisms(stem, robot, registry))}.values():
            X = compute_design(at, m.terms)[0].reshape(3 * len(at), -1)
            rest = X - Q @ (Q.T @ X)
            size = float(np.square(X).sum())
            absorbed[m.name] = (
                float(np.sqrt(max(1 - np.square(rest).sum() / size, 0.0))) if size > 0 else 1.0
            )
            left[m.name] = compute_basis(
                rest[:, np.linalg.norm(rest, axis=0) > 1e-6 * np.linalg.norm(X, axis=0)]
            )
    return absorbed, left


@cache
def common() -> tuple[dict[str, float], dict[str, Array]]:
    """`beyond` for the catalogue's robot and the built-in registry."""
    robot = load_robot(ROBOT)
    return beyond(drawn(robot), robot)


def alike(name: str, left: dict[str, Array]) -> list[tuple[str, float]]:
    """(other name, share of this one's displacement beyond geometry that the other can explain),
    the most first."""
    own = left[name]
    found = [
        (other, float(np.sqrt(np.square(Z.T @ own).sum() / own.shape[1])))
        for other, Z in left.items()
        if other != name and Z.shape[1] and own.shape[1]
    ]
    return sorted([f for f in found if f[1] >= ALIKE], key=lambda f: -f[1])[:MOST]


@cache
def _robots() -> tuple[Robot, ...]:
    return tuple(load_robot(name) for name in builtin_names())


def _applies(stem: str, registry: Registry) -> str:
    robots = _robots()
    on = [r.name for r in robots if build_mechanisms(stem, r, registry)]
    if not on:
        return f"arms with slides; of the built-in robots to none, so it is shown on a {host(stem).name}"
    here = next(r for r in robots if r.name == ROBOT)
    names = dict.fromkeys(m.name for m in build_mechanisms(stem, here, registry))
    joints = [n.partition(":")[2] for n in names if ":" in n]
    of = "links" if stem in ("link-bending", "thermal-growth") else "joints"
    where = f"on {ROBOT} once" + (f" for each of {of} {', '.join(joints)}" if joints else "")
    every = "every built-in robot" if len(on) == len(robots) else f"{', '.join(on)}"
    constants = len(build_mechanisms(f"{stem}:{joints[0]}" if joints else stem, here, registry))
    scanned = f"; {constants} constants are scanned and counted" if constants > 1 else ""
    return f"{every}; {where}{scanned}"


def _parameters(card: dict[str, Any]) -> list[str]:
    rows = ["| parameter | unit | screw: place · cause | usually |", "|---|---|---|---|"]
    for term in card["terms"][:ROWS]:
        low, high = term["size"] or (None, None)
        usual = "" if low is None else (f"up to {high:g}" if low == 0 else f"{low:g} … {high:g}")
        sign = {1: ", positive", -1: ", negative", 0: ""}[term["sign"]]
        screws = "<br>".join(f"`{s}`" for s in term["screws"][:ROWS]) + (
            "<br>…" if len(term["screws"]) > ROWS else ""
        )
        rows.append(f"| {term['symbol']} | {term['unit']} | {screws} | {usual}{sign} |")
    more = len(card["terms"]) - ROWS
    return rows + ([f"| … and {more} more | | | |"] if more > 0 else [])


def _percent(share: float) -> str:
    return f"{100 * share:.0f} %"


def entry(
    stem: str,
    text: dict[str, str],
    picture: str,
    alt: str,
    seen: tuple[dict[str, float], dict[str, Array]],
    registry: Registry = BUILTIN,
) -> str:
    """One mechanism in Markdown."""
    robot = host(stem, registry)
    m = shown(stem, robot, registry)
    card, (absorbed, left) = describe_mechanism(m), seen
    needs = [name for name in COVARIATES if name in m.names()]
    likest = ", ".join(f"`{other}` ({_percent(share)})" for other, share in alike(m.name, left))
    of_it = (
        "it is the geometry itself"
        if stem == "geometric"
        else f"geometry absorbs {_percent(absorbed[m.name])} of `{m.name}`"
        + (
            f"; of what is left, these explain most: {likest}"
            if likest
            else f"; nothing else explains {_percent(ALIKE)} of what is left"
        )
    )
    lines = [
        f"## `{stem}` {{ #{stem} }}",
        "",
        f"**{m.sentence}**",
        "",
        text["physics"].replace("\n", " "),
        "",
        f"`{m.equation}`",
        "",
        f"![{alt}]({picture}){{ .figure }}",
        "",
        *_parameters(card),
        "",
        *([f"- **Usual causes**: {', '.join(m.usual_causes)}."] if m.usual_causes else []),
        f"- **Told apart.** {text['apart'].replace(chr(10), ' ')}",
        f"- **Similar effects**, on {COUNT} configurations drawn for {robot.name}: {of_it}.",
        f"- **Applies to** {_applies(stem, registry)}.",
        *([f"- **Needs** the column {', '.join(f'`{n}`' for n in needs)}."] if needs else []),
        f"- **Source.** {m.source}.",
        "",
    ]
    return "\n".join(lines)


def page(registry: Registry = BUILTIN, folder: str = "mechanisms") -> tuple[str, dict[str, bytes]]:
    """(the whole catalogue in Markdown, its pictures by file name). Raises KeyError where a
    mechanism lacks its text."""
    written, robot = texts(registry), load_robot(ROBOT)
    seen = common() if registry is BUILTIN else beyond(drawn(robot), robot, registry)
    pictures, out = {}, []
    for stem in registry:
        on = host(stem, registry)
        drawing, alt = arm.picture(shown(stem, on, registry), on)
        pictures[f"{stem}.svg"] = drawing
        own = seen if on.name == robot.name else beyond(drawn(on), on, registry)
        out.append(entry(stem, written[stem], f"{folder}/{stem}.svg", alt, own, registry))
    return "\n".join(out), pictures
