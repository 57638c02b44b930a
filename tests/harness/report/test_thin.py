"""Rows that are drawn: all of a short log; of a long one every extreme of every stretch."""

from itertools import pairwise

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from harness.report.thin import BUCKETS, rows_to_show


def test_a_short_log_is_drawn_as_it_is() -> None:
    assert rows_to_show([np.zeros(5)], np.zeros(5, dtype=bool), most=5).tolist() == [0, 1, 2, 3, 4]


@settings(deadline=None, max_examples=20)
@given(st.integers(0, 2**32 - 1), st.integers(BUCKETS, 5 * BUCKETS))
def test_every_stretch_keeps_its_extremes(seed: int, rows: int) -> None:
    # given two signals of noise, one of them with gaps
    random = np.random.default_rng(seed)
    one, other = random.normal(size=(2, rows))
    other[random.random(rows) < 0.3] = np.nan
    # when more rows are there than may be shown
    kept = rows_to_show([one], np.zeros(rows, dtype=bool), [other], most=0)
    # then an independent search finds each stretch's extremes among those that stay
    shown = set(kept.tolist())
    edges = np.linspace(0, rows, BUCKETS + 1).astype(int)
    for first, last in pairwise(edges):
        for column in (one, other):
            finite = [row for row in range(first, last) if np.isfinite(column[row])]
            if finite:
                assert max(finite, key=lambda row: column[row]) in shown
                assert min(finite, key=lambda row: column[row]) in shown
    assert {0, rows - 1} <= shown


def test_marked_rows_stay() -> None:
    marked = np.zeros(50_000, dtype=bool)
    marked[[12_345, 12_346]] = True
    kept = rows_to_show([np.arange(50_000.0)], marked)
    assert {12_345, 12_346} <= set(kept.tolist())
    assert len(kept) <= 2 * BUCKETS + 4


def test_gaps_of_a_line_stay_and_those_of_points_do_not() -> None:
    # given fixes on every sixth row, and a line that is unknown for a while
    rows = np.arange(60_000)
    fixes = np.where(rows % 6 == 0, 1.0, np.nan)
    line = np.where((rows > 777) & (rows < 999), np.nan, 1.0)
    kept = rows_to_show([line], rows < 0, [fixes])
    assert {778, 999} <= set(kept.tolist())
    assert len(kept) < 3 * BUCKETS
