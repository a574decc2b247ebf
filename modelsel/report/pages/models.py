"""The ladder, the table of subsets and the repeated procedure in figures."""

from __future__ import annotations

from typing import Any

from ...results.storage import Source
from ..document import Block, heading, table, text
from ..figures import ladder
from ..terminal import TABLE_FOR, mm

SIDES = ("estimation", "held_out")
ASIDE = 12  # names of what the table of subsets does not hold
ROWS = 6  # of the table of subsets


def models(source: Source) -> list[Block]:
    """The ladder, the table of subsets, the repeated procedure."""
    result = source.result
    blocks = [heading("Models"), *_ladder(result)]
    if result["candidates"]["best"]:
        blocks += _subsets(result["candidates"])
    if result["nested_cv"] is not None:
        blocks += _nested(result["nested_cv"])
    return blocks


def _errors(rung: dict[str, Any]) -> list[str]:
    return [mm(rung[side][key]) for side in SIDES for key in ("mean_mm", "max_mm")]


def _ladder(result: dict[str, Any]) -> list[Block]:
    names = ladder.names(result, list(range(len(result["ladder"]))))
    rows = [
        [name, str(r["parameters"]), str(r["rank"]), *_errors(r), mm(r["cv_rms_mm"])]
        for name, r in zip(names, result["ladder"], strict=True)
    ]
    numbers = [
        (n, "right")
        for n in ("parameters", "rank", "mean", "worst", "held-out mean", "worst", "CV rms")
    ]
    caption = (
        "Errors in mm: lengths of the residual vectors. Rank: parameters that the data determine. CV: cross-validated on the "
        "estimation configurations. A row that begins with + adds to the row above it."
    )
    return [
        heading("The ladder", 2),
        table([("model", "left"), *numbers], rows, caption, [1.0, *[0.0] * 7]),
    ]


def _subsets(candidates: dict[str, Any]) -> list[Block]:
    best = candidates["best"]
    special = [r for r in best[ROWS:] if "choice" in r["note"] or "lowest" in r["note"]]
    shown = [*best[: ROWS - len(special)], *special]
    common = _common([r["mechanisms"] for r in best])
    rows = [
        [
            " + ".join(r["mechanisms"][len(common) :]) or "nothing more",
            str(r["rank"]),
            mm(r["cv_rms_mm"]),
            mm(r["held_out"]["mean_mm"]),
            "–"
            if r["weight"] is None
            else "<0.001"
            if r["weight"] < 0.0005
            else f"{r['weight']:.3f}",
            r["note"],
        ]
        for r in shown
    ]
    columns = [(" + ".join(common) + " and" if common else "mechanisms", "left")]
    columns += [
        ("rank", "right"),
        ("CV rms", "right"),
        ("held-out mean", "right"),
        ("weight", "right"),
        ("note", "left"),
    ]
    said = (
        f"Of {candidates['compared']:,} subsets of the strongest registered mechanisms, these stand out. They check the ladder "
        f"from another side: each is fitted by one linear step and measured alike. {TABLE_FOR}"
    )
    if search := candidates.get("search"):
        said += f" Among all 2^{search['mechanisms']} subsets, branch and bound by BIC " + (
            "proves the best."
            if search["proven"]
            else "did not finish: its best may be beaten by up to "
            f"{search['may_be_beaten_by']:.3g}."
        )
    aside, more = candidates["set_aside"][:ASIDE], len(candidates["set_aside"]) - ASIDE
    rest = (
        f" The subsets are made of {len(candidates['considered'])} mechanisms; weaker alone, and left out: {', '.join(aside)}"
        f"{f' and {more} more' if more > 0 else ''}."
    )
    caption = "Errors in mm; weight: the subset's probability among those compared." + (
        rest if aside else ""
    )
    return [
        heading("The table of subsets", 2),
        text(said),
        table(columns, rows, caption, [1.4, 0.0, 0.0, 0.0, 0.0, 0.8]),
    ]


def _nested(nested: dict[str, Any]) -> list[Block]:
    said = (
        f"Everything, naming included, was repeated in {nested['folds']} folds of the estimation configurations: mean error "
        f"{mm(nested['geometric']['mean_mm'])} mm with the base, {mm(nested['chosen']['mean_mm'])} mm with what each fold chose."
    )
    rows = [[name, str(count)] for name, count in nested["named_in_folds"].items()]
    return [
        heading("The whole procedure repeated", 2),
        text(said),
        table([("name", "left"), ("folds in which it comes back", "right")], rows, "", [0.0, 0.0]),
    ]


def _common(lists: list[list[str]]) -> list[str]:
    """What all lists begin with."""
    out = []
    for words in zip(*lists, strict=False):
        if len(set(words)) > 1:
            break
        out.append(words[0])
    return out
