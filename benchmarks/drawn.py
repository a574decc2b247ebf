"""Whether a calibration can be believed beyond the tool it was measured with: drawn arms, tracker
and target unknown, one reflector.

    python -m benchmarks.drawn --studies 200 --seed 77 --out benchmarks/results/drawn.txt

Six- and seven-axis arms, 40 to 200 configurations, geometric errors of 0.5 mm and 2 mrad, in every
second study a joint that yields under gravity besides; the tool is made 150 mm longer afterwards.
The oracle knows the distribution that the errors were drawn from, the noise and the effect.
Kinematics, oracle and judgement are those of tests/long/test_drawn.py."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import numpy as np
from drawn_arms import campaign
from drawn_studies import SEVEN, SIX, contradictions, missed, off, studied


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--studies", type=int, default=200)
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    rng, began = np.random.default_rng(given.seed), time.perf_counter()
    ours, best, away, size, said = [], [], [], [], 0
    for k in range(given.studies):
        one = campaign(rng, (*SIX, *SEVEN), effect=1e-3 if k % 2 else 0.0)
        result = studied(one, k)
        q, where = one.later(rng)
        ours.append(missed(result, q, where))
        best.append(
            float(np.sqrt(np.square(one.oracle(q, result.split.used) - where).sum(1).mean()))
        )
        far, large = off(result, one)
        away.append(far)
        size.append(float(large.max()))
        said += len(contradictions(result))
        print(
            f"{k + 1:4d} {one.name:8s} {len(one.q):4d} configurations: {ours[-1]:.3f} mm, oracle {best[-1]:.3f} mm; largest "
            f"parameter {size[-1]:.1f} usual sizes; {len(result.diagnosis.findings)} findings",
            flush=True,
        )
    ratio, coordinates = np.array(ours) / np.array(best), np.concatenate(away)
    text = (
        "\n".join(
            [
                f"{given.studies} studies, seed {given.seed}, {time.perf_counter() - began:.0f} s",
                (
                    f"error at the longer tool, rms over studies: {np.sqrt(np.mean(np.square(ours))):.3f} mm; oracle "
                    f"{np.sqrt(np.mean(np.square(best))):.3f} mm; ratio {np.sqrt(np.sum(np.square(ours)) / np.sum(np.square(best))):.3f}"
                ),
                (
                    f"ratio of single studies: median {np.median(ratio):.3f}, 90 % {np.quantile(ratio, 0.9):.3f}, largest {ratio.max():.2f}, "
                    f"above 1.5 in {int((ratio > 1.5).sum())}"
                ),
                f"parameters within 4 standard errors of the truth: {np.mean(coordinates < 4):.4f} of {len(coordinates)}",
                f"largest parameter: {max(size):.1f} usual sizes; sentences that contradict a number: {said}",
            ]
        )
        + "\n"
    )
    print(text, end="")
    if given.out:
        given.out.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
