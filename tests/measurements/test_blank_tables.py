"""Tables of separators or quotes alone are refused in a sentence."""

from __future__ import annotations

from pathlib import Path

import pytest

from modelsel.exceptions import DataError
from modelsel.measurements.formats.text_table import load_text_table


@pytest.mark.parametrize("headerless", [True, False])
@pytest.mark.parametrize("text", [",,,\n,,,\n", '"\n', '""\n""\n'])
def test_a_table_without_a_value_is_refused(tmp_path: Path, text: str, headerless: bool) -> None:
    path = tmp_path / "measurements.csv"
    path.write_text(text)
    with pytest.raises(DataError, match="no row holds a name or a number"):
        load_text_table(path, None, headerless)
