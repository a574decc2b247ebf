"""The README of a study has the figures of its run."""

from __future__ import annotations

import re
from pathlib import Path

from report_studies import written

README = Path(__file__).parents[2] / "studies" / "puma760" / "README.md"
ROW = re.compile(
    r"^\| [^|]+ \| `(?P<name>[\w:-]+)` \| (?P<estimates>[^|]+±[^|]+) \|$", re.MULTILINE
)
MINUS = str.maketrans("−", "-")


def test_estimates_of_the_puma_study_are_those_of_its_run(drawn) -> None:
    """Their standard errors were those of a version before."""
    result, _ = written(drawn)
    sentences = {
        finding["credible_set"][0]["mechanism"]: finding["sentence"].translate(MINUS)
        for finding in result["findings"]
    }
    rows = list(ROW.finditer(README.read_text(encoding="utf-8").translate(MINUS)))
    assert {row["name"] for row in rows} == set(sentences)
    for row in rows:
        for estimate in row["estimates"].split(", "):
            assert estimate in sentences[row["name"]]
