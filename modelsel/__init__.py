"""modelsel: what a robot's model gets wrong, why, and what is gained by saying so.

The steps of a study, each callable alone; names are loaded when first used, so that importing costs
nothing."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

from ._version import VERSION

if (
    TYPE_CHECKING
):  # the table below, for type checkers and editors; tests/test_names.py holds the two alike
    from .calibration.calibration import Calibration as Calibration
    from .calibration.compensation import correct as correct
    from .calibration.loading import load_calibration as load_calibration
    from .calibration.prediction import predict as predict
    from .config.study_file import Study as Study
    from .config.study_file import read_study as read_study
    from .exceptions import DataError as DataError
    from .exceptions import ModelselError as ModelselError
    from .exceptions import NotEstimable as NotEstimable
    from .exceptions import StudyError as StudyError
    from .fitting.design import Model as Model
    from .fitting.design import residuals as residuals
    from .fitting.least_squares import Fit as Fit
    from .measurements.measurements import Measurements as Measurements
    from .measurements.reader import read_measurements as read_measurements
    from .mechanisms.causes import Cause as Cause
    from .mechanisms.registry import BUILTIN as BUILTIN
    from .mechanisms.registry import PerJoint as PerJoint
    from .mechanisms.registry import every as every
    from .mechanisms.registry import mechanism as mechanism
    from .mechanisms.registry import with_plugins as with_plugins
    from .mechanisms.terms import Mechanism as Mechanism
    from .mechanisms.terms import Screw as Screw
    from .mechanisms.terms import Term as Term
    from .robot.files import builtin_names as builtin_names
    from .robot.files import load as load
    from .robot.files import read_robot as read_robot
    from .robot.kinematics import Robot as Robot
    from .robot.kinematics import forward as forward
    from .robot.kinematics import screw_field as screw_field
    from .selection.evaluation import estimate_gain as estimate_gain
    from .selection.splits import split_configurations as split_configurations
    from .study.planning import MeasurementPlan as MeasurementPlan
    from .study.planning import plan_next as plan_next
    from .study.result import Result as Result
    from .study.result import load_result as load_result
    from .study.runner import rehearse_study as rehearse_study
    from .study.runner import run_study as run_study
    from .study.simulation import simulate_study as simulate_study

__version__ = VERSION

# a name that is also a module's (fit, problem, extend …) is imported from there: from
# modelsel.fitting.fit import fit
_NAMES = {
    "calibration.calibration": "Calibration",
    "calibration.compensation": "correct",
    "calibration.loading": "load_calibration",
    "calibration.prediction": "predict",
    "config.study_file": "Study read_study",
    "exceptions": "DataError ModelselError NotEstimable StudyError",
    "fitting.design": "Model residuals",
    "fitting.least_squares": "Fit",
    "measurements.measurements": "Measurements",
    "measurements.reader": "read_measurements",
    "mechanisms.causes": "Cause",
    "mechanisms.registry": "BUILTIN PerJoint every mechanism with_plugins",
    "mechanisms.terms": "Mechanism Screw Term",
    "robot.files": "builtin_names load read_robot",
    "robot.kinematics": "Robot forward screw_field",
    "selection.evaluation": "estimate_gain",
    "selection.splits": "split_configurations",
    "study.planning": "MeasurementPlan plan_next",
    "study.result": "Result load_result",
    "study.runner": "rehearse_study run_study",
    "study.simulation": "simulate_study",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"modelsel.{_HOME[name]}"), name)
    raise AttributeError(f"module modelsel has no attribute {name}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
