"""Holes of a sensor, told from its ordinary rate."""

from __future__ import annotations

import numpy as np
import pytest

from harness.recording.holes import holes, holes_of_fixes, holes_of_imu


def test_a_gap_of_the_imu_is_a_hole_if_it_is_longer_than_a_tenth_of_a_second_and_three_samples() -> None:
    fast, slow = np.arange(0, 10, 0.01), np.arange(0, 10, 0.1)
    assert holes_of_imu(np.delete(fast, range(100, 108))) == []  # from 0.99 to 1.08 s
    [(start, end)] = holes_of_imu(np.delete(fast, range(100, 110)))
    assert start == pytest.approx(0.99)
    assert end == pytest.approx(1.10)
    assert holes_of_imu(np.delete(slow, [50, 51])) == []
    assert len(holes_of_imu(np.delete(slow, [50, 51, 52]))) == 1


def test_two_fixes_missing_in_a_row_are_a_hole_and_one_is_not() -> None:
    fixes = np.arange(0, 10, 0.25)
    assert holes_of_fixes(np.delete(fixes, [20])) == []
    assert holes_of_fixes(np.delete(fixes, [20, 21])) == [(4.75, 5.5)]


def test_fewer_than_two_times_have_no_holes() -> None:
    for times in (np.zeros(0), np.zeros(1)):
        assert holes_of_fixes(times) == holes_of_imu(times) == []


def test_times_without_a_gap_have_no_holes() -> None:
    assert holes(np.array([0.0, 1.0, 2.0]), 1.0) == []
    assert holes(np.zeros(0), 1.0) == []
