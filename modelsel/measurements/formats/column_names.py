"""Names of columns as people write them, taken apart: "X [mm]", "Q1_DEG", "joint_1 (actual)"."""

from __future__ import annotations

import re
from dataclasses import dataclass

from ..._typing import Array

# units by how people write them, as the names of this program's columns have them
UNIT_WORDS = {
    **dict.fromkeys(("°", "º", "deg", "degs", "degree", "degrees", "grad°"), "deg"),
    # German for degree, in English for gon: `measurements.recognition.grad_columns` offers both
    "grad": "deg",
    **dict.fromkeys(("rad", "rads", "radian", "radians"), "rad"),
    **dict.fromkeys(("mm", "millimeter", "millimetre", "millimeters", "millimetres"), "mm"),
    **dict.fromkeys(("m", "meter", "metre", "meters", "metres"), "m"),
    **dict.fromkeys(("in", "inch", "inches"), "in"),
    **dict.fromkeys(("°c", "degc", "c", "celsius", "ºc"), "C"),
    **dict.fromkeys(("kg", "kilogram", "kilograms"), "kg"),
    **dict.fromkeys(("s", "sec", "secs", "second", "seconds"), "s"),
}
# units that are known but not read
OTHER_UNITS = frozenset[str]().union(
    ("ft", "cm", "dm", "um", "µm", "μm", "mil", "mrad", "gon", "gradian", "ms", "min"),
    ("us", "ns", "h", "hours", "minutes", "msec", "degf"),
    ("k", "f", "°f", "lb", "lbs", "g", "rev", "turns", "arcsec", "arcmin", "gradians", "gons"),
)
# lengths, in mm
LENGTHS = {
    "nm": 1e-6,
    "um": 1e-3,
    "µm": 1e-3,
    "μm": 1e-3,
    "micron": 1e-3,
    "mil": 0.0254,
    "mm": 1.0,
    "cm": 10.0,
    "in": 25.4,
    "inch": 25.4,
    "dm": 100.0,
    "ft": 304.8,
    "m": 1e3,
    "km": 1e6,
}  # mm
AXES = ("x", "y", "z")
BRACKETS = re.compile(r"[\[({<]\s*([^\])}>]*?)\s*[\])}>]")
# of several values: q[0], q(1)
COUNTED = re.compile(r"[\[(]\s*(\d{1,2})\s*[\])]")
WORD_BREAK = re.compile(r"[\s_.,:;|/\\#-]+")
CAMEL = re.compile(r"(?<=[a-z])(?=[A-Z])")
MEASURED = frozenset[str]().union(
    ("actual", "act", "meas", "measured", "measurement", "ist", "real", "fb", "feedback"),
    ("encoder", "gemessen", "messung", "tracker", "lt", "mess"),
)
COMMANDED = frozenset[str]().union(
    ("cmd", "command", "commanded", "target", "nominal", "nom", "soll", "desired", "des", "ref"),
    ("reference", "setpoint", "goal", "theoretical", "ideal", "cad", "theo"),
)
# words of a column that is not the quantity itself
OTHER_QUANTITIES = frozenset[str]().union(
    ("d", "delta", "dev", "deviation", "err", "error", "diff", "abw", "abweichung", "residual"),
    ("speed", "vel", "velocity", "v", "qd", "qdd", "acc", "current", "strom", "torque", "moment"),
    (
        "tau",
        "temp",
        "temperature",
        "std",
        "sigma",
        "rms",
        "unc",
        "uncertainty",
        "u95",
        "u",
        "s",
        "sd",
        "stdev",
        "tol",
        "min",
        "max",
    ),
)
# words of x, y, z that are an orientation's
TURN_WORDS = frozenset[str]().union(
    ("quat", "quaternion", "q", "orientation", "orient", "ori", "rotation", "rot")
)
TEMPERATURE_WORDS = frozenset(("temp", "temperature", "temperatur"))
CELSIUS_WORDS = TEMPERATURE_WORDS | {"t"}
JOINT_WORDS = frozenset[str]().union(
    ("q", "j", "a", "t", "th", "theta", "θ", "joint", "joints", "axis", "ax", "achse", "axe"),
    (
        "axes",
        "gelenk",
        "gelenke",
        "achsen",
        "jt",
        "rax",
        "jnt",
        "eje",
        "asse",
        "angle",
        "winkel",
        "enc",
        "motor",
        "position",
        "positions",
    ),
)
# joints that Universal Robots' drivers and pendants call by name, from the base on
NAMED_JOINTS = {
    **dict.fromkeys(("base", "shoulder pan"), 1),
    **dict.fromkeys(("shoulder", "shoulder lift"), 2),
    "elbow": 3,
    "wrist 1": 4,
    "wrist 2": 5,
    "wrist 3": 6,
    "basis": 1,
    "schulter": 2,
    "ellbogen": 3,
    "handgelenk 1": 4,
    "handgelenk 2": 5,
    "handgelenk 3": 6,
}
JOINT_ENDS = ("joint", "axis", "achse")
# words that are joints' only where no other column is
WEAK_JOINT_WORDS = frozenset[str]().union(
    ("a", "t", "th", "angle", "winkel", "motor", "enc", "position", "positions")
)
NUMBERED = re.compile(r"([a-zθ]+?)0*(\d{1,2})")


