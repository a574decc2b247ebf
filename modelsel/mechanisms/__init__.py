"""What can be wrong: causes, screws, terms and the registry of error mechanisms.

A mechanism is a named set of terms; a term is one fitted number that scales one or more screws, each
a place (frame and axis) and a cause. Causes are built from `q`, `torque`, `Named` and numbers with
`+ - * /`, `sin`, `cos` and `sign`. `PerJoint` builds a mechanism once per joint, `Scanned` once per
value of a constant. `BUILTIN` is the registry; `mechanism(name, robot)` builds one of its entries.
"""

from .causes import Cause, Named, cos, q, sign, sin, torque
from .registry import BUILTIN, PerJoint, Registry, Scanned, every, mechanism, with_plugins
from .terms import Mechanism, Screw, Term

__all__ = [
    "BUILTIN",
    "Cause",
    "Mechanism",
    "Named",
    "PerJoint",
    "Registry",
    "Scanned",
    "Screw",
    "Term",
    "cos",
    "every",
    "mechanism",
    "q",
    "sign",
    "sin",
    "torque",
    "with_plugins",
]
