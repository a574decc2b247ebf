"""modelsel mechanisms: the registry."""

from __future__ import annotations

from pathlib import Path

import click

from ..exceptions import CHECK_FAILED
from ._options import print_json


@click.command()
@click.argument("name", required=False)
@click.option(
    "--robot",
    help="The arm to show or try them on; default puma760, and for --test every built-in one.",
)
@click.option(
    "--new",
    help="Write a package with a mechanism of this name into a folder of its own, to begin with.",
)
@click.option("--test", help="Try a module's mechanisms (a name or a file) against the laws.")
@click.option("--json", "as_json", is_flag=True)
def mechanisms(
    name: str | None, robot: str | None, new: str | None, test: str | None, as_json: bool
) -> None:
    """The registry of error mechanisms: equations, units, where each acts; and to begin and try
    one's own."""
    if new is not None:
        _begin(new)
    elif test is not None:
        _try(test, robot, as_json)
    else:
        _show(name, robot or "puma760", as_json)


def _begin(name: str) -> None:
    from .._files import write_atomically
    from ..exceptions import StudyError
    from .plugin_template import skeleton

    folder, texts = Path(name), skeleton(name)
    if folder.exists():
        raise StudyError(f"{folder}: is there already; nothing was written.")
    for file, text in texts.items():
        write_atomically(folder / file, text.encode())
    module = next(file for file in texts if file.endswith(".py"))
    click.echo(
        f"Written: {', '.join(str(folder / file) for file in texts)}. Next: modelsel mechanisms --test {folder / module}"
    )


def _try(where: str, robot: str | None, as_json: bool) -> None:
    from ..robot.files import builtin_names, load
    from .plugin_template import table, tried

    found = tried(table(where), [load(n) for n in ([robot] if robot else builtin_names())])
    wrong = [(m, r, what) for m, r, what in found if what]
    if as_json:
        print_json(
            {
                "module": where,
                "tried": [
                    {"mechanism": m, "robot": r or None, "broken": what} for m, r, what in found
                ],
            }
        )
    else:
        for m, r, what in found:
            click.echo(
                f"{m} on {r}: {'; '.join(what) or 'obeys the laws'}"
                if r
                else f"{m} applies to none of the robots tried"
            )
    if wrong:
        raise SystemExit(CHECK_FAILED)


def _show(name: str | None, robot: str, as_json: bool) -> None:
    from ..mechanisms.registry import build_mechanisms, every, with_plugins
    from ..mechanisms.serialization import describe_mechanism
    from ..robot.files import load

    arm = load(robot)
    registry, broken = with_plugins(robot=arm)
    built = build_mechanisms(name, arm, registry) if name else every(arm, registry)
    alike: dict[str, int] = {}
    for m in built:
        alike[m.name] = alike.get(m.name, 0) + 1
    cards = [
        describe_mechanism(m) | {"constants": alike[m.name]}
        for m in {m.name: m for m in reversed(built)}.values()
    ][::-1]
    if as_json:
        print_json({"robot": robot, "mechanisms": cards, "broken_plugins": broken})
        return
    for card in cards:
        scanned = (
            f" ({card['constants']} constants are scanned; this is one)"
            if card["constants"] > 1
            else ""
        )
        click.echo(f"{card['name']}: {card['sentence']}{scanned}")
        if name:
            click.echo(f"    equation  {card['equation']}\n    source    {card['source']}")
            for term in card["terms"]:
                click.echo(
                    f"    {term['symbol']:8} [{term['unit']}]  {', '.join(term['screws'])}{term['expected']}"
                )
    if name and not cards:
        click.echo(f"{name} does not apply to {robot}.")
    if not name:
        absent = [stem for stem in registry if not build_mechanisms(stem, arm, registry)]
        if absent:
            click.echo(f"Not on {robot}: {', '.join(absent)}.")
    for plugin, why in broken.items():
        click.echo(f"plug-in {plugin} is left out: {why}")
