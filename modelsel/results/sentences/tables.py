"""A study's record as tables: DataFrames, and a page for a notebook."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from ..._records import StrictRecord
from ...diagnosis.findings.stated_probability import format_probability
from ...exceptions import write_numbered, write_rounded
from ..schemas.finding_schema import FindingRecord
from ..schemas.model_schema import RungRecord
from ..schemas.schema import ErrorPartRecord, StudyRecord
from .small_findings import split_findings
from .study_sentences import describe_doubt

if TYPE_CHECKING:
    import pandas as pd

SIDES = ("estimation", "held_out")
LONGEST_BAR = 8.0  # em
SHORTEST_BAR = 0.08  # em


def label_models(models: Sequence[Sequence[str]]) -> list[str]:
    """Return what each model adds to the one above it, or all of it; a model is the names of its mechanisms. A name
    that a model has several times is numbered, as the symbols of its parameters are."""
    repeated = {name for names in models for name in names if names.count(name) > 1}
    labels: list[str] = []
    above: list[str] = []
    for names in (_number_repeated(names, repeated) for names in models):
        common = len(above)
        extends = len(names) > common and names[:common] == above
        if above and extends:
            added = " + ".join(names[common:])
            labels.append(f"+ {added}")
        else:
            labels.append(" + ".join(names) or "set-up alone")
        above = names
    return labels


def _number_repeated(names: Sequence[str], repeated: Collection[str]) -> list[str]:
    """Return the names of a model, with their number where they are repeated ones."""
    numbered = []
    for place, name in enumerate(names):
        number = names[: place + 1].count(name) if name in repeated else None
        numbered.append(write_numbered(name, number))
    return numbered


def label_ladder(record: StudyRecord) -> list[str]:
    """Return the ladder's labels: what each rung adds."""
    return label_models([rung.mechanisms for rung in record.ladder])


# -- DataFrames
# -----------------------------------------------------------------------------------------------------------------


def _model_row(model: RungRecord) -> dict[str, Any]:
    """Return a model in one row."""
    values = model.to_dict()
    row = {"mechanisms": " + ".join(values.pop("mechanisms"))}
    for side in SIDES:
        row |= {f"{side}_{key}": error for key, error in values.pop(side).items()}
    return row | values


