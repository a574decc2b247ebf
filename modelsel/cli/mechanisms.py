"""modelsel mechanisms: the registry."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..exceptions import CHECK_FAILED, one_line, sentence_list
from ._options import json_option, print_json, print_prose

if TYPE_CHECKING:
    from ..mechanisms.registry import Registry
    from ..mechanisms.terms import Mechanism
    from .plugins import Trial

ANOTHER_ROBOT = "--robot NAME, or the path of a robot file"


@click.command("mechanisms")
@click.argument("name", required=False)
@click.option(
    "--robot",
    help="Robot to show or check them on; default puma760, for --test every built-in one.",
)
@click.option(
    "--new", help="Write a package to start from, with a mechanism of this name, into a new folder."
)
@click.option("--test", help="Check a module's mechanisms (its name or file) against the laws.")
@json_option
def mechanisms_command(
    name: str | None, robot: str | None, new: str | None, test: str | None, as_json: bool
) -> None:
    """List the error mechanisms: equations, units, where each acts; write and check your own."""
    if new is not None:
        _begin(new)
    elif test is not None:
        _try(test, robot, as_json)
    else:
        _show(name, robot or "puma760", as_json)


def _begin(name: str) -> None:
    from .._files import write_atomically
    from ..exceptions import StudyError
    from .plugins import render_plugin

    folder, texts = Path(name), render_plugin(name)
    if folder.exists():
        raise StudyError(f"{folder} already exists; nothing was written.")
    for file, text in texts.items():
        write_atomically(folder / file, text.encode())
    module = next(file for file in texts if file.endswith(".py"))
    click.echo(
        f"Written: {', '.join(str(folder / file) for file in texts)}. Next: modelsel mechanisms --test {folder / module}"
    )


def _try(where: str, robot: str | None, as_json: bool) -> None:
    from ..robot.files import builtin_names, load_robot
    from .plugins import load_plugin, try_mechanisms

    names = [robot] if robot else builtin_names()
    trials = try_mechanisms(load_plugin(where), [load_robot(name) for name in names])
    if as_json:
        tried = [
            {"mechanism": trial.mechanism, "robot": trial.robot or None, "broken": trial.broken}
            for trial in trials
        ]
        print_json({"module": where, "tried": tried})
    else:
        for trial in trials:
            click.echo(_describe_trial(trial))
    if any(trial.broken for trial in trials):
        raise SystemExit(CHECK_FAILED)


def _describe_trial(trial: Trial) -> str:
    name = trial.mechanism
    outcome = "; ".join(trial.broken) or "obeys the laws"
    if not trial.robot:
        return (
            f"{name}: {outcome}" if trial.broken else f"{name} applies to none of the robots tried"
        )
    return f"{name} on {trial.robot}: {outcome}"


def _show(name: str | None, robot: str, as_json: bool) -> None:
    from ..mechanisms.campaign_registry import waits_for_targets
    from ..mechanisms.registry import build_mechanisms, every, with_plugins
    from ..robot.files import load_robot
    from .report_names import bare_name, explain_unregistered, find_faults

    arm = load_robot(robot)
    registry, broken = with_plugins(robot=arm)
    if name and name not in registry:
        name = bare_name(name)
        explained = explain_unregistered(name, arm)
        if explained and not as_json:
            for line in explained:
                print_prose(line)
            return
    targets: tuple[str, ...] = ()
    if name and waits_for_targets(name, registry):
        targets, registry = _add_targets(name, registry)
    faults = find_faults(name, arm) if name else ()
    mechanisms = faults or (build_mechanisms(name, arm, registry) if name else every(arm, registry))
    cards = _list_cards(mechanisms)
    if as_json:
        print_json({"robot": robot, "mechanisms": cards, "broken_plugins": broken})
        return
    for card in cards:
        _print_card(card, in_full=name is not None)
    _explain_targets(name, targets, registry)
    if name and not cards:
        print_prose(f"{name} does not apply to {robot}.")
    if not name:
        print_prose(f"These are the mechanisms of {robot}; another robot's: {ANOTHER_ROBOT}.")
        absent = [stem for stem in registry if not build_mechanisms(stem, arm, registry)]
        if absent:
            print_prose(f"Not on {robot}: {', '.join(absent)}.")
    for plugin, reason in broken.items():
        click.echo(f"plug-in {plugin} is left out: {reason}")


def _explain_targets(name: str | None, targets: Sequence[str], registry: Registry) -> None:
    """Explain a name that is of some targets of several, or may be."""
    from ..mechanisms.campaign_registry import TARGET_STEP
    from ..mechanisms.moved_targets import JOINED
    from ..mechanisms.target_entries import PerTarget

    numbered = [f"target_{k} is {one_line(target)}" for k, target in enumerate(targets, 1)]
    if numbered:
        has_its_number = "it has its number" if len(numbered) == 1 else "they have their numbers"
        print_prose(
            f"Here {sentence_list(numbered)}; in results {has_its_number} among the targets of the "
            "measurements."
        )
    if name == TARGET_STEP:
        print_prose(
            f"Of several targets, each may move by itself: {TARGET_STEP}:NAME. Some that move alike "
            f"are told together: {TARGET_STEP}:NAME{JOINED}NAME."
        )
    elif isinstance(registry.get(name or ""), PerTarget):
        print_prose(f"Of several targets, each may be moved by itself: {name}:NAME.")


def _add_targets(name: str, registry: Registry) -> tuple[tuple[str, ...], Registry]:
    """Find the targets that a name is of, none where it is of a constant alone, and add them to the
    registry as those that are asked for of several. Raises StudyError where nothing is named."""
    from ..exceptions import StudyError
    from ..mechanisms.campaign_registry import set_targets
    from ..mechanisms.moved_targets import JOINED

    _, _, given = name.partition(":")
    if not given:
        raise StudyError(f'"{name}": the name of a target is missing after the colon.')
    moved = _drop_moment(given)
    if not moved:
        return (), registry
    targets = tuple(moved.split(JOINED))
    if not all(target.strip() for target in targets):
        raise StudyError(f'"{name}": the name of a target is missing beside "&".')
    if len(set(targets)) < len(targets):
        raise StudyError(f'"{name}": a target stands twice.')
    return targets, set_targets(registry, targets, (*targets, "another"))


def _drop_moment(given: str) -> str:
    """Drop the moment that may stand after the name of a target, or alone."""
    target, _, last = given.rpartition(":")
    try:
        moment = float(last)
    except ValueError:
        return given
    is_moment = 0 < moment < 1
    return target if is_moment else given


def _list_cards(mechanisms: Sequence[Mechanism]) -> list[dict[str, Any]]:
    """Return a card for every name, of its first mechanism, with the number of constants that are
    scanned under it."""
    from ..mechanisms.serialization import describe_mechanism

    counts = Counter(mechanism.name for mechanism in mechanisms)
    first: dict[str, Mechanism] = {}
    for mechanism in mechanisms:
        first.setdefault(mechanism.name, mechanism)
    cards = []
    for name, mechanism in first.items():
        card = describe_mechanism(mechanism)
        cards.append({**card, "constants": counts[name]})
    return cards


def _print_card(card: dict[str, Any], *, in_full: bool) -> None:
    from .._short_numbers import round_numbers

    constants = card["constants"]
    scanned = ""
    if constants > 1:
        scanned = f" (one of {constants} scanned constants)"
    sentence = card["sentence"]
    print_prose(f"{card['name']}: {sentence}{scanned}")
    if not in_full:
        return
    equation = card["equation"]
    source = card["source"]
    causes = ", ".join(card["usual_causes"])
    if causes:
        print_prose(f"    usual causes  {causes}")
    print_prose(f"    equation  {equation}")
    print_prose(f"    source    {source}")
    for term in card["terms"]:
        screws = round_numbers(", ".join(term["screws"]))
        symbol = f"{term['symbol']:8}"
        unit = term["unit"]
        expected = term["expected"]
        print_prose(f"    {symbol} [{unit}]  {screws}{expected}")
