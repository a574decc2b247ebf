"""A mutant, and what stands in the cells and headers of broken tables.

A mutant is SAME (the same numbers must come out), REFUSED (must be), or ANY (a clean study or a
clear refusal)."""

from __future__ import annotations

from dataclasses import dataclass

SAME, REFUSED, ANY = "same", "refused", "any"
Grid = list[list[str]]
READINGS = ("q1_rad", "q2_rad", "q3_rad", "x_mm", "y_mm", "z_mm", "order")
NO_NUMBERS = (
    "",
    " ",
    "abc",
    "nan",
    "NaN",
    "inf",
    "-inf",
    "1e400",
    "1,5",
    "1;5",
    "0x10",
    "1_000",
    "None",
    "True",
    "−1.5",
    "1.5.2",
    "1e",
    "--1",
    "=1+1",
    "=cmd|'/c calc'!A0",
    "@SUM(A1)",
    "{{7*7}}",
    "$(touch pwned)",
    "'1.5",
    "#REF!",
    "n/a",
    "1 000",
    "\u200b",
    "🤖",
    "a\nb",
    'a"b',
    "x" * 5000,
)
NUMBERS = (
    "0",
    "-0",
    "-0.0",
    "1e308",
    "-1e308",
    "1e300",
    "1e160",
    "1e30",
    "5e-324",
    "1e-320",
    "９",
    "٣",
    "9" * 30,
    "0" * 400 + "1",
    "12.566370614359172",
    "12.6",
    "1e6",
    "-1e6",
    "0.1e1",
)
NAMES = (
    "",
    " ",
    "q1",
    "q4_rad",
    "q0_rad",
    "q01_rad",
    "x",
    "x_m",
    "x_cm",
    "X_MM",
    "q1_deg",
    "q1_mm",
    "sx_mm",
    "qw",
    "approach1",
    "approach9",
    "target",
    "configuration",
    "group",
    "payload_kg",
    "temperature_C",
    "time_s",
    "torque2",
    "moment_x",
    "progress",
    "free",
    "sin",
    "1",
    "nan",
    "__import__('os').system('touch pwned')",
    '=HYPERLINK("http://localhost/")',
    "../../x",
    "/etc/passwd",
    "a" * 3000,
    "café",
    "ｘ_mm",
    "x\u200b_mm",
    "\u202ex_mm",
    "q1\u00a0rad",
    "lambda",
    "import",
    "x_mm\n",
    'a"b',
    "a\0b",
    "🤖",
    "q1_rad ",
)


@dataclass(frozen=True)
class Mutant:
    """A file's bytes, what was done to it, and what is expected: an outcome and, where refused, its
    exit statuses."""

    name: str
    content: bytes
    expect: str = ANY
    exits: tuple[int, ...] = (2, 3, 4)
