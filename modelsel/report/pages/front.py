"""The first pages: the verdict, the data and their split, the ladder and the table, the error
map."""

from __future__ import annotations

from typing import Any

from ...notices import Note, list_alarms
from ...results.placements import standing_sentences
from ...results.storage import Source
from ...results.tables import alike, name_of
from ..document import Block, heading, points, table, text
from ..figures import errormap, ladder, space
from ..style import shortened
from ..terminal import mm

NAMED, NAME, WHAT = (
    9,
    40,
    110,
)  # rows of the first page's table, letters of a name and of what it means


def names_of(entries: list[dict[str, Any]]) -> list[str]:
    """Names of a credible set; where one stands there more than once, with the cause that tells
    them apart."""
    names = [name_of(e) for e in entries]
    return [
        f"{n}, {e['screws'][0]['cause']}" if names.count(n) > 1 and e["screws"] else n
        for n, e in zip(names, entries, strict=True)
    ]


def sure(finding: dict[str, Any]) -> str:
    """How probable the first of the set is, and together with those that move the target as it
    does."""
    together, own = f"{alike(finding):.2f}", f"{finding['credible_set'][0]['probability']:.2f}"
    others = sum(bool(e["alike"]) for e in finding["credible_set"]) - 1
    return own if own == together or others < 1 else f"{own}; {together} with {others} alike"


def opening(result: dict[str, Any]) -> list[str]:
    """The verdict's sentences; before them, what in the set-up or the data looks wrong."""
    return [
        *list_alarms([Note(w["code"], w["sentence"]) for w in result["warnings"]]),
        *result["verdict"],
    ]


def first(source: Source) -> list[Block]:
    """The page that stands alone."""
    result, details = source.result, source.details
    counts = result["configurations"]
    blocks: list[Block] = [
        {
            "kind": "title",
            "title": result["study"],
            "robot": result["robot"],
            "estimation": f"{counts['estimation']:,}",
            "held_out": f"{counts['held_out']:,}",
        }
    ]
    blocks += [text(sentence, "lead") for sentence in opening(result)]
    blocks.append(
        source.figure(
            "ladder",
            ladder.ladder(result),
            "Mean position error of each model on the way from the nominal to the chosen one. Each row adds "
            "one named cause; in the grey zone nothing but noise is left.",
            _ladder_words(result),
        )
    )
    found = list(zip(result["findings"], details["findings"], strict=True))
    if found:
        unsure = any(f["verdict"] != "found" for f, _ in found)
        rows = [
            [
                shortened(said["label"], NAME),
                shortened(said["what"], WHAT),
                sure(f) if f["verdict"] == "found" else f"{sure(f)}, rivals",
            ]
            for f, said in found[:NAMED]
        ]
        more = len(found) - len(rows)
        blocks.append(
            table(
                [("named", "left"), ("what goes wrong", "left"), ("probability", "left")],
                rows,
                "Probability: of this name; alike: of this and of others that would move the target as it does"
                + ("; rivals: others that the data cannot tell from it." if unsure else ".")
                + (f" And {more} more: see Findings." if more > 0 else ""),
                [0.36, 1.0, 0.0],
            )
        )
    return blocks


def _ladder_words(result: dict[str, Any]) -> str:
    which = ladder.rungs(result)
    side = "held_out" if result["ladder"][0]["held_out"]["mean_mm"] is not None else "estimation"
    steps = [
        f"{name} {mm(result['ladder'][k][side]['mean_mm'])} mm"
        for k, name in zip(which, ladder.names(result, which), strict=True)
    ]
    return (
        f"Ladder of models, mean error on {side.replace('_', '-')} configurations: {'; '.join(steps)}. "
        f"Noise floor {result['noise_floor']['coordinate_mm']:.3g} mm per coordinate."
    )


