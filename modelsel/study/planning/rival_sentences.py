"""What a plan says of rival explanations: whether its poses tell them apart, and what else may."""

from __future__ import annotations

from collections.abc import Sequence

from ...calibration.experiment_design import Rivals
from ...exceptions import choice_list
from ...measurements.campaign.state_names import parse_state_name

# rise of the probability below which poses hardly tell rivals apart, unless it is high anyway
MIN_GAIN = 0.05
TOLD_APART = 0.9


def follows_gravity(rivals: Rivals) -> bool:
    """Whether a rival's cause is a torque or a moment of the links' and the payload's weight."""
    causes = [screw.cause for terms in rivals.terms for term in terms for screw in term.screws]
    variables = [parse_state_name(name) for cause in causes for name in cause.names()]
    return any(variable is not None and variable.family.by_gravity for variable in variables)


def _name_group(names: Sequence[str]) -> str:
    """Name the rivals of one finding, each once; where they differ in a constant alone, how many they are."""
    once = dict.fromkeys(names)
    distinct = list(once)
    count = len(names)
    if len(distinct) > 1:
        return choice_list(distinct)
    (name,) = distinct
    return f"{name} with {count} constants"


def describe_rivals(
    rivals: Sequence[Sequence[str]],
    probabilities: Sequence[float],
    random_probability: float | None,
    count: int,
    by_gravity: bool,
) -> str:
    """Say which rivals there are, each once, and the probability that the right one is told before
    and after `count` configurations; where these hardly raise it, what else may."""
    if not probabilities:
        return "No finding of this study has rivals that these configurations could tell apart."
    groups = "; ".join(_name_group(names) for names in rivals)
    comparison = ""
    if random_probability is not None:
        comparison = f" ({4 * count} drawn at random: {random_probability:.2f})"
    before, after = probabilities[0], probabilities[-1]
    said = (
        f"Rivals: {groups}. The right one is told from its nearest rival with probability "
        f"{before:.2f} now, with {after:.2f} after these {count} configurations{comparison}."
    )
    if after - before >= MIN_GAIN or after >= TOLD_APART:
        return said
    other = "another temperature, load or direction of approach, if they follow it differently"
    if by_gravity:
        other = "another payload, with payload_kg in the file: effects of gravity change with it"
    return f"{said} Poses will hardly tell these apart; what may: {other}."
