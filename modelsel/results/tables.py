"""A finished study seen as tables: DataFrames of result.json's content, and a page for a
notebook."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING, Any

from .._json import to_json
from ..exceptions import StudyError, suggest

if TYPE_CHECKING:
    import pandas as pd

Record = Mapping[str, Any]
Row = dict[str, Any]
SIDES = ("estimation", "held_out")


class Views(ABC):
    """What a finished study and one read back from its folder have in common."""

    @property
    @abstractmethod
    def record(self) -> Record:
        """result.json's content as plain values."""

    @abstractmethod
    def residuals(self) -> pd.DataFrame:
        """Residuals of the nominal, the base and the chosen model, a row each row that was
        measured."""

    def to_frame(self, what: str = "ladder") -> pd.DataFrame:
        """One of the result's tables: "ladder", "candidates", "findings", "credible sets",
        "estimates", "parameters", "significance", "error map" (places by causes, F) or "residuals".
        Raises StudyError for another name."""
        if what == "residuals":
            return self.residuals()
        if what not in TABLES:
            raise StudyError(
                f'a result has no table "{what}". {suggest(what, (*TABLES, "residuals"))}'
            )
        return TABLES[what](self.record)

    def to_json(self) -> str:
        """result.json's text."""
        return to_json(self.record)

    def __repr__(self) -> str:
        return (
            f"{type(self).__name__} of {self.record['study']!r}. {' '.join(self.record['verdict'])}"
        )

    def _repr_html_(self) -> str:
        """Verdict, ladder and findings, for a notebook."""
        return page(self.record)


def adds(rungs: Sequence[Sequence[str]]) -> list[str]:
    """What each rung adds to the one above it, or all of it; a rung is the names of its
    mechanisms."""
    out, above = list[str](), list[str]()
    for names in map(list, rungs):
        more = above and names[: len(above)] == above and len(names) > len(above)
        out.append(
            f"+ {' + '.join(names[len(above) :])}" if more else " + ".join(names) or "set-up alone"
        )
        above = names
    return out


def _rung(rung: Row) -> Row:
    """A rung of the ladder in one row."""
    errors = {f"{side}_{key}": rung[side][key] for side in SIDES for key in rung[side]}
    rest = {key: value for key, value in rung.items() if key not in (*SIDES, "mechanisms")}
    return {"mechanisms": " + ".join(rung["mechanisms"])} | errors | rest


def _ladder(record: Record) -> pd.DataFrame:
    import pandas as pd

    ladder = record["ladder"]
    models = adds([rung["mechanisms"] for rung in ladder])
    return pd.DataFrame(
        [{"model": model} | _rung(rung) for model, rung in zip(models, ladder, strict=True)]
    )


def _candidates(record: Record) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame([_rung(rung) for rung in record["candidates"]["best"]])


def screws(entry: Row) -> str:
    """Places and causes of an entry: frame 5 rz · q4."""
    return "; ".join(f"frame {s['frame']} {s['axis']} · {s['cause']}" for s in entry["screws"])


def name_of(entry: dict[str, Any]) -> str:
    """A registered name, or the cell: frame 6 ty · q4."""
    if entry["mechanism"]:
        return str(entry["mechanism"])
    first = entry["screws"][0] if entry["screws"] else {"frame": "?", "axis": "", "cause": ""}
    if str(first["cause"]).startswith("free("):
        return str(first["cause"])
    causes = " & ".join(dict.fromkeys(str(s["cause"]) for s in entry["screws"]))
    return f"frame {first['frame']} {first['axis']} · {causes}"


def alike(finding: Row) -> float:
    """How probable those entries are, together, that move the target as the first one does."""
    return float(min(sum(e["probability"] for e in finding["credible_set"] if e["alike"]), 1.0))


def _findings(record: Record) -> pd.DataFrame:
    import pandas as pd

    columns = [
        "name",
        "verdict",
        "probability",
        "p_value",
        "screws",
        "held_out_rms_before_mm",
        "held_out_rms_after_mm",
        "gain_low_mm",
        "gain_high_mm",
        "sentence",
    ]
    rows = []
    for f in record["findings"]:
        first, gain = f["credible_set"][0], f["gain"]
        low, high = gain["interval_mm"] or (None, None)
        rows.append(
            [
                name_of(first),
                f["verdict"],
                alike(f),
                f["p_value"],
                screws(first),
                gain["held_out_rms_before_mm"],
                gain["held_out_rms_after_mm"],
                low,
                high,
                f["sentence"],
            ]
        )
    return pd.DataFrame(rows, columns=columns)


