"""The curve over effect size: found and named, beside what an oracle finds."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

SHOWN = (
    ("modelsel", "found", "C0", 0.98),
    ("modelsel", "right", "C2", 1.02),
    ("EBIC(1)", "right", "C1", 1.06),
)


def picture(curve: list[dict[str, Any]], path: Path) -> None:
    """Three panels, one for each number of configurations: rates over size with 95 % intervals."""
    import matplotlib as mpl

    mpl.use("Agg")
    import matplotlib.pyplot as plt

    fig, axes = plt.subplots(1, 3, figsize=(10, 3.4), sharey=True, constrained_layout=True)
    for ax, m in zip(axes, (40, 80, 200), strict=True):
        part = [c for c in curve if c["m"] == m and c["modelsel"]["found"]["of"]]
        if not part:
            continue
        x = [np.sqrt(c["low"] * c["high"]) for c in part]
        ax.plot(
            x, [c["oracle"]["mean"] for c in part], color="0.4", lw=2, label="oracle finds (A.7)"
        )
        ax.plot(
            x,
            [c["allowed"]["mean"] for c in part],
            color="0.4",
            lw=1,
            ls="--",
            label="A.7 lets name",
        )
        for method, name, colour, shift in SHOWN:
            if method not in part[0]:
                continue
            r = [c[method][name] for c in part]
            y = np.array([v["rate"] for v in r])
            spread = [y - [v["low"] for v in r], [v["high"] for v in r] - y]
            ax.errorbar(
                np.array(x) * shift,
                y,
                yerr=np.maximum(spread, 0),
                marker="o",
                ms=3,
                lw=1,
                color=colour,
                label=f"{method} {name}",
            )
        ax.set(xscale="log", title=f"{m} configurations", xlabel="rms per coordinate / noise")
        ax.set_xticks([0.3, 0.5, 1, 2, 5], ["0.3", "0.5", "1", "2", "5"])
        ax.minorticks_off()
    axes[0].set(ylabel="rate", ylim=(-0.03, 1.03))
    axes[2].legend(fontsize=7, loc="lower right")
    fig.savefig(path, dpi=110, metadata={"Software": None})
    plt.close(fig)
