"""Changes of a length have as many decimals whichever way they go."""

from __future__ import annotations

import pytest

from modelsel.results.sentences.study_sentences import format_gain


@pytest.mark.parametrize(("value", "text"), [(15.0, "15.00"), (9.5, "9.500"), (0.0002, "0.0002")])
def test_a_loss_reads_as_a_gain_with_a_minus(value: float, text: str) -> None:
    assert format_gain(value) == text
    assert format_gain(-value) == f"−{text}"