def _credible_sets(record: Record) -> pd.DataFrame:
    import pandas as pd

    rows = [
        [k, name_of(e), e["probability"], e["alike"], screws(e)]
        for k, f in enumerate(record["findings"])
        for e in f["credible_set"]
    ]
    return pd.DataFrame(rows, columns=["finding", "name", "probability", "alike", "screws"])


def _estimates(record: Record) -> pd.DataFrame:
    import pandas as pd

    keys = ["symbol", "value", "standard_error", "unit"]
    rows = [
        [k, name_of(f["credible_set"][0]), *(e[key] for key in keys)]
        for k, f in enumerate(record["findings"])
        for e in f["estimate"]
    ]
    return pd.DataFrame(rows, columns=["finding", "name", *keys])


def _listed(key: str) -> Callable[[Record], pd.DataFrame]:
    def frame(record: Record) -> pd.DataFrame:
        import pandas as pd

        return pd.DataFrame(record[key])

    return frame


def _error_map(record: Record) -> pd.DataFrame:
    import pandas as pd

    whole = record["error_map"]
    return pd.DataFrame(
        whole["f"],
        index=pd.Index(whole["places"], name="place"),
        columns=whole["causes"],
        dtype=float,
    )


TABLES: Mapping[str, Callable[[Record], pd.DataFrame]] = {
    "ladder": _ladder,
    "candidates": _candidates,
    "findings": _findings,
    "credible sets": _credible_sets,
    "estimates": _estimates,
    "parameters": _listed("parameters"),
    "significance": _listed("significance"),
    "error map": _error_map,
}


# -- a notebook's page
# ---------------------------------------------------------------------------------------------------------


def page(record: Record) -> str:
    """Verdict, ladder, findings and notes as HTML that needs nothing else; all text is escaped."""
    counts, floor = record["configurations"], record["noise_floor"]
    side = "held_out" if counts["held_out"] else "estimation"
    head = (
        f"<p><b>{escape(record['study'])}</b>: {escape(record['robot'])}, {counts['estimation']:,} configurations estimate, "
        f"{counts['held_out']:,} are held out; noise floor {floor['coordinate_mm']:.3g} mm a coordinate "
        f"({escape(floor['source'])})</p>"
    )
    said = "".join(f"<li>{escape(sentence)}</li>" for sentence in record["verdict"])
    ladder = record["ladder"]
    largest = max((r[side]["mean_mm"] or 0.0 for r in ladder), default=0.0) or 1.0
    steps = [
        [
            escape(model),
            str(r["parameters"]),
            _figure(r["estimation"]["mean_mm"]),
            _figure(r["held_out"]["mean_mm"]),
            _bar((r[side]["mean_mm"] or 0.0) / largest),
        ]
        for model, r in zip(adds([r["mechanisms"] for r in ladder]), ladder, strict=True)
    ]
    found = [
        [
            escape(name_of(f["credible_set"][0])),
            escape(f["verdict"]),
            f"{alike(f):.2f}",
            escape(f["sentence"]),
        ]
        for f in record["findings"]
    ]
    notes = "".join(f"<li>{escape(w['sentence'])}</li>" for w in record["warnings"])
    return "".join(
        [
            head,
            f"<ul>{said}</ul>",
            _table(
                ["model", "parameters", "mean error, estimation [mm]", "held out [mm]", ""], steps
            ),
            _table(["named", "verdict", "probability", "what"], found) if found else "",
            f"<details><summary>Notes ({len(record['warnings'])})</summary><ul>{notes}</ul></details>"
            if notes
            else "",
        ]
    )


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _bar(share: float) -> str:
    """A bar as long as the share of the longest."""
    return f'<div style="background:#0072B2;height:0.7em;width:{max(8 * share, 0.08):.2f}em"></div>'


def _table(head: list[str], rows: list[list[str]]) -> str:
    left = 'style="text-align:left"'
    top = "".join(f"<th {left}>{h}</th>" for h in head)
    body = "".join(f"<tr>{''.join(f'<td {left}>{cell}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{top}</tr></thead><tbody>{body}</tbody></table>"
