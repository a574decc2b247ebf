"""What the long runs measured, as rows of the reliability page: read from benchmarks/results, never
typed."""

from __future__ import annotations

import json
import re
from collections import Counter
from pathlib import Path
from typing import Any

SURE = re.compile(
    r"^    (both|listed effects|unlisted effects) +(\d+)  ([\d.]+ \[[\d., ]+\])$", re.MULTILINE
)  # studies, claims with 0.9 or more, share that is right
RESULTS = Path(__file__).parents[2] / "benchmarks" / "results"
STATED_PICTURE = RESULTS / "stated.png"
NULL = re.compile(
    r"^([A-Za-z0-9 ]+?) {2,}(\d+) {2,}([\d.]+ \[[\d., ]+\])", re.MULTILINE
)  # noise, studies, something found


def _rate(figure: dict[str, Any]) -> str:
    return f"{figure['rate']:.3f} [{figure['low']:.3f}, {figure['high']:.3f}] ({figure['hits']} of {figure['of']})"


def measured() -> str:
    """Rows on false alarms, credible sets and several effects at once."""
    found = NULL.findall((RESULTS / "nulls.txt").read_text(encoding="utf-8"))
    tried = f"nothing planted, {found[0][1]} studies under each of {len(found)} kinds of noise, level 5 %"
    said = "; ".join(f"{noise} {rate}" for noise, _, rate in found)
    figures = json.loads((RESULTS / "naming.json").read_text(encoding="utf-8"))["summary"][
        "figures"
    ]
    at_once = [
        (
            "" if k else "**Several effects at once**",
            f"{words}, each of which an oracle finds",
            f"all of them named right: {_rate(figures[f'{count} at once, all named right'])}",
            "`benchmarks.naming`",
        )
        for k, (count, words) in enumerate(
            (
                ("three", "three planted effects, 40 to 200 configurations"),
                ("five", "five planted effects, 120 configurations"),
            )
        )
    ]
    rows = (
        (
            "**False alarms**",
            tried,
            said,
            "`benchmarks.nulls`; short: `tests/long/test_false_alarms.py`",
        ),
        (
            "",
            "nothing planted, three arms, equal noise",
            _rate(figures["false alarm, no effect"]),
            "`benchmarks.naming`",
        ),
        (
            "**Credible sets**",
            "planted effects, by formulas other than the search's",
            f"hold the cause: {_rate(figures['coverage, all found'])}",
            "`benchmarks.naming`; short: `tests/integration/test_hidden.py`",
        ),
        *at_once,
    )
    return "\n".join(f"| {' | '.join(row)} |" for row in rows)


def stated() -> str:
    """The curve of stated probabilities, and how many of the sure claims are right."""
    text = (RESULTS / "stated.txt").read_text(encoding="utf-8")
    sure = {words: (said, rate) for words, said, rate in SURE.findall(text)}
    counts = [
        f"{sure[words][1]} of {sure[words][0]}{after}"
        for words, after in (
            ("both", " claims in all"),
            ("listed effects", " where the effects are listed"),
            ("unlisted effects", " where they are not"),
        )
    ]
    command, _, _ = text.partition("\n")
    alt = "Stated probability and the share that is right, with 95 % intervals"
    return (
        f"![{alt}](made/stated.png){{ .figure }}\n\n*{alt} (`{command}`).*{{ .caption }}\n\n"
        f"Of claims with a probability of 0.9 or more these shares are right: {counts[0]}, {counts[1]} and "
        f"{counts[2]}."
    )


def broken() -> str:
    """How many broken files came to which end, of `python tests/support/fuzz_engine.py`."""
    runs = json.loads((RESULTS / "fuzz.json").read_text(encoding="utf-8"))["runs"]
    total: dict[str, Counter[str]] = {}
    for run in runs:
        for kind, counted in run["by_kind"].items():
            total.setdefault(kind, Counter()).update(counted)
    total["**all**"] = sum(total.values(), Counter())
    ends = sorted(total["**all**"])
    rows = [
        f"| {kind} | "
        + " | ".join(f"{counted[end]:,}" for end in ends)
        + f" | {counted.total():,} |"
        for kind, counted in total.items()
    ]
    notes = [run["note"] for run in runs if "note" in run]
    return "\n".join(
        [
            f"| file | {' | '.join(ends)} | all |",
            "|---" + "|--:" * (len(ends) + 1) + "|",
            *rows,
            "",
            *(f"{note[0].upper()}{note[1:]}." for note in notes),
        ]
    )


def naming() -> str:
    """The table of the naming benchmark, a row per method."""
    kept = json.loads((RESULTS / "naming.json").read_text(encoding="utf-8"))["summary"]["table"]
    head = (
        "| method, on the same candidates | false alarms without effect | found | correctly named "
        "| surplus findings per case | held-out error over the oracle's |"
    )
    rows = [head, "|---|---|---|---|---|---|"]
    for method, row in kept.items():
        rates = " | ".join(f"{row[key]['rate']:.2f}" for key in ("false alarm", "found", "right"))
        surplus, error = row["extra"]["mean"], row["held-out"]["mean"]
        rows.append(f"| {method} | {rates} | {surplus:.2f} | {error:.3f} |")
    return "\n".join(rows)
