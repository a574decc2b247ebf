"""The calibrated parameters as a table: nominal, calibrated, expanded uncertainty, p, and what each
moves."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import floor, log10

from ..._short_numbers import round_numbers
from ...calibration.comparison.mechanism_changes import GEOMETRY_NAMES
from ...diagnosis.findings.sentences import choose_prefix
from ..schemas.details_schema import DetailsRecord, MeaningRecord
from ..schemas.model_schema import ParameterRecord
from ..schemas.schema import StudyRecord
from .study_sentences import format_motion, format_p

# of the expanded uncertainty, U = k u
COVERAGE = 2.0
MAX_DECIMALS = 5
# significant digits of an expanded uncertainty (JCGM 100, 7.2.6)
DIGITS = 2
# words of a symbol that name its place: m1 of 6 rz
PLACE_WORDS = 4
LONGEST_SYMBOL = 14  # letters
PARAMETER_COLUMNS = (
    ("symbol", "left"),
    ("meaning", "left"),
    ("nominal", "right"),
    ("calibrated", "right"),
    ("U (k = 2)", "right"),
    ("unit", "left"),
    ("p", "right"),
    ("moves, mm", "right"),
)


@dataclass(frozen=True)
class ParameterRow:
    """One row of the table, in text; `max_mm`: what it moves, as a number; `together`: the data determine it only
    with others."""

    symbol: str
    meaning: str
    nominal: str
    calibrated: str
    expanded: str
    unit: str
    p: str
    moves: str
    max_mm: float
    together: bool

    @property
    def cells(self) -> list[str]:
        """The cells as PARAMETER_COLUMNS name them."""
        mark = " *" if self.together else ""
        return [
            f"{self.symbol}{mark}",
            self.meaning,
            self.nominal,
            self.calibrated,
            self.expanded,
            self.unit,
            self.p,
            self.moves,
        ]


def tabulate_calibrated(record: StudyRecord, details: DetailsRecord) -> list[ParameterRow]:
    """Return a row for every fitted number: the target's last, the others by frame, mechanisms below
    them; the coefficients of a free function are left out (`count_free`)."""
    meanings = {one.symbol: one for one in details.parameters}
    together = {symbol for group in record.unidentifiable for symbol in group.parameters}
    base = set(record.ladder[details.base].mechanisms)
    shown = [
        (parameter, meanings.get(parameter.symbol))
        for parameter in record.parameters
        if not _is_free(meanings.get(parameter.symbol))
    ]
    shown.sort(key=lambda pair: _sort_key(pair[0], pair[1], base))
    symbols = shorten_symbols([parameter.symbol for parameter, _ in shown])
    return [
        _write_row(parameter, meaning, symbol, parameter.symbol in together)
        for (parameter, meaning), symbol in zip(shown, symbols, strict=True)
    ]


def shorten_symbols(symbols: Sequence[str]) -> list[str]:
    """Return symbols without the names of their mechanisms, which their meanings replace; where two
    would then be alike, with as much of these as tells them apart."""
    bare = [symbol.partition(" of ")[0] for symbol in symbols]
    counts = Counter(bare)
    shortened = []
    for symbol, short in zip(symbols, bare, strict=True):
        is_shared = counts[short] > 1
        own = _tell_apart(symbol, symbols) if is_shared else _cut_symbol(short)
        shortened.append(own)
    return shortened


def number_owners(symbols: Sequence[str]) -> tuple[list[str], list[str]]:
    """Return symbols with the numbers of their mechanisms in place of the names, "m (1)", and the
    mechanisms in their order; those of the geometry stay bare."""
    labels = []
    owners: list[str] = []
    for symbol in symbols:
        bare, _, owner = symbol.partition(" of ")
        is_symbol = bool(owner) and " " not in bare
        label = bare if is_symbol else symbol
        if is_symbol and owner not in GEOMETRY_NAMES:
            if owner not in owners:
                owners.append(owner)
            number = owners.index(owner) + 1
            label = f"{bare} ({number})"
        labels.append(label)
    return labels, owners


def _tell_apart(symbol: str, symbols: Sequence[str]) -> str:
    """Return the first words of a symbol that no other one begins with: of a cell its place at least."""
    words = symbol.split(" ")
    split = [other.split(" ") for other in symbols]
    for count in range(PLACE_WORDS, len(words)):
        beginning = words[:count]
        alike = [own for own in split if own[:count] == beginning]
        if len(alike) == 1:
            return " ".join(beginning)
    return symbol


def _cut_symbol(symbol: str) -> str:
    return symbol if len(symbol) <= LONGEST_SYMBOL else f"{symbol[: LONGEST_SYMBOL - 1]}…"


def count_free(record: StudyRecord, details: DetailsRecord) -> int:
    """Return how many fitted numbers are coefficients of free functions, which say nothing alone."""
    free = {one.symbol for one in details.parameters if one.free}
    return sum(parameter.symbol in free for parameter in record.parameters)


def _is_free(meaning: MeaningRecord | None) -> bool:
    return meaning is not None and meaning.free


def _sort_key(
    parameter: ParameterRecord, meaning: MeaningRecord | None, base: set[str]
) -> tuple[bool, int]:
    """Return what sorts parameters: those of the base by frame, then those of findings as they
    joined."""
    is_named = parameter.mechanism not in base and parameter.mechanism != "set-up"
    if is_named or meaning is None or meaning.frame is None:
        return is_named, 0
    return False, meaning.frame


def _write_row(
    parameter: ParameterRecord, meaning: MeaningRecord | None, symbol: str, together: bool
) -> ParameterRow:
    nominal = 0.0 if meaning is None else meaning.nominal
    u = find_standard_uncertainty(parameter)
    factor, unit = _choose_unit(parameter, nominal or 0.0, u)
    decimals = _choose_decimals(None if u is None else COVERAGE * u / factor)
    calibrated = (nominal or 0.0) + parameter.estimate
    return ParameterRow(
        symbol=symbol,
        meaning=round_numbers(parameter.mechanism if meaning is None else meaning.meaning),
        nominal="–" if nominal is None else _write_nominal(nominal / factor, decimals),
        calibrated=write_number_plainly(calibrated / factor, decimals),
        expanded="–" if u is None else write_number_plainly(COVERAGE * u / factor, decimals),
        unit=unit,
        p=format_p(compute_parameter_p(parameter)),
        moves=format_motion(parameter.max_mm, parameter.max_mrad),
        max_mm=parameter.max_mm or 0.0,
        together=together,
    )


def _choose_unit(parameter: ParameterRecord, nominal: float, u: float | None) -> tuple[float, str]:
    """Return (factor, shown unit): mm so that rows compare, else what the findings' sentences choose."""
    if parameter.unit == "mm":
        return 1.0, "mm"
    largest = max(abs(nominal), abs(parameter.estimate), u or 0.0)
    return choose_prefix(largest, parameter.unit)


