"""Whether result.json and details.json, each sound in itself, fit each other: lists of one length, indices within
their ends."""

from __future__ import annotations

from collections.abc import Iterator, Sequence, Sized

from .schemas.details_schema import DetailsRecord
from .schemas.schema import StudyRecord

Count = tuple[str, int, int]  # place, expected, actual


def find_disagreement(record: StudyRecord, details: DetailsRecord) -> str | None:
    """Return the first place where the two files of a run do not fit, in words; None where they do."""
    for place, expected, actual in _counts(record, details):
        if actual != expected:
            return f"{place} has {actual} where {expected} belong"
    places, causes = len(record.error_map.places), len(record.error_map.causes)
    for row, column, _ in details.map.named:
        if not (0 <= row < places and 0 <= column < causes):
            return "details.json: map.named names a cell that the map does not have"
    for number, finding in enumerate(record.findings, 1):
        listed = len(finding.credible_set)
        if not 0 <= finding.fitted < listed:
            where = f"result.json: findings.{number}.fitted"
            return f"{where} is {finding.fitted}, and its credible set has {listed} entries"
    rungs = len(record.ladder)
    if not 0 <= details.base < rungs:
        return f"details.json: base is {details.base}, and the ladder has {rungs} rungs"
    return None


def _counts(record: StudyRecord, details: DetailsRecord) -> Iterator[Count]:
    """Yield every length that another part of the files determines."""
    yield from _row_counts(details)
    yield from _rung_counts(record, details)
    yield from _map_counts(record, details)
    yield from _uncertainty_counts(record)
    yield from _panel_counts(record, details)


def _each(place: str, expected: int, lists: Sequence[Sized]) -> Iterator[Count]:
    return ((place, expected, len(one)) for one in lists)


def _row_counts(details: DetailsRecord) -> Iterator[Count]:
    rows, joints = details.rows, len(details.joints)
    by_row: list[Sized] = [rows.estimation, rows.outlying, rows.q, rows.measured_mm]
    by_row += [one for one in (rows.progress, rows.move, rows.temperature_C) if one is not None]
    yield from _each("details.json: rows", len(rows.row), by_row)
    yield from _each("details.json: rows.q", joints, rows.q)
    origins = joints + 1 if joints else 1
    yield "details.json: arm_mm", origins, len(details.arm_mm)
    if details.arm is not None:
        yield "details.json: arm.slides", joints, len(details.arm.slides)
        yield "details.json: arm.origins_mm", joints + 2, len(details.arm.origins_mm)
        yield "details.json: arm.axes", joints + 2, len(details.arm.axes)
    postures = [finding.posture.origins_mm for finding in details.findings if finding.posture]
    yield from _each("details.json: findings.posture.origins_mm", joints + 2, postures)


def _rung_counts(record: StudyRecord, details: DetailsRecord) -> Iterator[Count]:
    rows = len(details.rows.row)
    yield "details.json: rungs", len(record.ladder), len(details.rungs)
    residuals = [rung.residual_mm for rung in details.rungs]
    rotations = [rung.rotation_rad for rung in details.rungs if rung.rotation_rad]
    yield from _each("details.json: rungs.residual_mm", rows, residuals)
    yield from _each("details.json: rungs.rotation_rad", rows, rotations)


def _map_counts(record: StudyRecord, details: DetailsRecord) -> Iterator[Count]:
    whole, drawn, rows = record.error_map, details.map, len(details.rows.row)
    places, causes = len(whole.places), len(whole.causes)
    yield "details.json: map.places", places, len(drawn.places)
    yield from _each("details.json: map.places.d", rows, [place.d for place in drawn.places])
    yield "details.json: map.columns", causes, len(drawn.columns)
    for column in drawn.columns:
        yield from _each("details.json: map.columns.values", rows, column.values or [])
    for name, table in (
        ("result.json: error_map.f", whole.f),
        ("result.json: error_map.p_family_wise", whole.p_family_wise),
        ("details.json: map.slopes", drawn.slopes),
    ):
        yield name, places, len(table)
        yield from _each(name, causes, table)


def _uncertainty_counts(record: StudyRecord) -> Iterator[Count]:
    correlation, symbols = record.correlation, len(record.correlation.symbols)
    yield "result.json: correlation.matrix", symbols, len(correlation.matrix)
    yield from _each("result.json: correlation.matrix", symbols, correlation.matrix)
    if record.sampling is not None:
        trace = record.sampling.trace
        yield from _each("result.json: sampling.trace.draws", len(trace.names), trace.draws)


def _panel_counts(record: StudyRecord, details: DetailsRecord) -> Iterator[Count]:
    yield "details.json: findings", len(record.findings), len(details.findings)
    for number, finding in enumerate(details.findings, 1):
        place = f"details.json: findings.{number}.panels"
        for panel in finding.panels:
            by_point = [panel.before, panel.after, panel.weight]
            yield from _each(place, len(panel.x), by_point)
            yield f"{place}.curve", len(panel.curve[0]), len(panel.curve[1])
