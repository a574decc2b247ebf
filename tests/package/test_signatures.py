"""What Python shows of the public functions and errors."""

from __future__ import annotations

import inspect

import pytest

import modelsel as ms
from modelsel.exceptions import StudyError

FUNCTIONS = ("run_study", "rehearse_study", "diagnose", "mechanism")


@pytest.mark.parametrize("name", FUNCTIONS)
def test_the_registry_is_shown_by_its_name(name) -> None:
    signature = str(inspect.signature(getattr(ms, name)))
    assert "= BUILTIN" in signature
    assert " at 0x" not in signature


def test_errors_of_a_study_have_the_public_name() -> None:
    with pytest.raises(StudyError) as caught:
        ms.Study(name="s", sed=1)
    assert type(caught.value) is StudyError
    assert caught.value.places
    assert 'unknown key "sed". Did you mean "seed"?' in caught.value.problems
