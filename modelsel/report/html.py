"""report.html: one self-contained page to explore a result offline; every word of the data is
escaped or set as text."""

from __future__ import annotations

import json
import re
from html import escape
from importlib.resources import files
from string import Template
from typing import Any

from ..diagnosis.findings.sentences import PREFIXES
from ..results.conclusions.placements import describe_placements
from ..results.schemas.details_schema import DetailsRecord
from ..results.schemas.finding_schema import EntryRecord, FindingRecord
from ..results.schemas.schema import RegistrationRecord, StudyRecord
from ..results.sentences.finding_advice import advise
from ..results.sentences.small_findings import split_findings
from ..results.sentences.study_sentences import (
    describe_doubt,
    describe_split,
    label_entries,
    opening_sentences,
    weigh_listed_record,
    write_figures,
)
from ..results.sentences.tables import label_ladder
from .document import Source
from .effect_sets_section import write_effect_sets
from .error_parts_section import write_error_parts
from .figures.errormap import find_named_cells
from .figures.ladder import label_way, select_way
from .html_parts import write_paragraph
from .notes_section import write_certainty_section, write_notes_section
from .pages.appendix import list_provenance
from .pages.findings import describe_advice, describe_proof
from .pages.front import WORTH, list_campaign, write_legend
from .pages.parameter_uncertainty import CERTAINTY_TITLE
from .parameters_section import write_parameters

SECTIONS = (
    ("ladder", "The ladder"),
    ("findings", "Findings"),
    ("map", "Error map"),
    ("space", "Residual vectors"),
    ("parameters", "Calibrated parameters"),
    ("certainty", CERTAINTY_TITLE),
    ("notes", "Outliers and notes"),
)
SCRIPTS = ("plot.js", "space.js", "posture.js", "map.js", "page.js")


def write_page(source: Source) -> bytes:
    """Write the whole page."""
    record, folder = source.record, files(__package__) / "templates"
    template = Template((folder / "page.html").read_text(encoding="utf-8"))
    parameters, certainty = write_parameters(source), write_certainty_section(source)
    absent = {
        name for name, said in (("parameters", parameters), ("certainty", certainty)) if not said
    }
    scripts = [(folder / name).read_text(encoding="utf-8") for name in SCRIPTS]
    page = template.substitute(
        title=escape(f"Calibration report: {record.study}"),
        study=escape(record.study),
        about=escape(f"Robot {record.robot} · {describe_split(record)}"),
        verdict="\n".join(write_paragraph(one, "verdict") for one in opening_sentences(record)),
        campaign=_write_campaign(source.details),
        effect_sets=write_effect_sets(record),
        repeatability=write_error_parts(record.repeatability),
        parameters=parameters,
        certainty=certainty,
        legend=_write_legend(source.details),
        notes=write_notes_section(source),
        sections=_link_sections(absent),
        setup=_write_setup(record.registration),
        side=record.side.replace("_", "-"),
        made=escape(", ".join(f"{name} {value}" for name, value in list_provenance(record))),
        style=(folder / "page.css").read_text(encoding="utf-8"),
        script="\n".join(scripts),
        data=embed_json(_page_data(source)),
    )
    return page.encode()


def _write_campaign(details: DetailsRecord) -> str:
    """Write what the study file says of the campaign; nothing where it says nothing."""
    said = list_campaign(details)
    return write_paragraph(" · ".join(said), "quiet") if said else ""


def _write_legend(details: DetailsRecord) -> str:
    """Write what the findings' names mean; nothing where they are all registered."""
    legend = write_legend(details)
    if not legend:
        return ""
    words = f"Names: {legend}"
    return write_paragraph(words, "quiet")


def _link_sections(absent: set[str]) -> str:
    """Write links to the sections of the page, but for those that it has not."""
    links = [
        f'<a href="#{name}-title">{words}</a>' for name, words in SECTIONS if name not in absent
    ]
    return " ".join(links)


def _write_setup(registration: RegistrationRecord | None) -> str:
    """Write where registration found the base and the targets; nothing where the study gives them."""
    if registration is None:
        return ""
    title = '<h2 id="setup-title">Where the instrument and the target stand</h2>'
    sentences = "\n".join(write_paragraph(one) for one in describe_placements(registration))
    return f'<section aria-labelledby="setup-title">\n{title}\n{sentences}\n</section>\n'


