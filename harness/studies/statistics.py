"""What a reviewer asks of errors: mean, spread, median, 90th percentile; differences with their tests."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt
from scipy import stats

from harness.replay.replay import paired_t_test

Array = npt.NDArray[np.float64]
CONFIDENCE = 0.95


def summary(values: Array) -> dict[str, float]:
    """Of (n,) values; `mean_low` and `mean_high` bound the mean by Student's t."""
    mean, error = float(values.mean()), float(stats.sem(values))
    half = float(stats.t.ppf(0.5 + CONFIDENCE / 2, len(values) - 1)) * error
    return {
        "n": len(values), "mean": mean, "sd": float(values.std(ddof=1)), "median": float(np.median(values)),
        "p90": float(np.percentile(values, 90)), "mean_low": mean - half, "mean_high": mean + half,
    }  # fmt: skip


def paired(first: Array, second: Array) -> dict[str, float | None]:
    """The two-tailed paired t-test of (n,) errors of the same trials; the mean difference, bounded."""
    differences = first - second
    test = paired_t_test(differences)
    if test is None:
        return {"difference": float(differences.mean()), "t": None, "df": len(first) - 1, "p": None}
    low, high = test.confidence_interval(CONFIDENCE)
    return {
        "difference": float(differences.mean()), "low": float(low), "high": float(high),
        "t": float(test.statistic), "df": int(test.df), "p": float(test.pvalue),
    }  # fmt: skip


def unpaired(first: Array, second: Array) -> dict[str, float | None]:
    """The two-tailed t-test of errors from different trials, with pooled variance as in Table 3.1.

    There is no t where both have one value, or do not vary: the variance is not known.
    """
    df = len(first) + len(second) - 2
    if df == 0 or np.ptp(first) == np.ptp(second) == 0:
        return {"t": None, "df": df, "p": None}
    test = stats.ttest_ind(first, second)
    return {"t": float(test.statistic), "df": int(test.df), "p": float(test.pvalue)}


def share(hits: int, of: int) -> dict[str, Any]:
    """A share with its interval by Wilson."""
    interval = stats.binomtest(hits, of).proportion_ci(CONFIDENCE, "wilson")
    return {"n": of, "share": hits / of, "low": float(interval.low), "high": float(interval.high)}
