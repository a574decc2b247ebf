"""modelsel robots: the built-in nominal robots."""

from __future__ import annotations

import click

from ..exceptions import count_words
from ._options import dh_option, json_option, print_json, print_prose, read_robot_option


@click.command("robots")
@click.argument("name", required=False)
@dh_option
@json_option
def robots_command(name: str | None, convention: str | None, as_json: bool) -> None:
    """The built-in nominal robots, each with its source; of NAME, or a robot file, its chain."""
    from ..robot.files import builtin_names
    from ..robot.plain_values import robot_card

    names = [name] if name else builtin_names()
    named = [read_robot_option(n, convention=convention) for n in names]
    cards = [robot_card(each.robot) for each in named]
    if as_json:
        print_json({"robots": cards})
        return
    for card in cards:
        joints = count_words(card["joints"], "joint")
        print_prose(
            f"{card['name']}: {joints}, links of {card['links_mm']:,.0f} mm in all. {card['source']}"
        )
        if name:
            for k, joint in enumerate(card["chain"], 1):
                mass = "not known" if joint["mass_kg"] is None else f"{joint['mass_kg']:g} kg"
                print_prose(
                    f"  joint {k} ({joint['kind']}), limits {joint['limits']}, mass {mass}; transform before it [mm]:"
                )
                for row in joint["transform_mm"]:
                    click.echo("    " + " ".join(f"{v:10.4f}" for v in row))
            if card["coupling"]:
                click.echo("  angles of the joints per reading of the motors:")
                for row in card["coupling"]:
                    click.echo("    " + " ".join(f"{v:10.4f}" for v in row))
