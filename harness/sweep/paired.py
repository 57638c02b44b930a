"""Two cells compared trial by trial: trial i has the same seed in both, so most of the chance cancels."""

from __future__ import annotations

import math
from collections.abc import Collection
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from harness.sweep.chance import heads, student
from harness.sweep.chunks import TICK_S
from harness.sweep.table import wilson

Ticks = npt.NDArray[np.unsignedinteger[Any]]
LEVEL = 0.975  # one side of a 95 % interval
LEAST = 2  # trials of which a mean has an interval


@dataclass(frozen=True)
class Comparison:
    """How two cells differ over the trials that both have.

    Attributes:
        pairs: trials that both have; without those that a fault ended in either.
        both, only_first, only_second, neither: of these, in which cell they succeeded.
        difference: success rate of the first less that of the second.
        ci_low, ci_high: its 95 % interval; None without pairs.
        p_value: McNemar's exact test, two-sided.
        time_difference_s: mean time of the first less that of the second, over the trials in which both
            succeeded; `time_ci_low_s`, `time_ci_high_s` its 95 % interval (Student). None if too few.
    """

    pairs: int
    both: int
    only_first: int
    only_second: int
    neither: int
    difference: float | None
    ci_low: float | None
    ci_high: float | None
    p_value: float
    time_difference_s: float | None
    time_ci_low_s: float | None
    time_ci_high_s: float | None

    def facts(self) -> dict[str, Any]:
        """As matrix.json has it."""
        return asdict(self)


def compare(first: Ticks, second: Ticks, left_out: Collection[int] = ()) -> Comparison:
    """Compare two cells.

    Args:
        first, second: (trials,) of each, the tick on which a trial succeeded, 0 if it failed; of unequal
            lengths those that both have are compared.
        left_out: numbers of trials that do not count.
    """
    counts = np.ones(min(len(first), len(second)), dtype=bool)
    counts[[number for number in left_out if number < len(counts)]] = False
    a, b = first[: len(counts)][counts].astype(np.int64), second[: len(counts)][counts].astype(np.int64)
    both, one, other = ((a > 0) & (b > 0)), ((a > 0) & (b == 0)), ((a == 0) & (b > 0))
    n_both, n_one, n_other = (int(np.count_nonzero(mask)) for mask in (both, one, other))
    neither = len(a) - n_both - n_one - n_other
    low, high = newcombe(n_both, n_one, n_other, neither) if len(a) else (None, None)
    times = _mean_interval(TICK_S * (a[both] - b[both]).astype(np.float64))
    return Comparison(
        len(a), n_both, n_one, n_other, neither,
        (n_one - n_other) / len(a) if len(a) else None, low, high,
        min(1.0, 2 * heads(max(n_one, n_other), n_one + n_other)),
        *times,
    )  # fmt: skip


def newcombe(both: int, first: int, second: int, neither: int) -> tuple[float, float]:
    """The 95 % interval of a difference of rates from the same trials (Newcombe 1998, method 10).

    It joins the two Wilson intervals, by the correlation of the pairs.

    Args:
        both, first, second, neither: trials that succeeded in both cells, in one only, in none.
    """
    n = both + first + second + neither
    one, two = (both + first) / n, (both + second) / n
    (low_one, high_one), (low_two, high_two) = wilson(both + first, n), wilson(both + second, n)
    margins = (both + first) * (second + neither) * (both + second) * (first + neither)
    excess = float(both * neither - first * second)
    if excess > 0:
        excess = max(excess - n / 2, 0.0)  # corrected for continuity
    phi = excess / math.sqrt(margins) if margins else 0.0

    def spread(down: float, up: float) -> float:
        return math.sqrt(max(0.0, down**2 - 2 * phi * down * up + up**2))

    difference = one - two
    return (
        difference - spread(one - low_one, high_two - two),
        difference + spread(high_one - one, two - low_two),
    )


def _mean_interval(
    differences: npt.NDArray[np.float64],
) -> tuple[float, float, float] | tuple[None, None, None]:
    """Mean and 95 % interval (Student); None if there are fewer than LEAST."""
    n = len(differences)
    if n < LEAST:
        return None, None, None
    mean = float(differences.mean())
    half = student(LEVEL, n - 1) * float(differences.std(ddof=1)) / math.sqrt(n)
    return mean, mean - half, mean + half
