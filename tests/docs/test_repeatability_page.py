"""The page on repeatability: its figures follow from the code and from arithmetic."""

from __future__ import annotations

import re
import tomllib

import numpy as np
import pytest
from shown_code import ROOT, fenced

from modelsel.fitting.part_trials import LEVEL
from modelsel.fitting.possible_parts import (
    MAX_COMPARED,
    MAX_COMPARED_ROWS,
    MIN_COMPARED,
    MIN_EXCESS,
    MIN_GROUPS,
    MIN_LEVELS,
)
from modelsel.measurements.campaign.visits import SAME_READING
from modelsel.results.repeatability.repeatability import LABELS

PAGE = ROOT / "docs" / "how-to" / "repeatability.md"
POSTURES, ROUNDS, SECONDS = 30, 3, 13


@pytest.fixture(scope="module")
def page() -> str:
    return re.sub(r"\s+", " ", PAGE.read_text(encoding="utf-8"))


def test_what_data_must_have_is_what_the_program_asks(page) -> None:
    assert f"Below {MIN_LEVELS} estimating configurations nothing is told" in page
    assert f"takes {MIN_EXCESS} rows or visits beyond the first of each" in page
    assert f"what groups share {MIN_GROUPS} groups" in page
    assert f"louder takes {MIN_COMPARED} of its rows" in page
    assert f"no more than {MAX_COMPARED} targets or groups" in page
    assert f"fewer than {MAX_COMPARED_ROWS:,} rows" in page
    assert f"equal to {SAME_READING:.0e} rad".replace("e-0", "e-") in page
    statistics = (ROOT / "docs" / "explanation" / "statistics.md").read_text(encoding="utf-8")
    assert "one study of a hundred" in statistics
    assert LEVEL == 1 / 100


def test_every_part_has_its_row(page) -> None:
    louder = "more noise at target B", "more noise in group s2"
    for label in ("joint 2", "instrument", *louder, *LABELS.values()):
        assert f"| **{label}** |" in page


def test_the_campaign_takes_twenty_minutes(page) -> None:
    visits = POSTURES * ROUNDS
    (toml,) = fenced("toml", PAGE.read_text(encoding="utf-8"))
    assert tomllib.loads(toml) == {"split": {"estimation": visits}}
    assert f"at {SECONDS} seconds each they take twenty minutes" in page
    assert visits * SECONDS / 60 == pytest.approx(20, abs=0.5)
    differences = POSTURES * (ROUNDS - 1)
    assert (
        f"{differences} of them determine a single scale to {1 / np.sqrt(2 * differences):.0%}".replace(
            "%", " %"
        )
        in page
    )


def test_length_that_one_of_two_halves_leaves(page) -> None:
    assert f"either alone leaves {100 * np.sqrt(0.5):.0f} % of the length" in page


def test_iso_s_figure_is_that_of_normal_errors(page) -> None:
    """RP = mean + 3 standard deviations of the length of a normal error in one or three directions."""
    from scipy.stats import chi

    times = {k: (chi(k).mean() + 3 * chi(k).std()) / np.sqrt(k) for k in (1, 3)}
    said = (
        f"RP is {times[3]:.1f} times the rms length where errors are alike in all directions, and "
        f"{times[1]:.1f} times where one joint"
    )
    assert said in page
    assert rf"$\sigma$ at a lever $r$ therefore adds ${times[1]:.1f}\,r\sigma$" in page
