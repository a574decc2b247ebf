"""`python -m benchmarks --json FILE`: every speed figure by its name, its peer's in the same run; a
table and a growth picture."""

from __future__ import annotations

import argparse
import importlib
import json
import os
import platform
from pathlib import Path

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
    "fleet",
)  # the fleet last: it takes both cores
RESULTS = Path(__file__).parent / "results"


def table(figures: dict[str, float]) -> str:
    """The figures with a goal, then the others."""
    lines = [f"{'figure':32}{'measured':>14}{'goal':>14}  reached"]
    for name, (goal, sense) in GOALS.items():
        if name in figures:
            good = figures[name] >= goal if sense == ">=" else figures[name] <= goal
            lines.append(
                f"{name:32}{figures[name]:14.4g}{sense + ' ' + format(goal, 'g'):>14}  {'yes' if good else 'NO'}"
            )
        else:
            lines.append(f"{name:32}{'not measured':>14}{sense + ' ' + format(goal, 'g'):>14}")
    return (
        "\n".join(
            [
                *lines,
                "",
                *(
                    f"{name:40}{value:14.4g}"
                    for name, value in figures.items()
                    if name not in GOALS
                ),
            ]
        )
        + "\n"
    )


def picture(growth: dict[str, list[tuple[int, float]]], path: Path) -> None:
    """Seconds against configurations, parameters and candidates."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10, 3.4), layout="constrained")
    for axes, (what, curves) in zip(
        figure.subplots(1, 3),
        (
            ("configurations", ("assembly", "streaming fit")),
            ("parameters (50,000 configurations)", ("parameters",)),
            ("candidates in all subsets", ("subsets",)),
        ),
    ):
        for curve in curves:
            axes.plot(*zip(*growth[curve]), "o-", label=curve)
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


def main() -> None:
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
    parser.add_argument("--studies", type=int, default=500, help="studies of the fleet")
    parser.add_argument(
        "--configurations", type=int, default=1_000_000, help="of the streaming fit"
    )
    asked = parser.parse_args()
    pin()
    figures: dict[str, float] = {}
    for family in asked.only:
        module = importlib.import_module(f"benchmarks.speed.{family}")
        arguments = {"fleet": (asked.studies,), "stream": (asked.configurations,)}.get(family, ())
        found = module.run(*arguments)
        figures |= found
        print(
            table(found).split("\n\n")[0]
            if not found
            else "\n".join(f"{k:40}{v:14.4g}" for k, v in found.items()),
            flush=True,
        )
    before = (
        json.loads(asked.json.read_text())["figures"]
        if asked.json.is_file() and set(asked.only) != set(FAMILIES)
        else {}
    )
    figures = before | figures
    machine = {
        "processor": platform.machine(),
        "cores": os.cpu_count(),
        "python": platform.python_version(),
    }
    asked.json.parent.mkdir(parents=True, exist_ok=True)
    asked.json.write_text(
        json.dumps(
            {
                "figures": figures,
                "goals": {k: f"{s} {g:g}" for k, (g, s) in GOALS.items()},
                "machine": machine,
            },
            indent=1,
        )
        + "\n"
    )
    asked.json.with_suffix(".txt").write_text(table(figures))
    if set(asked.only) >= {"subsets", "assembly", "stream"}:
        from .speed import assembly, stream, subsets

        pin()
        picture(
            {
                "assembly": assembly.growth(),
                "streaming fit": stream.growth(),
                "parameters": stream.growth_parameters(),
                "subsets": subsets.growth(),
            },
            asked.json.with_suffix(".png"),
        )
    print(table(figures))


if __name__ == "__main__":
    main()
