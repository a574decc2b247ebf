"""One name and one standard uncertainty of a number, wherever it stands."""

from __future__ import annotations

import numpy as np
import pytest
from report_studies import read_source

from modelsel.results.conclusions.finding_figures import scale_covariance
from modelsel.results.sentences.parameter_table import (
    find_standard_uncertainty,
    shorten_symbols,
    tabulate_calibrated,
)


def test_symbols_that_clash_keep_their_mechanism() -> None:
    symbols = ["b2 of geometric", "b2 of link-bending:2", "c3 of geometric", "x" * 20]
    assert shorten_symbols(symbols) == [*symbols[:2], "c3", "x" * 13 + "…"]


def test_symbols_of_cells_keep_their_place_and_what_tells_them_apart() -> None:
    symbols = ["m1 of 6 rz sin(q2) & cos(q2)", "m1 of 2 rx sin(q1) & cos(q1)", "m2 of 2 rx sin(q1)"]
    assert shorten_symbols(symbols) == ["m1 of 6 rz", "m1 of 2 rx", "m2"]
    symbols = ["m1 of 2 rx sin(q2) & cos(q2)", "m1 of 2 rx sin(q1) & cos(q1)"]
    assert shorten_symbols(symbols) == ["m1 of 2 rx sin(q2)", "m1 of 2 rx sin(q1)"]
    symbols = ["m of 2 rx q1", "m of 2 rx q1 times q2"]
    assert shorten_symbols(symbols) == ["m of 2 rx q1", "m of 2 rx q1 times"]


def test_star_goes_to_the_symbol_that_the_sentences_name(drawn) -> None:
    source = read_source(drawn)
    first, *rest = source.record.parameters
    parameters = [
        first.model_copy(update={"symbol": f"b2 of {owner}", "mechanism": owner})
        for owner in ("geometric", "link-bending:2")
    ]
    group = source.record.unidentifiable[0].model_copy(update={"parameters": ["b2 of geometric"]})
    update = {"parameters": [*parameters, *rest], "unidentifiable": [group]}
    rows = tabulate_calibrated(source.record.model_copy(update=update), source.details)
    marks = {row.cells[0]: row.together for row in rows if row.symbol.startswith("b2 of")}
    assert marks == {"b2 of geometric *": True, "b2 of link-bending:2": False}


def test_finding_and_table_have_one_standard_uncertainty(drawn) -> None:
    record = read_source(drawn).record
    compared = 0
    for finding in record.findings:
        for number in finding.estimate:
            own = [
                one
                for one in record.parameters
                if one.mechanism != "geometric" and one.symbol.partition(" of ")[0] == number.symbol
            ]
            if not own:  # what the data do not determine is held at nought
                assert (number.value, number.standard_error) == (0, 0)
                continue
            (parameter,) = own
            assert number.standard_error == find_standard_uncertainty(parameter)
            compared += parameter.bootstrap_error > parameter.standard_error
    assert compared


def test_covariance_takes_other_standard_errors() -> None:
    scaled = scale_covariance(np.array([[4.0, 1.0], [1.0, 1.0]]), np.array([4.0, 3.0]))
    assert np.sqrt(np.diag(scaled)) == pytest.approx([4.0, 3.0])
    assert scaled[0, 1] / 12 == pytest.approx(0.5)
