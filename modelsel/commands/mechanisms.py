"""modelsel mechanisms: the registry."""
from __future__ import annotations

import click

from . import print_json


@click.command()
@click.argument("name", required=False)
@click.option("--robot", default="puma760", show_default=True, help="The arm to show them on.")
@click.option("--json", "as_json", is_flag=True)
def mechanisms(name: str | None, robot: str, as_json: bool) -> None:
    """The registry of error mechanisms: equations, units, where each acts."""
    from ..inspect import mechanism_card
    from ..registry import every, parts, with_plugins
    from ..robotfile import load
    registry, broken = with_plugins()
    arm = load(robot)
    built = parts(name, arm, registry) if name else every(arm, registry)
    alike: dict[str, int] = {}
    for m in built:
        alike[m.name] = alike.get(m.name, 0) + 1
    cards = [mechanism_card(m) | {"constants": alike[m.name]} for m in {m.name: m for m in reversed(built)}.values()][::-1]
    if as_json:
        print_json({"robot": robot, "mechanisms": cards, "broken_plugins": broken})
        return
    for card in cards:
        scanned = f" ({card['constants']} constants are scanned; this is one)" if card["constants"] > 1 else ""
        click.echo(f"{card['name']}: {card['sentence']}{scanned}")
        if name:
            click.echo(f"    equation  {card['equation']}\n    source    {card['source']}")
            for term in card["terms"]:
                click.echo(f"    {term['symbol']:8} [{term['unit']}]  {', '.join(term['screws'])}{term['expected']}")
    if name and not cards:
        click.echo(f"{name} does not apply to {robot}.")
    if not name:
        absent = [stem for stem in registry if not parts(stem, arm, registry)]
        if absent:
            click.echo(f"Not on {robot}: {', '.join(absent)}.")
    for plugin, why in broken.items():
        click.echo(f"plug-in {plugin} could not be loaded: {why}")
