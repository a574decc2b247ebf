"""Results as words and tables for a terminal or a log (rich)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from ..diagnosis.error_map import select_strongest_causes
from ..exceptions import sentence_list
from ..notices import ALARMS, HOPELESS, alarms
from ..results.placements import standing_sentences
from ..results.tables import adds
from ..selection.evaluation import Errors
from ..uncertainty.bootstrap import REPLICATES

if TYPE_CHECKING:
    from rich.console import Console

    from ..results.result import Result


TABLE_FOR = (
    "The table asks which names predict best together, and may add one that chance brought; naming asks of each whether "
    "chance would do as well, over all that was scanned: only that finds, and the two may differ."
)


def mm(value: float | None) -> str:
    """A length with three digits, a dash where undefined."""
    if value is None:
        return "–"
    return f"{value:.3f}" if value < 9.9995 else f"{value:.2f}"


def _errors(e: Errors) -> list[str]:
    return [mm(e.mean_mm), mm(e.max_mm)]


def show(result: Result, console: Console) -> None:
    """The whole study on a terminal: what is wrong, the ladder, what is gained, what the data
    cannot tell."""
    from rich.table import Table
    from rich.text import Text

    data, estimation = result.data.problem.data, result.data.estimation
    console.print(
        Text.assemble(
            "\n",
            (result.study.name, "bold"),
            f": {result.robot.name}, "  # Text: no name is markup
            f"{data.take(estimation).configurations:,} configurations estimate, "
            f"{data.take(~estimation).configurations:,} are held out",
        )
    )
    table = Table(
        title="Ladder: errors in mm, lengths of the residual vectors",
        title_justify="left",
        title_style="bold",
    )
    table.add_column("model", overflow="fold")
    for column in (
        "parameters",
        "rank",
        "mean",
        "worst",
        "held-out mean",
        "worst",
        "CV rms",
        "AICc",
    ):
        table.add_column(column, justify="right")
    for model, r in zip(adds([r.names for r in result.ladder]), result.ladder, strict=True):
        table.add_row(
            Text(model),
            str(r.parameters),
            str(r.rank),
            *_errors(r.estimation),
            *_errors(r.held_out),
            mm(r.cv_rms_mm),
            "–" if r.aicc is None else f"{r.aicc:.0f}",
        )
    console.print(table)
    if result.comparison is not None:
        shown = Table(
            title=f"Best of {result.comparison.compared:,} candidate models, by cross-validation: errors in mm; "
            "weight: probability among them",
            title_justify="left",
            title_style="bold",
        )
        shown.add_column("base and", overflow="fold")
        for column in ("rank", "CV rms", "held-out mean", "weight"):
            shown.add_column(column, justify="right")
        shown.add_column("note", overflow="fold")
        base = len(result.study.model.base)
        for r in result.comparison.best:
            shown.add_row(
                Text(" + ".join(r.names[base:]) or "nothing"),
                str(r.rank),
                mm(r.cv_rms_mm),
                mm(r.held_out.mean_mm),
                "–" if r.weight is None else f"{r.weight:.3f}",
                Text(r.note),
            )
        shown.caption = TABLE_FOR
        console.print(shown)
    show_map(result, console)
    show_significance(result, console)
    for sentence in sentences(result):
        console.print(sentence, highlight=False, markup=False, emoji=False)


SHADES = ((3.0, "·"), (10.0, "░"), (30.0, "▒"), (100.0, "▓"), (np.inf, "█"))
MAP_COLUMNS = 14


def show_map(result: Result, console: Console) -> None:
    """The error map seen from the base: darker explains more alone; what stands out beyond chance
    is in colour."""
    from rich.table import Table
    from rich.text import Text

    whole = result.error_map
    if not whole.causes:
        return
    table = Table(
        title="Error map: F of each place and cause alone, beyond the base (· < 3, ░ < 10, ▒ < 30, ▓ < 100, █; "
        "bold: p < 0.05 over the whole map)",
        title_justify="left",
        title_style="bold",
        box=None,
        padding=(0, 1),
    )
    table.add_column("place")
    columns = select_strongest_causes(whole, MAP_COLUMNS)
    for j in columns:
        table.add_column(
            Text(whole.causes[j].replace(" & ", "\n")), justify="center", overflow="fold"
        )
    for i, place in enumerate(whole.places):
        cells = []
        for j in columns:
            f, out = whole.f[i, j], whole.p[i, j] < 0.05
            shade = " " if np.isnan(f) else next(mark for bound, mark in SHADES if f < bound)
            cells.append(Text(shade * 2, style="bold red" if out else "dim"))
        table.add_row(f"frame {place}", *cells)
    console.print(table)


NOMINAL = (
    "Nominal p and halves take the names as given: the search is not repeated for them; the p of a finding is that of "
    "the whole search."
)


def show_significance(result: Result, console: Console) -> None:
    """What each mechanism of the chosen model matters, and what is lost without it."""
    from rich.table import Table
    from rich.text import Text

    rows = result.confidence.significance
    if not rows:
        return
    table = Table(
        title="How much each mechanism matters: displacement it causes, and errors without it, in mm",
        title_justify="left",
        title_style="bold",
    )
    table.add_column("mechanism", overflow="fold")
    for column in (
        "mean",
        "worst",
        "F",
        "nominal p",
        "log10 evidence",
        "CV rms without",
        "held-out rms without",
        "stays in halves",
    ):
        table.add_column(column, justify="right")
    table.add_column("catalogue", overflow="fold")
    for s in rows:
        table.add_row(
            Text(s.mechanism),
            mm(s.mean_mm),
            mm(s.max_mm),
            _figure(s.f),
            _nominal(s.p),
            _figure(s.log10_evidence),
            mm(s.cv_rms_without_mm),
            mm(s.held_out_rms_without_mm),
            "–" if s.stability is None else f"{s.stability:.0%}",
            Text(s.catalogue),
        )
    first = rows[0]
    table.caption = f"with all of them: CV rms {mm(first.cv_rms_mm)}, held-out rms {mm(first.held_out_rms_mm)}. {NOMINAL}"
    console.print(table)


def _figure(value: float | None) -> str:
    return "–" if value is None else "< 1e-99" if 0 <= value < 1e-99 else f"{value:.3g}"


def _nominal(p: float | None) -> str:
    """A p that signs alone have made is a bound: they tell no smaller one."""
    return _figure(p) if p is None or p > 1 / (REPLICATES + 1) else f"≤ {1 / (REPLICATES + 1):.3g}"


def sure_sentences(result: Result) -> list[str]:
    """Parameters that the data tell only together, and what was sampled."""
    out = [f"Only together: {pair.sentence}" for pair in result.confidence.correlation.pairs[:6]]
    more = len(result.confidence.correlation.pairs) - 6
    if more > 0:
        out.append(f"Only together: {more} further pairs correlate above 0.9.")
    s = result.confidence.sampling
    if s is not None:
        state = (
            f"{s.effective.min():,.0f} effective samples, R-hat {s.r_hat.max():.3f}"
            if s.converged
            else "not converged, and nothing of it is quoted"
        )
        out.append(
            f"Sampling: {s.what} {s.steps:,} steps of {s.walkers} walkers, autocorrelation time {s.tau.max():.0f}: "
            f"{state}. {s.importance.sentence}"
        )
    return out


PLACED = {
    "wire": "its anchor stands",
    "ball-bar": "its sphere stands",
    "same-point": "it stands",
    "plane": "a point of it is",
}
LISTED = 12  # features


def feature_sentences(result: Result) -> list[str]:
    """Where the chosen model has what rows share and nobody knew."""
    some = [f for f in result.features if f.fitted]
    out = []
    for f in some[:LISTED]:
        parts = [f"{PLACED[f.kind]} at {', '.join(f'{v:.2f}' for v in f.position_mm)} mm"]
        if f.normal is not None:
            parts.append(f"square to {', '.join(f'{v:.5f}' for v in f.normal)}")
        if f.length_mm is not None:
            parts.append(
                f"{f.length_mm:.3f} mm long"
                if f.kind == "ball-bar"
                else f"its readings leave out {f.length_mm:.3f} mm"
            )
        out.append(f"Feature {f.name} ({f.kind}): {', '.join(parts)}.")
    return out + (
        [f"{len(some) - LISTED} more features are in result.json."] if len(some) > LISTED else []
    )


def sentences(result: Result) -> list[str]:
    """The study in words."""
    first, last = result.ladder[0], result.chosen
    called = sentence_list(last.names) if last.names else "nominal"
    out = [*alarms(result.warnings), *(w.sentence for w in result.warnings if w.code == HOPELESS)]
    out += [
        (
            f"Nominal model: {mm(first.estimation.mean_mm)} mm mean, {mm(first.estimation.max_mm)} mm worst. Chosen model "
            f"({called}): {mm(last.estimation.mean_mm)} mm mean; noise floor "
            f"{result.floor.coordinate_mm:.3g} mm per coordinate ({result.floor.source})."
        )
    ]
    out += [f.sentence for f in result.faults]
    out += [
        f"Found: {f.sentence}"
        if f.effect.named.verdict == "found"
        else f"Not told apart: {f.sentence}"
        for f in result.findings
    ]
    out.append(result.nothing_else[0])
    if result.predictable is not None:
        share, p = max(result.predictable.share, 0.0), result.predictable.p
        out.append(
            f"Some smooth function of the configuration would still predict {share:.0%} of what is left (p = {p:.2g})."
            if p <= 0.05 and share > 0.01
            else "No smooth function of the configuration predicts what is left."
        )
    if result.data.outlying.any():
        data = result.data.problem.data
        rows = data.row[result.data.outlying]
        out.append(
            f"Outliers left out: {len(rows)} row{'s' * (len(rows) != 1)} ({data.where.listed(rows, 20)})."
        )
    gain = result.gain
    if gain.held_out_rms_before_mm is not None:
        interval = (
            ""
            if gain.interval_mm is None
            else (f", a gain of {gain.interval_mm[0]:.3g} to {gain.interval_mm[1]:.3g} mm (95 %)")
        )
        out.append(
            f"On held-out configurations: {mm(gain.held_out_rms_before_mm)} -> {mm(gain.held_out_rms_after_mm)} mm rms"
            f"{interval}."
        )
    out += (
        []
        if result.standing is None
        else [f"Registered: {s[0].lower()}{s[1:]}" for s in standing_sentences(result.standing)]
    )
    out += feature_sentences(result)
    out += [f"Not identifiable: {u.sentence}" for u in result.unidentifiable]
    out += sure_sentences(result)
    return out + [
        f"Note: {w.sentence}"
        for w in (*result.warnings, *result.confidence.notes)
        if w.code not in ALARMS
    ]
