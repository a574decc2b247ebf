"""Words that options of the command line choose from, light to import: the command line offers them
before it loads what they stand for."""

from __future__ import annotations

EXPORT_FORMS = (
    "urdf",
    "dh",
    "mdh",
    "hayati",
    "ur-calibration",
    "json",
    "csv",
    "python",
    "table",
    "grid",
)
PLAN_CRITERIA = ("d", "a", "o1", "o2", "o3", "o4", "o5")
PLAN_PURPOSES = ("rivals", *PLAN_CRITERIA)
TARGET_FORMS = ("csv", "robodk", "urscript", "krl", "rapid", "ls")