def data(source: Source) -> list[Block]:
    """What was measured and how it was split."""
    result, details = source.result, source.details
    counts, rows = result["configurations"], details["rows"]
    drawn = len(rows["row"])
    thinned = f" {drawn:,} of {rows['of']:,} rows are drawn." if drawn < rows["of"] else ""
    placed = result.get("registration")
    stands = (
        []
        if placed is None
        else [
            heading("Where the tracker and the target stand", 2),
            points(standing_sentences(placed)),
        ]
    )
    return [
        heading("Data and split"),
        text(
            f"{counts['estimation']:,} configurations estimate and choose the model, {counts['held_out']:,} are held out: "
            "no step, not even "
            f"the naming, has seen them. Noise floor: {result['noise_floor']['coordinate_mm']:.3g} mm per coordinate "
            f"({result['noise_floor']['source']})."
        ),
        source.figure(
            "joints",
            space.joints(details),
            "Joint coverage. A stroke is one reading: upper, orange: estimation; lower, blue: "
            "held-out; grey: the joint's range where the robot file gives it. What a joint did not visit, the model does not "
            f"know.{thinned}",
            _coverage_words(details),
        ),
        source.figure(
            "workspace",
            space.workspace(details),
            "Measured targets in the tracker's frame, from two sides, with the nominal arm at one of its configurations.",
            f"Three-dimensional scatter of the measured targets, estimation and held-out, seen "
            f"from two sides; they span {_span(details)}.",
        ),
        *stands,
    ]


def _coverage_words(details: dict[str, Any]) -> str:
    spans = []
    for j, joint in enumerate(details["joints"]):
        values = [q[j] for q in details["rows"]["q"]]
        factor, unit = (
            (180 / 3.141592653589793, "degrees") if joint["unit"] == "rad" else (1.0, "mm")
        )
        spans.append(
            f"joint {j + 1} from {min(values) * factor:.0f} to {max(values) * factor:.0f} {unit}"
        )
    return f"Readings of each joint: {'; '.join(spans)}."


def _span(details: dict[str, Any]) -> str:
    sides = list(zip(*details["rows"]["measured_mm"], strict=True))
    return " by ".join(f"{max(s) - min(s):.0f}" for s in sides) + " mm"


def error_map(source: Source) -> list[Block]:
    """Places x causes."""
    result = source.result
    picture = errormap.error_map(result)
    if picture is None:
        return [
            heading("Error map"),
            text("No mechanism may extend the base in this study: nothing was scanned."),
        ]
    whole, columns = result["error_map"], errormap.strongest(result)
    cells = sum(v is not None for row in whole["f"] for v in row)
    caption = (
        "Where (rows) and why (columns) the base model errs. Darker: this cell alone would explain more. Orange dot: "
        "more than chance "
        "anywhere in the map; orange ring: and among the strongest of its column; black square: the cell of a finding. "
        "One effect darkens every "
        "cell that moves the target like it, so most dark cells are echoes."
    )
    stands = [
        f"frame {whole['places'][i]} · {whole['causes'][j]}"
        for i in range(len(whole["places"]))
        for j in columns
        if whole["f"][i][j] is not None and whole["p_family_wise"][i][j] < errormap.STANDS_OUT
    ]
    return [
        heading("Error map"),
        text(
            f"{cells:,} cells were scanned, one by one, beyond the base. Of {len(whole['causes'])} causes {len(columns)} are "
            "shown: those of findings and the strongest that act at several places. All others are in report.html."
        ),
        source.figure(
            "error-map",
            picture,
            caption,
            f"Error map of {len(whole['places'])} places by {len(columns)} causes. {len(stands)} cells stand "
            f"out beyond chance, among them {'; '.join(stands[:6]) or 'none'}.",
        ),
        points(
            [
                "tx ty tz shift along, rx ry rz turn about the axes of a frame; rz of frames 1 to n is the joint's own rotation.",
                "a & b: two numbers fitted together, as a sine and a cosine of unknown phase.",
            ]
        ),
    ]
