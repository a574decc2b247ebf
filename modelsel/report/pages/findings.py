"""A page per finding: the sentence, the picture that convinces, who else it could be, what would
tell them apart."""

from __future__ import annotations

from typing import Any

from ...diagnosis.sentences import format_quantity
from ...measurements.table import Where, where_of
from ...results.storage import Source
from ...results.tables import name_of
from ..document import Block, heading, points, table, text
from ..figures import finding as draw
from ..terminal import mm
from .front import names_of

ESTIMATES = 4  # numbers listed; a free function has dozens
ADVICE = 2  # ways to tell rivals apart
REMEDIES = (  # names in a cause, how to measure again
    (("progress", "time_s", "temperature_C"), "measured again at another time of the campaign"),
    (("approach", "move"), "approached from both sides, by short and by long moves"),
    (("payload_kg",), "measured with and without the payload"),
)


def findings(source: Source) -> list[Block]:
    """All findings, each on a page of its own."""
    result, details = source.result, source.details
    if not result["findings"]:
        return [heading("Findings"), text(result["nothing_else"]["sentence"])]
    blocks: list[Block] = []
    for k, (found, said) in enumerate(zip(result["findings"], details["findings"], strict=True), 1):
        blocks += _one(source, k, found, said)
    return blocks


def _one(source: Source, k: int, found: dict[str, Any], said: dict[str, Any]) -> list[Block]:
    where = where_of(source.details.get("places"))
    blocks = [
        heading(f"Finding {k}: {said['label']}"),
        text(found["sentence"]),
        text(_verdict(found, where), "quiet"),
    ]
    if said["panels"]:
        blocks.append(_residuals(source, k, said))
    if found["estimate"]:
        blocks.append(_estimates(found["estimate"]))
    listed = found["credible_set"]
    entries = [
        (name, e["probability"], bool(e["alike"]))
        for name, e in zip(names_of(listed), listed, strict=True)
    ]
    if entries:
        more = found["more_entries"] + max(len(entries) - draw.BARS, 0)
        caption = (
            "What it could be. Filled: moves the target as the first does; hatched: differently."
        )
        words = "; ".join(f"{name} {p:.2f}" for name, p, _ in entries[: draw.BARS])
        rest = f" {more} more are less probable." if more else ""
        blocks.append(
            source.figure(
                f"credible-{k}", draw.credible(entries), caption + rest, f"Credible set: {words}."
            )
        )
    rivals = separation(found)
    return [*blocks, heading("What would tell them apart", 2), points(rivals)] if rivals else blocks


def _residuals(source: Source, k: int, said: dict[str, Any]) -> Block:
    panels = said["panels"]
    caption = (
        "Open squares: what the model without this effect leaves about this axis; blue: what the chosen model leaves; large "
        "marks: means; orange: the fitted effect. Where the squares follow the line and the blue lies flat, the effect is there "
        "and gone."
    )
    if any("folded" in p["against"] for p in panels):
        caption += " All waves of a turn are laid over each other."
    if said["more_panels"]:
        caption += (
            f" The {len(panels)} largest of {len(panels) + said['more_panels']} parts are drawn."
        )
    against = "; ".join(f"{draw.axis_name(p)} against {p['against']}" for p in panels)
    return source.figure(
        f"finding-{k}",
        draw.finding(panels),
        caption,
        f"Residual {against}, without and with {said['label']}.",
    )


def _estimates(estimate: list[dict[str, Any]]) -> Block:
    """Symbols above, numbers below: one line of a page that has room for one."""
    shown, rest = estimate[:ESTIMATES], max(len(estimate) - ESTIMATES, 0)
    return table(
        [("", "left"), *((e["symbol"], "left") for e in shown)],
        [
            [
                "estimate ± standard error",
                *(format_quantity(e["value"], e["standard_error"], e["unit"]) for e in shown),
            ]
        ],
        f"And {rest} more numbers: in result.json." if rest else "",
    )


def _verdict(found: dict[str, Any], where: Where) -> str:
    """p-value and gain in one line."""
    gain = found["gain"]
    chance = f"{found['p_value']:.2g} over the whole search"
    words = [
        f"Verdict: {found['verdict']}; chance alone would do as well with probability {chance}"
    ]
    if gain["held_out_rms_before_mm"] is not None:
        before, after = (mm(gain[f"held_out_rms_{side}_mm"]) for side in ("before", "after"))
        words.append(
            f"held-out error when it joins the ladder: {before} to {after} mm rms{_change(gain['interval_mm'])}"
        )
    if found.get("rows"):
        rows = found["rows"]
        words.append(
            f"it concerns {len(rows)} row{'s' * (len(rows) != 1)} of the measurements ({where.listed(rows, 12)})"
        )
    return ". ".join(w[0].upper() + w[1:] for w in words) + "."


def _change(interval: list[float] | None) -> str:
    """The interval of a gain in words: positive is less error."""
    if interval is None:
        return ""
    low, high = interval
    if low < 0 < high:
        return f" (95 %: {-low:.2g} mm more to {high:.2g} mm less)"
    near, far = sorted(map(abs, interval))
    return f" (95 %: {near:.2g} to {far:.2g} mm {'less' if low >= 0 else 'more'})"


def separation(found: dict[str, Any]) -> list[str]:
    """What measurement would tell the first entry from its rivals, in words, by what they differ
    in."""
    entries = found["credible_set"]
    if len(entries) < 2:
        return []
    named = list(zip(names_of(entries), entries, strict=True))
    out = dict.fromkeys(_difference(*named[0], *rival) for rival in named[1:6])
    return [words for words in out if words][:ADVICE]


def _difference(a: str, first: dict[str, Any], b: str, rival: dict[str, Any]) -> str:
    """What would tell entry `first`, called `a`, from the `rival`, called `b`; nothing where no
    measurement can."""
    screws = [
        sorted({(f"frame {s['frame']} {s['axis']}", str(s["cause"])) for s in e["screws"]})
        for e in (first, rival)
    ]
    causes = [list(dict.fromkeys(str(s["cause"]) for s in e["screws"])) for e in (first, rival)]
    if name_of(first) == name_of(rival) and all("sin(" in c for c in map("".join, causes)):
        return (
            f"{name_of(first)} with another constant: more readings of that joint, spread evenly over its turn, sharpen the wave "
            "length."
        )
    if not causes[0] or not causes[1]:
        return ""
    if screws[0] == screws[1]:
        return f"{a} and {b} are two names of one displacement: no measurement tells them apart, either corrects the error."
    if set(causes[0]) == set(causes[1]):
        return (
            f"{a} and {b} have the same cause at {screws[0][0][0]} and {screws[1][0][0]}: a second target off the last axis, or "
            "measured orientations, may tell them apart; where no target can, either name corrects the same error."
        )
    both = " ".join(set(causes[0]) ^ set(causes[1]))
    remedy = next((words for names, words in REMEDIES if any(name in both for name in names)), None)
    if remedy is not None:
        return f"{a} and {b} part company when the same configurations are {remedy}."
    return (
        f"{a} and {b} have different causes ({' & '.join(causes[0])} against {' & '.join(causes[1])}): configurations in which "
        "these change independently of each other tell them apart."
    )