def _choose_decimals(expanded: float | None) -> int:
    """Return the decimals that two digits of an expanded uncertainty need."""
    if expanded is None or expanded <= 0:
        return 3
    decimals = DIGITS - 1 - floor(log10(expanded))
    return min(max(decimals, 0), MAX_DECIMALS)


def _write_nominal(value: float, decimals: int) -> str:
    """Return the drawing's value; zero as such."""
    return "0" if value == 0 else write_number_plainly(value, max(decimals, 2))


def write_number_plainly(value: float, decimals: int) -> str:
    """Return a number with so many decimals and a true minus sign, never minus zero."""
    text = f"{value:.{decimals}f}"
    if float(text) == 0:
        text = text.lstrip("-")
    return text.replace("-", "−")


# -- uncertainty
# --------------------------------------------------------------------------------------------------


def find_standard_uncertainty(parameter: ParameterRecord) -> float | None:
    """Return the larger of the standard errors of least squares and of the bootstrap: that of the
    interval; None where neither is known."""
    errors = [parameter.standard_error, parameter.bootstrap_error]
    known = [error for error in errors if error is not None]
    return max(known, default=None)


def compute_parameter_p(parameter: ParameterRecord) -> float | None:
    """Compute how probable a parameter that is as the drawing says makes an estimate as large: a t test
    with the interval's standard uncertainty and degrees of freedom, so that p is below 0.05 where the
    interval leaves out zero. None where that is undefined."""
    from scipy.special import stdtr

    u, units = find_standard_uncertainty(parameter), parameter.configurations
    if not u or units is None:
        return None
    freedom = max(units - 1, 1)
    size = abs(parameter.estimate)
    t = size / u
    tail = stdtr(freedom, -t)
    return float(2 * tail)
