"""Holes of a sensor, told from its ordinary rate."""

from __future__ import annotations

import numpy as np
import pytest

from harness.recording.holes import holes, holes_of_imu


def test_a_gap_of_the_imu_is_a_hole_if_it_is_longer_than_a_tenth_of_a_second_and_three_samples() -> None:
    fast, slow = np.arange(0, 10, 0.01), np.arange(0, 10, 0.1)
    assert holes_of_imu(np.delete(fast, range(100, 108))) == []  # from 0.99 to 1.08 s
    [(start, end)] = holes_of_imu(np.delete(fast, range(100, 110)))
    assert start == pytest.approx(0.99)
    assert end == pytest.approx(1.10)
    assert holes_of_imu(np.delete(slow, [50, 51])) == []
    assert len(holes_of_imu(np.delete(slow, [50, 51, 52]))) == 1


def test_times_without_a_gap_have_no_holes() -> None:
    assert holes(np.array([0.0, 1.0, 2.0]), 1.0) == []
    assert holes(np.zeros(0), 1.0) == []
