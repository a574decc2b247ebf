"""The error map of the PDF lies as that of the page to explore: a row for each cause."""

from __future__ import annotations

from types import SimpleNamespace

import matplotlib.pyplot as plt

from modelsel.report.figures.errormap import _label_axes


def test_causes_are_rows_and_places_columns() -> None:
    whole = SimpleNamespace(places=["1 tx", "1 ty", "2 tx"], causes=["1", "sin(q2)"])
    figure, axes = plt.subplots()
    try:
        _label_axes(axes, whole, [0, 1])
        rows = [label.get_text() for label in axes.get_yticklabels()]
        columns = [label.get_text() for label in axes.get_xticklabels()]
    finally:
        plt.close(figure)
    assert rows == ["1", "sin(q2)"]
    assert columns == ["frame 1 tx", "frame 1 ty", "frame 2 tx"]