def _page_data(source: Source) -> dict[str, Any]:
    """Return what the page's scripts compute with."""
    record = source.record
    way = select_way(record)
    labels = label_way(record, way)
    told, grouped = split_findings(record.findings, record.small_findings)
    small = record.small_findings
    return {
        "result": slim_record(record),
        "details": source.details.to_dict(),
        "names": label_ladder(record),
        "ladder": list(zip(way, labels, strict=True)),
        "cells": find_named_cells(record),
        "own": [_find_own_cells(record, finding) for finding in record.findings],
        "kindred": [find_kindred_cells(record, finding) for finding in record.findings],
        "told": told,
        "verdicts": [one.told_verdict + describe_doubt(one) for one in record.findings],
        "grouped": grouped,
        "small": "" if small is None else small.sentence,
        "figures": [write_figures(finding) for finding in record.findings],
        "worth": f"{WORTH}.",
        "prefixes": PREFIXES,
        "advice": [_describe_advice(source, finding) for finding in record.findings],
        "entries": [label_entries(finding.credible_set) for finding in record.findings],
        "listed": [weigh_listed_record(finding) for finding in record.findings],
    }


def _describe_advice(source: Source, finding: FindingRecord) -> dict[str, str]:
    """Return what to do about a finding, what that is worth, and how sure it is, in the words of the PDF."""
    advice = advise(source.record, finding)
    return {
        "short": advice.sentence,
        "whole": describe_advice(source.record, finding),
        "worth": advice.worth,
        "proof": describe_proof(finding, source.where),
    }


def _find_own_cells(record: StudyRecord, finding: FindingRecord) -> list[tuple[int, int]]:
    """Return the cells of the map that stand for one finding; none where it has none of its own."""
    cells = find_named_cells(record.model_copy(update={"findings": [finding]}))
    f = record.error_map.f
    return [(row, column) for row, column in cells if f[row][column] is not None]


def find_kindred_cells(record: StudyRecord, finding: FindingRecord) -> list[tuple[int, int]]:
    """Return, for a finding without a cell of its own, as a free function is, of each of its places
    the strongest cell of which the cause depends on nothing but what drives the finding."""
    whole = record.error_map
    drivers: dict[str, set[str]] = {}
    for screw in finding.fitted_entry.screws:
        drivers.setdefault(f"{screw.frame} {screw.axis}", set()).update(_list_names(screw.cause))
    cells = []
    for row, place in enumerate(whole.places):
        strengths = [
            (strength, column)
            for column, strength in enumerate(whole.f[row])
            if strength is not None and _is_driven(whole.causes[column], drivers.get(place, set()))
        ]
        if strengths:
            cells.append((row, max(strengths)[1]))
    return cells


def _is_driven(cause: str, drivers: set[str]) -> bool:
    names = _list_names(cause)
    has_names = bool(names)
    return has_names and names <= drivers


def _list_names(cause: str) -> set[str]:
    """Return the names in a cause that are no functions."""
    return set(re.findall(r"[A-Za-z_]\w*(?![\w(])", cause))


def slim_record(record: StudyRecord) -> dict[str, Any]:
    """Return what the page needs of result.json: without the causes' values at every row, and without draws."""
    values = record.model_dump(
        by_alias=True,
        exclude_unset=True,
        include={"study", "robot", "noise_floor", "nothing_else", "error_map"},
    )
    rungs = [rung.to_dict() for rung in record.ladder]
    keys = ("mechanisms", "estimation", "held_out")
    values["ladder"] = [{key: rung[key] for key in keys} for rung in rungs]
    values["findings"] = [_slim_finding(finding) for finding in record.findings]
    return values


def _slim_finding(finding: FindingRecord) -> dict[str, Any]:
    values = finding.to_dict()
    values["credible_set"] = [_slim_entry(entry) for entry in finding.credible_set]
    values["estimate"] = []
    values["fitted"] = finding.fitted
    drawn = finding.turning if finding.only_turns else finding.worst
    values["unmeasured_joints"] = [] if drawn is None else drawn.unmeasured_joints
    for key in ("usable", "worst"):
        values.pop(key, None)
    return values


def _slim_entry(entry: EntryRecord) -> dict[str, Any]:
    values = entry.to_dict()
    for screw in values["screws"]:
        screw.pop("values", None)
    return values


def embed_json(value: Any) -> str:
    """Return JSON that cannot end the script element it stands in."""
    text = json.dumps(value, ensure_ascii=False, separators=(",", ":"), allow_nan=False)
    return text.replace("<", "\\u003c").replace("\u2028", "\\u2028").replace("\u2029", "\\u2029")
