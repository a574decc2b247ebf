"""modelsel: what a robot's model gets wrong, why, and what is gained by saying so.

The steps of a study, each callable alone; names are loaded when first used, so that importing costs nothing.
"""
from __future__ import annotations

from importlib import import_module
from typing import Any

from .words.version import VERSION

__version__ = VERSION

_NAMES = {  # a name that is also a module's (fit, scene, extend …) is imported from there: from modelsel.fitting.fit import fit
    "data.io": "read_measurements",
    "machine.robot": "forward screw_field",
    "machine.robotfile": "load read_robot builtin_names",
    "wrong.causes": "Cause",
    "wrong.registry": "mechanism every BUILTIN PerJoint",
    "wrong.screws": "Screw Term Mechanism",
    "matrix.design": "Model residuals",
    "fitting.fit": "Fit",
    "which.split": "choose",
    "which.validate": "gain",
    "use.calibration": "load_calibration Calibration predict",
    "telling.config": "read_study Study",
    "telling.study": "run rehearse simulate_study",
    "telling.stored": "save load_result StoredResult report calibration_of",
    "telling.finished": "Result",
}
_HOME = {name: module for module, names in _NAMES.items() for name in names.split()}
__all__ = sorted(_HOME)


def __getattr__(name: str) -> Any:
    if name in _HOME:
        return getattr(import_module(f"modelsel.{_HOME[name]}"), name)
    raise AttributeError(f"module modelsel has no attribute {name}")


def __dir__() -> list[str]:
    return [*__all__, "__version__"]