def _tabulate_ladder(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    labels = label_ladder(record)
    rungs = zip(labels, record.ladder, strict=True)
    rows = [{"model": label} | _model_row(rung) for label, rung in rungs]
    return pd.DataFrame(rows)


def _tabulate_candidates(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame([_model_row(subset) for subset in record.candidates.best])


def _finding_row(finding: FindingRecord) -> dict[str, Any]:
    """Return a finding in one row."""
    gain = finding.gain
    low, high = gain.interval_mm or (None, None)
    turned_low, turned_high = gain.interval_mrad or (None, None)
    turning = finding.turning
    return {
        "name": finding.fitted_entry.name,
        "verdict": finding.verdict,
        "probability": finding.alike,
        "p_value": finding.p_value,
        "screws": finding.fitted_entry.cells,
        "held_out_rms_before_mm": gain.held_out_rms_before_mm,
        "held_out_rms_after_mm": gain.held_out_rms_after_mm,
        "gain_low_mm": low,
        "gain_high_mm": high,
        "held_out_rms_before_mrad": gain.held_out_rms_before_mrad,
        "held_out_rms_after_mrad": gain.held_out_rms_after_mrad,
        "gain_low_mrad": turned_low,
        "gain_high_mrad": turned_high,
        "doubtful": finding.doubtful,
        "matters": finding.matters,
        "rms_mm": finding.rms_mm,
        "worst_mm": None if finding.worst is None else finding.worst.mm,
        "rms_mrad": None if turning is None else turning.rms_mrad,
        "worst_mrad": None if turning is None else turning.mrad,
        "usable": "; ".join(one.text for one in finding.usable),
        "sentence": finding.sentence,
    }


# which only studies with measured orientations have
TURNING_GAINS = (
    "held_out_rms_before_mrad",
    "held_out_rms_after_mrad",
    "gain_low_mrad",
    "gain_high_mrad",
)
TURNING_SIZES = ("rms_mrad", "worst_mrad")
FINDING_COLUMNS = (
    "name",
    "verdict",
    "probability",
    "p_value",
    "screws",
    "held_out_rms_before_mm",
    "held_out_rms_after_mm",
    "gain_low_mm",
    "gain_high_mm",
    *TURNING_GAINS,
    "doubtful",
    "matters",
    "rms_mm",
    "worst_mm",
    *TURNING_SIZES,
    "usable",
    "sentence",
)


def _tabulate_findings(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    rows = [_finding_row(finding) for finding in record.findings]
    columns = list(FINDING_COLUMNS)
    if all(finding.turning is None for finding in record.findings):
        columns = [name for name in columns if name not in (*TURNING_GAINS, *TURNING_SIZES)]
    return pd.DataFrame(rows, columns=columns)


def _tabulate_credible_sets(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    rows = [
        [number, entry.name, entry.probability, entry.alike, entry.cells]
        for number, finding in enumerate(record.findings)
        for entry in finding.credible_set
    ]
    return pd.DataFrame(rows, columns=["finding", "name", "probability", "alike", "screws"])


def _tabulate_estimates(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    columns = ["finding", "name", "symbol", "value", "standard_error", "unit"]
    rows = [
        [number, finding.fitted_entry.name, one.symbol, one.value, one.standard_error, one.unit]
        for number, finding in enumerate(record.findings)
        for one in finding.estimate
    ]
    return pd.DataFrame(rows, columns=columns)


def _tabulate_records(records: Sequence[StrictRecord]) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame([record.to_dict() for record in records])


def _tabulate_repeatability(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    columns = list(ErrorPartRecord.model_fields)
    rows = [part.to_dict() for part in record.repeatability]
    return pd.DataFrame(rows, columns=columns)


def _tabulate_parameters(record: StudyRecord) -> pd.DataFrame:
    return _tabulate_records(record.parameters)


def _tabulate_significance(record: StudyRecord) -> pd.DataFrame:
    return _tabulate_records(record.significance)


def _tabulate_error_map(record: StudyRecord) -> pd.DataFrame:
    import pandas as pd

    whole = record.error_map
    places = pd.Index(whole.places, name="place")
    return pd.DataFrame(whole.f, index=places, columns=whole.causes, dtype=float)


TABLES: Mapping[str, Callable[[StudyRecord], pd.DataFrame]] = {
    "ladder": _tabulate_ladder,
    "candidates": _tabulate_candidates,
    "findings": _tabulate_findings,
    "credible sets": _tabulate_credible_sets,
    "estimates": _tabulate_estimates,
    "repeatability": _tabulate_repeatability,
    "parameters": _tabulate_parameters,
    "significance": _tabulate_significance,
    "error map": _tabulate_error_map,
}


# -- a notebook's page
# ---------------------------------------------------------------------------------------------------------


def write_notebook_page(record: StudyRecord) -> str:
    """Write verdict, ladder, findings and notes as HTML that needs nothing else; all text is escaped."""
    verdict = "".join(f"<li>{escape(sentence)}</li>" for sentence in record.verdict)
    return "".join(
        [
            _notebook_head(record),
            f"<ul>{verdict}</ul>",
            _notebook_ladder(record),
            _notebook_findings(record),
            _notebook_notes(record),
        ]
    )


def _notebook_head(record: StudyRecord) -> str:
    counts, floor = record.configurations, record.noise_floor
    return (
        f"<p><b>{escape(record.study)}</b>: {escape(record.robot)}, {counts.estimation:,} configurations fit the models, "
        f"{counts.held_out:,} are held out; noise floor {write_rounded(floor.coordinate_mm)} mm a coordinate "
        f"({escape(floor.source)})</p>"
    )


def _notebook_ladder(record: StudyRecord) -> str:
    means = [rung.side(record.side).mean_mm or 0.0 for rung in record.ladder]
    largest = max(means) or 1.0
    rows = [
        [
            escape(label),
            str(rung.parameters),
            _figure(rung.estimation.mean_mm),
            _figure(rung.held_out.mean_mm),
            _bar(mean / largest),
        ]
        for label, rung, mean in zip(label_ladder(record), record.ladder, means, strict=True)
    ]
    head = ["model", "parameters", "mean error, estimation [mm]", "held out [mm]", ""]
    return _html_table(head, rows)


def _show_finding(finding: FindingRecord) -> list[str]:
    """Return a finding as a row of a notebook."""
    verdict = finding.told_verdict + describe_doubt(finding)
    name = finding.fitted_entry.name
    probability = format_probability(finding.alike)
    return [escape(name), escape(verdict), probability, escape(finding.sentence)]


def _notebook_findings(record: StudyRecord) -> str:
    if not record.findings:
        return ""
    told, grouped = split_findings(record.findings, record.small_findings)
    rows = [_show_finding(record.findings[k]) for k in told]
    table = _html_table(["named", "verdict", "probability", "what"], rows)
    if grouped and record.small_findings is not None:
        table += f"<p>{escape(record.small_findings.sentence)}</p>"
    return table


def _notebook_notes(record: StudyRecord) -> str:
    if not record.warnings:
        return ""
    notes = "".join(f"<li>{escape(warning.sentence)}</li>" for warning in record.warnings)
    title = f"Notes ({len(record.warnings)})"
    return f"<details><summary>{title}</summary><ul>{notes}</ul></details>"


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _bar(share: float) -> str:
    """Return a bar as long as the share of the longest."""
    width = max(LONGEST_BAR * share, SHORTEST_BAR)
    return f'<div style="background:#0072B2;height:0.7em;width:{width:.2f}em"></div>'


def _html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    top = _html_cells("th", head)
    body = "".join(_html_cells("td", row) for row in rows)
    return f"<table><thead>{top}</thead><tbody>{body}</tbody></table>"


def _html_cells(tag: str, cells: Sequence[str]) -> str:
    style = 'style="text-align:left"'
    inner = "".join(f"<{tag} {style}>{cell}</{tag}>" for cell in cells)
    return f"<tr>{inner}</tr>"
