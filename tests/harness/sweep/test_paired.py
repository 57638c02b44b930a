"""Two cells compared trial by trial."""

from __future__ import annotations

import math
from itertools import product

import numpy as np
import pytest
from scipy.stats import binomtest, ttest_1samp

from harness.sweep.paired import compare, newcombe


def test_trials_are_compared_by_their_numbers() -> None:
    # given ticks of ten trials in two cells; the first three succeed in both
    first = np.array([100, 110, 130, 90, 80, 70, 60, 0, 0, 0], np.uint16)
    second = np.array([90, 105, 120, 0, 0, 0, 0, 50, 0, 0], np.uint16)
    # when
    result = compare(first, second)
    # then
    assert (result.pairs, result.both, result.only_first, result.only_second, result.neither) == (
        10, 3, 4, 1, 2,
    )  # fmt: skip
    assert result.difference == pytest.approx(0.3)
    assert result.p_value == pytest.approx(binomtest(4, 5).pvalue)
    times = ttest_1samp(np.array([10, 5, 10]) * 0.04, 0.0)
    low, high = times.confidence_interval(0.95)
    assert result.time_difference_s == pytest.approx(25 / 3 * 0.04)
    assert (result.time_ci_low_s, result.time_ci_high_s) == pytest.approx((low, high))


def test_trials_that_one_cell_lacks_or_a_fault_ended_do_not_count() -> None:
    first, second = np.array([100, 0, 100, 0], np.uint16), np.array([0, 100], np.uint16)
    assert (compare(first, second).pairs, compare(first, second, {1, 3}).pairs) == (2, 1)
    assert compare(first, second, {1}).only_first == 1
    nothing = compare(first, second, {0, 1})
    assert (nothing.pairs, nothing.difference, nothing.ci_low, nothing.p_value) == (0, None, None, 1.0)
    assert nothing.time_difference_s is None


def test_the_interval_of_a_difference_covers_it_in_some_95_of_100() -> None:
    # given all tables of 30 paired trials, and how likely each is
    n, chances = 30, (0.5, 0.25, 0.1, 0.15)
    truth, covered, total = chances[1] - chances[2], 0.0, 0.0
    for both, first, second in product(range(n + 1), repeat=3):
        neither = n - both - first - second
        if neither < 0:
            continue
        counts = (both, first, second, neither)
        logarithm = math.lgamma(n + 1) + sum(
            count * math.log(chance) - math.lgamma(count + 1)
            for count, chance in zip(counts, chances, strict=True)
        )
        # when
        low, high = newcombe(*counts)
        total += math.exp(logarithm)
        covered += math.exp(logarithm) * (low <= truth <= high)
    # then
    assert total == pytest.approx(1.0)
    assert 0.94 < covered < 0.97


def test_the_interval_of_a_difference_takes_the_pairs_into_account() -> None:
    # given the same rates, 60 and 50 %, once from trials that go together and once from unrelated ones
    narrow, wide = newcombe(50, 10, 0, 40), newcombe(30, 30, 20, 20)
    # then the first interval is far narrower, and both change sign with the order
    assert narrow[0] > 0.03
    assert wide[0] < 0 < wide[1]
    assert newcombe(50, 0, 10, 40) == pytest.approx((-narrow[1], -narrow[0]))
    assert newcombe(10, 0, 0, 0)[0] < 0.0 < newcombe(10, 0, 0, 0)[1]
