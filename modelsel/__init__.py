"""modelsel: find which errors a measured robot arm has, what causes them, and what correcting them gains.

A whole study:  result = run_study("study.toml");  result.findings;  result.report("reports/cell")
Step by step:   load_robot, read_measurements, Problem, Model, fit, compare, diagnose
Afterwards:     result.save(folder), load_result(folder), result.calibration.predict(measurements),
                .correct(targets), .export("urdf"), plan_next(result)
Mechanisms:     modelsel.mechanisms has the registry and the parts of a mechanism of your own,
                modelsel.testing.check_mechanism tries it.

Names are loaded when first used: importing modelsel costs nothing.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import VERSION

# The table below, for type checkers and editors; tests hold the two alike.
if TYPE_CHECKING:
    from .calibration.calibration import Calibration as Calibration
    from .calibration.loading import load_calibration as load_calibration
    from .config.study_file import Study as Study
    from .config.study_file import read_study as read_study
    from .diagnosis.findings.outcome import Diagnosis as Diagnosis
    from .diagnosis.procedure import diagnose as diagnose
    from .exceptions import DataError as DataError
    from .exceptions import ModelselError as ModelselError
    from .exceptions import NotEstimable as NotEstimable
    from .exceptions import StudyError as StudyError
    from .fitting.design import Model as Model
    from .fitting.least_squares import Fit as Fit
    from .fitting.least_squares import fit as fit
    from .fitting.problem import Problem as Problem
    from .measurements.measurements import Measurements as Measurements
    from .measurements.reader import read_measurements as read_measurements
    from .mechanisms.registry import mechanism as mechanism
    from .robot.files import builtin_names as builtin_names
    from .robot.files import load_robot as load_robot
    from .robot.kinematics import Robot as Robot
    from .selection.model_comparison import ModelComparison as ModelComparison
    from .selection.model_comparison import compare as compare
    from .selection.splits import split_configurations as split_configurations
    from .study.pipeline.result import Result as Result
    from .study.pipeline.result import load_result as load_result
    from .study.pipeline.runner import rehearse_study as rehearse_study
    from .study.pipeline.runner import run_study as run_study
    from .study.planning.planning import MeasurementPlan as MeasurementPlan
    from .study.planning.planning import plan_next as plan_next
    from .study.simulation import simulate_study as simulate_study

__version__ = VERSION

_NAMES = {
    "calibration.calibration": "Calibration",
    "calibration.loading": "load_calibration",
    "config.study_file": "Study read_study",
    "diagnosis.findings.outcome": "Diagnosis",
    "diagnosis.procedure": "diagnose",
    "exceptions": "DataError ModelselError NotEstimable StudyError",
    "fitting.design": "Model",
    "fitting.least_squares": "Fit fit",
    "fitting.problem": "Problem",
    "measurements.measurements": "Measurements",
    "measurements.reader": "read_measurements",
    "mechanisms.registry": "mechanism",
    "robot.files": "builtin_names load_robot",
    "robot.kinematics": "Robot",
    "selection.model_comparison": "ModelComparison compare",
    "selection.splits": "split_configurations",
    "study.planning.planning": "MeasurementPlan plan_next",
    "study.pipeline.result": "Result load_result",
    "study.pipeline.runner": "rehearse_study run_study",
    "study.simulation": "simulate_study",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
_SUBMODULES = ("mechanisms", "testing")
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"modelsel.{_HOME[name]}"), name)
    if name in _SUBMODULES:
        return import_module(f"modelsel.{name}")
    raise AttributeError(f"module modelsel has no attribute {name}")


def __dir__() -> list[str]:
    return sorted([*__all__, *_SUBMODULES, "__version__"])
