"""`python -m benchmarks --json FILE`: every speed figure by its name, its peer's in the same run; a
table and a growth picture."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from pathlib import Path
from typing import Any

from .speed.campaigns import NAMES
from .speed.timing import pin

# name: (goal, what must hold, in words)
GOALS = {
    "subsets_vs_sklearn": (2000.0, ">="),
    "subsets_vs_lstsq": (250.0, ">="),
    "subsets_error_condition_30": (1e-10, "<="),
    "subsets_error_condition_1e8": (1e-7, "<="),
    "assembly_vs_pinocchio": (30.0, ">="),
    "assembly_of_fill": (0.18, ">="),
    "stream_vs_sklearn": (12.0, ">="),
    "stream_mb_beyond_inputs": (16.0, "<="),
    "stream_of_gemm": (0.30, ">="),
    "scan_vs_ftests": (100.0, ">="),
    "posterior_vs_emcee": (800.0, ">="),
    "study_seconds": (2.0, "<="),
    "help_vs_numpy": (1.5, "<="),
    "first_verdict_seconds": (3.0, "<="),
    "whole_study_seconds": (8.0, "<="),
    "drawn_study_seconds": (1.0, "<="),
    "torques_study_seconds": (20.0, "<="),
    "ur5_study_seconds": (8.0, "<="),
    "reflectors_study_seconds": (20.0, "<="),
    "reflectors_study_mb": (600.0, "<="),
    "ripple_study_seconds": (60.0, "<="),
    "ripple_study_mb": (1000.0, "<="),
    "million_study_seconds": (100.0, "<="),
    "fleet_two_workers": (1.6, ">="),
    "fleet_overhead_ms": (20.0, "<="),
}
FAMILIES = (
    "subsets",
    "assembly",
    "stream",
    "scan",
    "posterior",
    "startup",
    "campaigns",
    "fleet",
)  # the fleet last: it takes both cores
RESULTS = Path(__file__).parent / "results"
BEFORE = "before_"  # begins the figures of another checkout


def table(figures: dict[str, float]) -> str:
    """The figures with a goal, beside those of another checkout in the same run, then the others."""
    heads = [f"{'figure':32}{'before':>12}{'measured':>14}{'goal':>14}  reached"]
    heads += [_line(name, figures) for name in GOALS]
    others = [name for name in figures if name not in GOALS and not _stands_beside(name, figures)]
    lines = [f"{name:32}{_before(name, figures)}{figures[name]:14.4g}" for name in others]
    return "\n".join([*heads, "", *lines]) + "\n"


def _line(name: str, figures: dict[str, float]) -> str:
    """The table's line of a figure with a goal."""
    goal, sense = GOALS[name]
    wanted = f"{sense} {goal:g}"
    if name not in figures:
        return f"{name:32}{'':12}{'not measured':>14}{wanted:>14}"
    good = figures[name] >= goal if sense == ">=" else figures[name] <= goal
    verdict = "yes" if good else "NO"
    return f"{name:32}{_before(name, figures)}{figures[name]:14.4g}{wanted:>14}  {verdict}"


def _before(name: str, figures: dict[str, float]) -> str:
    """The other checkout's figure, 12 characters; blank where it has none."""
    value = figures.get(BEFORE + name)
    return " " * 12 if value is None else f"{value:12.4g}"


def _stands_beside(name: str, figures: dict[str, float]) -> bool:
    """Whether a figure is the other checkout's one of a figure that has a line."""
    return name.startswith(BEFORE) and name.removeprefix(BEFORE) in figures


def picture(growth: dict[str, list[tuple[int, float]]], path: Path) -> None:
    """Seconds against configurations, parameters and candidates."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    panels = (
        ("configurations", ("assembly", "streaming fit")),
        ("parameters (50,000 configurations)", ("parameters",)),
        ("candidates in all subsets", ("subsets",)),
    )
    for axes, (what, curves) in zip(figure.subplots(1, 3), panels, strict=True):
        for curve in curves:
            axes.plot(*zip(*growth[curve], strict=True), "o-", label=curve)
        axes.set(
            xlabel=what,
            ylabel="seconds, one core",
            yscale="log",
            xscale="log" if what == "configurations" else "linear",
        )
        if len(curves) > 1:
            axes.legend(frameon=False)
        axes.spines[["top", "right"]].set_visible(False)
    figure.savefig(path, dpi=110)


def draw_growth(path: Path) -> None:
    """Measure how time grows, and draw it."""
    from .speed import assembly, stream, subsets

    pin()
    growth = {
        "assembly": assembly.growth(),
        "streaming fit": stream.growth(),
        "parameters": stream.growth_parameters(),
        "subsets": subsets.growth(),
    }
    picture(growth, path)


def read_arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--json",
        type=Path,
        default=RESULTS / "speed.json",
        help="file of the figures; a .txt and a .png beside it",
    )
    parser.add_argument(
        "--only", nargs="*", choices=FAMILIES, default=FAMILIES, help="families of figures"
    )
    parser.add_argument(
        "--before",
        type=Path,
        metavar="DIR",
        help="another checkout of this repository, whose studies of the campaigns run in turn",
    )
    parser.add_argument(
        "--campaigns", nargs="*", choices=NAMES, default=NAMES, help="campaigns that are studied"
    )
    parser.add_argument("--studies", type=int, default=500, help="studies of the fleet")
    parser.add_argument(
        "--configurations", type=int, default=1_000_000, help="of the streaming fit"
    )
    return parser.parse_args()


def measure(asked: argparse.Namespace) -> dict[str, float]:
    """Measure the families that are asked for, and print each one's figures."""
    arguments: dict[str, tuple[Any, ...]] = {
        "fleet": (asked.studies,),
        "stream": (asked.configurations,),
        "campaigns": (asked.before, asked.campaigns),
    }
    figures: dict[str, float] = {}
    for family in asked.only:
        module = importlib.import_module(f"benchmarks.speed.{family}")
        found = module.run(*arguments.get(family, ()))
        figures |= found
        print("\n".join(f"{name:40}{value:14.4g}" for name, value in found.items()), flush=True)
    return figures


def main() -> None:
    asked = read_arguments()
    pin()
    figures = measure(asked)
    if asked.json.is_file() and set(asked.only) != set(FAMILIES):
        figures = json.loads(asked.json.read_text())["figures"] | figures
    record = {
        "figures": figures,
        "goals": {name: f"{sense} {goal:g}" for name, (goal, sense) in GOALS.items()},
        "machine": {
            "processor": platform.machine(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
        },
    }
    asked.json.parent.mkdir(parents=True, exist_ok=True)
    asked.json.write_text(json.dumps(record, indent=1) + "\n")
    asked.json.with_suffix(".txt").write_text(table(figures))
    if set(asked.only) >= {"subsets", "assembly", "stream"}:
        draw_growth(asked.json.with_suffix(".png"))
    print(table(figures))


if __name__ == "__main__":
    main()
