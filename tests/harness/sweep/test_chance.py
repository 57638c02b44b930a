"""Tails and quantiles are those of scipy.stats."""

from __future__ import annotations

import pytest
from scipy import stats

from harness.sweep.chance import heads, student

TOSSES = [1, 2, 5, 100, 1000, 1001, 5000, 100_000, 1_000_001]
LEVELS = [0.9, 0.95, 0.975, 1 - 1e-3, 1 - 0.05 / 30, 1 - 0.05 / 5700, 1 - 1e-6, 1 - 1e-8]
FREEDOM = [1, 2, 3, 4, 9, 29, 30, 99, 299, 300, 301, 1999, 2000, 2001, 10_000, 10**7]


def test_the_chance_of_eight_heads_in_ten_tosses_is_56_in_1024() -> None:
    assert heads(8, 10) == (45 + 10 + 1) / 1024


@pytest.mark.parametrize("tosses", TOSSES)
def test_chances_of_heads_are_those_of_scipy(tosses: int) -> None:
    spread = tosses**0.5 / 2
    near = {round(tosses / 2 + sigmas * spread) for sigmas in (-6, -3, -1, 0, 1, 2, 4, 6)}
    for least in sorted(near | {0, 1, tosses // 2, tosses // 2 + 1, tosses * 6 // 10, tosses, tosses + 1}):
        expected = float(stats.binom.sf(least - 1, tosses, 0.5))
        assert heads(least, tosses) == pytest.approx(expected, rel=1e-12, abs=1e-300), least


def test_students_quantile_with_one_degree_of_freedom_is_a_tangent() -> None:
    assert student(0.975, 1) == pytest.approx(12.706204736174705, rel=1e-14)


@pytest.mark.parametrize("freedom", FREEDOM)
def test_students_quantiles_are_those_of_scipy(freedom: int) -> None:
    for level in LEVELS:
        assert student(level, freedom) == pytest.approx(float(stats.t.ppf(level, freedom)), rel=2e-12), level
