"""An estimator before and after tuning, on the part of a recording that the tuning has not seen."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from harness.replay.comparison import HELD
from harness.replay.replay import COLUMNS, Outage, disjoint, paired_t_test
from harness.studies.innovations import Innovations, autocorrelation, mean_bounds

Array = npt.NDArray[np.float64]

LAGS = 20  # fixes


def summary_of(innovations: Innovations) -> dict[str, Any]:
    """NIS with the bounds of its mean, each value's share of it, log-likelihood and whiteness."""
    number = len(innovations.time)
    low, high = mean_bounds(innovations.freedom, number)
    return {
        "fixes": number,
        "nis": float(innovations.nis.mean()),
        "nis_expected": innovations.freedom,
        "nis_bounds": [low, high],
        "nis_by_value": [
            float(squared.sum() / max(1, used))
            for squared, used in zip((innovations.whitened**2).T, innovations.used.sum(axis=0), strict=True)
        ],
        "log_likelihood_per_fix": float(innovations.log_likelihood.mean()),
        "autocorrelation": autocorrelation(innovations.whitened, LAGS).tolist(),
        "autocorrelation_bound": float(stats.norm.ppf(0.975) / np.sqrt(innovations.used.sum())),
    }


def compare_errors(outages: Sequence[Outage], first: str, second: str) -> dict[str, Any]:
    """Means and medians of the errors, and a paired t-test over the outages that do not overlap."""
    separate = disjoint(outages)
    result: dict[str, Any] = {"ways": {name: {} for name in (HELD, first, second)}, "apart": len(separate)}
    for i, column in enumerate(COLUMNS):
        for name, way in result["ways"].items():
            errors = [outage.errors[name][i] for outage in outages]
            way[column] = {
                "mean": float(np.mean(errors)), "median": float(np.median(errors)), "each": errors
            }  # fmt: skip
        differences = np.array([outage.errors[first][i] - outage.errors[second][i] for outage in separate])
        test = paired_t_test(differences) if len(separate) > 2 else None
        result[f"{column}_p"] = None if test is None else float(test.pvalue)
    return result
