"""A first look: how far the hand is off by the nominal arm and by the base, told before causes are sought."""

from __future__ import annotations

from dataclasses import dataclass, replace

from ..._progress import News
from ..._typing import Mask, Say
from ...config.study_file import Study
from ...exceptions import write_rounded
from ...fitting.least_squares import Fit
from ...mechanisms.registry import Registry
from ...selection.evaluation import Split, evaluate
from .held_out_outliers import exclude_held_out_outliers
from .model_ladder import NOMINAL, build_nominal, remeasure


@dataclass(frozen=True)
class FirstLook:
    """The first look of a study at its measurements, and whom it tells."""

    study: Study
    registry: Registry
    split: Split
    say: Say

    def tell(self, outlying: Mask, fitted: Fit) -> None:
        """Tell the errors of the nominal arm and of the fitted base, without the outlying rows (m,)."""
        study = self.study
        split = replace(self.split, outlying=outlying)
        problem = split.problem
        nominal_model = build_nominal(study, problem, self.registry)
        nominal = evaluate(split, nominal_model, NOMINAL)
        base = evaluate(split, fitted.model, study.model.base, fitted)
        split = exclude_held_out_outliers(split, [nominal, base])
        sizes = []
        for evaluation in (nominal, base):
            measured = remeasure(evaluation, split)
            held_out = measured.held_out
            rms_mm = held_out.rms_mm
            if rms_mm is None:  # no row is held out
                return
            size = write_rounded(rms_mm)
            sizes.append(size)
        first, second = sizes
        words = f"nominal arm {first} mm rms, base {second} mm, on held-out configurations"
        news = News(words, kept=True)
        self.say(news)
