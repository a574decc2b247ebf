"""report.html: one self-contained page to explore a result offline; every word of the data is
escaped or set as text."""

from __future__ import annotations

import json
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from ..results.placements import standing_sentences
from ..results.storage import Source
from .figures import errormap, ladder
from .pages.appendix import CALLED
from .pages.front import opening

SCRIPTS = ("plot.js", "space.js", "map.js", "page.js")


def slim(result: dict[str, Any]) -> dict[str, Any]:
    """What the page needs of result.json: without the causes' values at every row, and without
    draws."""
    findings = [
        {
            **f,
            "credible_set": [
                {
                    **e,
                    "screws": [{k: s[k] for k in ("frame", "axis", "cause")} for s in e["screws"]],
                }
                for e in f["credible_set"]
            ],
            "estimate": [],
        }
        for f in result["findings"]
    ]
    keys = ("study", "robot", "noise_floor", "nothing_else", "error_map")
    rungs = [{k: r[k] for k in ("mechanisms", "estimation", "held_out")} for r in result["ladder"]]
    return {**{k: result[k] for k in keys}, "ladder": rungs, "findings": findings}


def embedded(value: Any) -> str:
    """JSON that cannot end the script element it stands in."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")


def _setup(placed: dict[str, Any] | None) -> str:
    """Where registration found the base and the targets; nothing where the study gives them."""
    if placed is None:
        return ""
    said = "\n".join(f"<p>{escape(sentence)}</p>" for sentence in standing_sentences(placed))
    title = '<h2 id="setup-title">Where the tracker and the target stand</h2>'
    return f'<section aria-labelledby="setup-title">\n{title}\n{said}\n</section>\n'


def page(source: Source) -> bytes:
    """The whole page."""
    result, details, folder = source.result, source.details, files(__package__) / "templates"
    counts, way = result["configurations"], ladder.rungs(result)
    data = {
        "result": slim(result),
        "details": details,
        "names": ladder.names(result, list(range(len(result["ladder"])))),
        "ladder": list(zip(way, ladder.names(result, way), strict=True)),
        "cells": errormap.named_cells(result),
    }
    made = ", ".join(f"{CALLED.get(k, k)} {v}" for k, v in result["provenance"].items())
    return (
        Template((folder / "page.html").read_text(encoding="utf-8"))
        .substitute(
            title=escape(f"Calibration report: {result['study']}"),
            study=escape(result["study"]),
            about=escape(
                f"Robot {result['robot']} · {counts['estimation']:,} configurations estimate, {counts['held_out']:,} are held out"
            ),
            verdict="\n".join(
                f'<p class="verdict">{escape(sentence)}</p>' for sentence in opening(result)
            ),
            setup=_setup(result.get("registration")),
            side="held-out" if counts["held_out"] else "estimation",
            made=escape(made),
            style=(folder / "page.css").read_text(encoding="utf-8"),
            script="\n".join((folder / name).read_text(encoding="utf-8") for name in SCRIPTS),
            data=embedded(data),
        )
        .encode()
    )
