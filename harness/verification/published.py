"""The dissertation's numbers on its trials, in the field and simulated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binom, binomtest

Counts = NDArray[np.int64]


@dataclass(frozen=True)
class Field:
    """The field trials (Table 4.4) with a number of waypoints at a threshold h' [deg]."""

    waypoints: str
    threshold: int
    successes: int
    trials: int
    environment: str

    @property
    def interval(self) -> tuple[float, float]:
        """95 % confidence interval of the success rate (Clopper and Pearson 1934)."""
        interval = binomtest(self.successes, self.trials).proportion_ci(method="exact")
        return float(interval.low), float(interval.high)

    def p_value(self, rate: float) -> float:
        """The probability of a count at most as likely as this one if `rate` is true (exact, two-sided)."""
        return float(binomtest(self.successes, self.trials, rate).pvalue)


def log_likelihood(fields: Sequence[Field], rates: Sequence[float]) -> float:
    """How likely counts are if these rates are true (natural logarithm), below what any rates could give."""
    counts, trials = _counts(fields)
    best = binom.logpmf(counts, trials, counts / trials)
    return float((binom.logpmf(counts, trials, rates) - best).sum())


def joint_p_value(fields: Sequence[Field], rates: Sequence[float]) -> float:
    """The probability that all counts together are at most as likely as these if these rates are true.

    From 100,000 draws, good to about 0.1 %.
    """
    counts, trials = _counts(fields)
    drawn = np.random.default_rng(1).binomial(trials, rates, size=(100_000, len(fields)))
    observed = binom.logpmf(counts, trials, rates).sum()
    return float(np.mean(binom.logpmf(drawn, trials, rates).sum(axis=1) <= observed + 1e-9))


def _counts(fields: Sequence[Field]) -> tuple[Counts, Counts]:
    return np.array([f.successes for f in fields]), np.array([f.trials for f in fields])


FIELD = (  # Table 4.4; 35 trials at each of 23, 30 and 37 deg by 5.3.7.1, the others by Table 4.4's n
    Field("two", 23, 33, 35, "non-structured"),
    Field("two", 30, 34, 35, "non-structured"),
    Field("two", 37, 35, 35, "non-structured"),
    Field("two", 49, 24, 24, "structured"),
    Field("three", 37, 27, 35, "non-structured"),
    Field("three", 49, 34, 52, "structured"),
)
AT_15_ABOVE = 0.85  # 5.3.5, two waypoints
ALL_FROM, ALL_FROM_BY_TREND = 23, 26  # deg, 5.3.5: 100 %
TREND_AT_23 = 0.95  # 5.3.7.1
R_SQUARED = {"two": 0.891, "three": 0.954}  # 5.3.5, 5.3.6: of the trend through the success rates
FIELD_LATER = (3.0, 3.5)  # s, 5.3.7.1: field times above simulated ones, two waypoints
