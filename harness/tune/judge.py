"""An estimator before and after tuning, on the part of a recording that the tuning has not seen."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from harness.replay.comparison import HELD
from harness.replay.outage import COLUMNS, Outage, disjoint
from harness.replay.replay import paired_t_test
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


def compare_errors(outages: Sequence[Outage], baselines: Sequence[str], tuned: str) -> dict[str, Any]:
    """Means and medians of the errors, and paired t-tests over the outages that do not overlap.

    Args:
        baselines: each is tested against `tuned`.
    """
    separate = disjoint(outages)
    result: dict[str, Any] = {"ways": {name: {} for name in (HELD, *baselines, tuned)}}
    result["apart"] = len(separate)
    for i, column in enumerate(COLUMNS):
        for name, way in result["ways"].items():
            errors = [outage.errors[name][i] for outage in outages]
            way[column] = {
                "mean": float(np.mean(errors)), "median": float(np.median(errors)), "each": errors
            }  # fmt: skip
        result[f"{column}_p"] = {name: _p(separate, name, tuned, i) for name in baselines}
    return result


def _p(outages: Sequence[Outage], first: str, second: str, column: int) -> float | None:
    """Of the paired t-test of a column of the errors; None where there is no test."""
    differences = np.array(
        [outage.errors[first][column] - outage.errors[second][column] for outage in outages]
    )
    test = paired_t_test(differences) if len(outages) > 2 else None
    return None if test is None else float(test.pvalue)


def doubts(judged: Mapping[str, Mapping[str, Any]], tuned: str) -> list[str]:
    """Why the part that the tuning has not seen does not confirm it, a line each; none if it does."""
    row, lines = judged[tuned], []
    low, high = row["nis_bounds"]
    if not low <= row["nis"] <= high:
        what = "larger" if row["nis"] > high else "smaller"
        lines.append(
            f"the second half does not confirm the tuning: its NIS is {row['nis']:.3g}, expected "
            f"{low:.2f} to {high:.2f}; the innovations are {what} there than it states"
        )
    for name, other in judged.items():
        if other["log_likelihood_per_fix"] > row["log_likelihood_per_fix"]:
            lines.append(f"the second half does not confirm the tuning: {name} is more likely there")
    return lines
