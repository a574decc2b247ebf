"""What `import modelsel` offers: every name exists, is typed, and costs nothing until it is
used."""

from __future__ import annotations

import ast
import inspect
import subprocess
import sys
from pathlib import Path

import pytest

import modelsel


def test_type_checkers_see_the_names_that_are_there() -> None:
    tree = ast.parse(Path(modelsel.__file__).read_text(encoding="utf-8"))
    (block,) = [node for node in tree.body if isinstance(node, ast.If)]
    typed = {alias.asname: node.module for node in block.body for alias in node.names}
    assert typed == modelsel._HOME
    assert set(modelsel.__all__) <= set(dir(modelsel))
    with pytest.raises(AttributeError, match="no attribute runs"):
        _ = modelsel.runs


PUBLIC = """
Calibration DataError Diagnosis Fit MeasurementPlan Measurements Model ModelComparison ModelselError
NotEstimable Problem Result Robot Study StudyError __version__ builtin_names compare diagnose fit
load_calibration load_result load_robot mechanism mechanisms plan_next read_measurements read_study
rehearse_study run_study simulate_study split_configurations testing
"""


def test_the_public_names_are_these() -> None:
    """A name more or less is a decision: it is written here, too, and into the changelog."""
    assert dir(modelsel) == PUBLIC.split()


def test_plug_ins_find_the_parts_of_a_mechanism() -> None:
    from modelsel import mechanisms
    from modelsel.testing import check_mechanism

    parts = {"Mechanism", "PerJoint", "Screw", "Term", "cos", "q", "sign", "sin", "torque"}
    assert parts <= set(mechanisms.__all__)
    assert all(hasattr(mechanisms, name) for name in mechanisms.__all__)
    assert callable(check_mechanism)


@pytest.mark.parametrize("name", modelsel.__all__)
def test_public_functions_are_typed_and_say_what_they_do(name) -> None:
    thing = getattr(modelsel, name)
    if not callable(thing):
        return
    assert thing.__doc__
    if inspect.isfunction(thing):
        signature = inspect.signature(thing)
        assert signature.return_annotation is not inspect.Signature.empty
        assert all(
            p.annotation is not inspect.Parameter.empty for p in signature.parameters.values()
        )


def test_importing_loads_nothing_heavy() -> None:
    code = "import sys, modelsel; print(sorted(m for m in ('numpy', 'pandas', 'scipy', 'pydantic') if m in sys.modules))"
    assert (
        subprocess.run(
            [sys.executable, "-c", code], capture_output=True, text=True, check=True
        ).stdout
        == "[]\n"
    )