@dataclass(frozen=True)
class ColumnName:
    """A column's name: the quantity ("joint", "x", …), the number of a joint, the word that says
    so, the unit that the name says (None for none, "" for one that is not read), and the other
    words in it."""

    given: str
    quantity: str | None
    number: int | None
    stem: str
    unit: str | None
    words: frozenset[str]

    @property
    def is_measured(self) -> bool:
        """Whether the name says that this was measured."""
        found = self.words & MEASURED
        return bool(found)

    @property
    def is_commanded(self) -> bool:
        """Whether the name says that this was commanded."""
        found = self.words & COMMANDED
        return bool(found)


def parse_column_name(name: str, unit: str | None = None) -> ColumnName:
    """Take a column's name apart; `unit`: what a row of units says below it."""
    words, said = split_name(name, unit)
    found = next((find_unit(text) for text in said if find_unit(text) is not None), None)
    brackets = [word for text in said if find_unit(text) is None for word in text.split()]
    is_unit = len(words) > 1 and find_unit(words[-1]) is not None
    if is_unit and words[-1] == "c":
        # of "Euler_C" the letter is an angle's, KUKA's A B C
        is_unit = not CELSIUS_WORDS.isdisjoint(words)
    if found is None and is_unit:
        found = find_unit(words.pop())
        if words[-1] == "in" and len(words) > 1:
            words.pop()
    quantity, number, stem, rest = _find_quantity(words)
    return ColumnName(name, quantity, number, stem, found, frozenset([*rest, *brackets]))


def list_units(name: str, unit: str | None = None) -> list[str]:
    """List the words that a name, and a row of units, say as its unit, in small letters."""
    words, said = split_name(name, unit)
    candidates = [*said, *words[1:][-1:]]
    return [word for word in candidates if find_unit(word) is not None]


def split_name(name: str, unit: str | None) -> tuple[list[str], list[str]]:
    """Split a name into (its words, what stands in brackets or in the row of units), in small
    letters."""
    bare, inside = COUNTED.sub(r" \1 ", name), []
    for match in BRACKETS.finditer(bare):
        inside.append(match[1])
        bare = bare.replace(match[0], " ")
    words = [
        word.lower()
        for word in WORD_BREAK.split(CAMEL.sub(" ", bare.strip().removeprefix("%")))
        if word
    ]
    said = [unit.strip("[](){}<> ").lower()] if unit else []
    return words, [*said, *(text.strip().lower() for text in inside)]


def find_unit(text: str) -> str | None:
    """Find the unit that a word is: "" for one that is not read, None for no unit."""
    word = text.strip().lower()
    if word in UNIT_WORDS:
        return UNIT_WORDS[word]
    return "" if word in OTHER_UNITS else None


def _find_quantity(words: list[str]) -> tuple[str | None, int | None, str, list[str]]:
    """Find (quantity, number of a joint, the word that says so, the words left over)."""
    named = " ".join(word for word in words if word not in JOINT_WORDS | MEASURED | COMMANDED)
    if named in NAMED_JOINTS:
        kept = MEASURED | COMMANDED
        return "joint", NAMED_JOINTS[named], "joint", [word for word in words if word in kept]
    for k, word in enumerate(words):
        rest = [*words[:k], *words[k + 1 :]]
        match = NUMBERED.fullmatch(word)
        if match and (match[1] in JOINT_WORDS or match[1].endswith(JOINT_ENDS)):
            return "joint", int(match[2]), match[1], rest
        after = words[k + 1] if k + 1 < len(words) else ""
        if word in JOINT_WORDS and after.isdecimal() and len(after) < 3:
            return "joint", int(after), word, [*words[:k], *words[k + 2 :]]
    for k, word in enumerate(words):
        rest = [*words[:k], *words[k + 1 :]]
        if word.removeprefix("p") in ("x", "y", "z"):
            return word.removeprefix("p"), None, word[:-1], rest
    return None, None, "", words


def list_named_columns(names: str, values: Array) -> dict[str, Array]:
    """Name the columns of an array (m, k) by k words."""
    columns = values.T
    named = zip(names.split(), columns, strict=True)
    return dict(named)
