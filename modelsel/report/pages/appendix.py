"""The last pages: what the data cannot tell, outliers and warnings, provenance."""

from __future__ import annotations

from ...measurements.table import where_from_record
from ...results.storage import Source
from ...results.tables import name_of
from ..document import Block, heading, points, table, text

ROWS = 60
CALLED = {"data_sha256": "measurements, SHA-256", "study_sha256": "study file, SHA-256"}


def unidentifiable(source: Source) -> list[Block]:
    """Combinations that no data of this kind determine."""
    found = source.result["unidentifiable"]
    if not found:
        return [
            heading("What the data cannot tell"),
            text("The data determine every parameter of the chosen model."),
        ]
    return [
        heading("What the data cannot tell"),
        text(
            "The data determine only combinations of these parameters, or hardly determine them. Where they leave a value open, "
            "its usual size decides, and its standard error says how far; predictions where the target was measured are the same."
        ),
        points([u["sentence"] for u in found]),
    ]


def outliers(source: Source) -> list[Block]:
    """Rows left out, faults of the data, warnings."""
    result = source.result
    rows = result["outliers"]
    where = where_from_record(source.details.get("places"))
    shown = where.listed(rows, ROWS) + (
        " of the file; the header is line 1" if where.is_text else ""
    )
    blocks = [
        heading("Outliers and warnings", opens=False),
        text(
            f"Left out: {len(rows)} row{'s' * (len(rows) != 1)} ({shown})."
            if rows
            else "No row was left out."
        ),
    ]
    faults = [
        f["sentence"]
        for f in result["findings"]
        if f["credible_set"] and name_of(f["credible_set"][0]).startswith("fault:")
    ]
    if faults:
        blocks.append(points(faults))
    if result["warnings"]:
        blocks += [heading("Warnings", 2), points([w["sentence"] for w in result["warnings"]])]
    return blocks


def provenance(source: Source) -> list[Block]:
    """What this report was made from."""
    result = source.result
    rows = [
        ["study", result["study"]],
        ["robot", result["robot"]],
        ["seed", str(result["seed"])],
        *([CALLED.get(k, k), str(v)] for k, v in result["provenance"].items()),
    ]
    steps = result["path"]
    blocks = [
        heading("Provenance", opens=False),
        table([("what", "left"), ("value", "left")], rows, "", [0.0, 1.0]),
    ]
    if steps:
        blocks += [
            heading("How the model grew", 2),
            text(
                "An effect joined (+), was dropped (−) or got a better name (→), in this order: "
                + ";  ".join(s.replace("->", "→").replace("- ", "− ") for s in steps)
                + "."
            ),
        ]
    return [
        *blocks,
        text(
            "The same measurements, study file and seed give the same bytes of result.json, of this report and of "
            "report.html. Every "
            "number in the text is from result.json.",
            "quiet",
        ),
    ]
