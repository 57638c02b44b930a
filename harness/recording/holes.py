"""Holes: times without samples or fixes that are longer than their rate explains."""

from __future__ import annotations

import numpy as np

from harness.log.channel import Array

Hole = tuple[float, float]  # s, the last sample before it and the first after it

HOLE_OF_IMU_S = 0.1  # s; a shorter gap of the IMU is bridged by holding its last sample
HOLE_OF_SAMPLES = 3.0  # intervals between inertial samples
HOLE_OF_FIXES = 2.5  # intervals: two or more fixes in a row are missing


def holes(times: Array, longest: float) -> list[Hole]:
    """The gaps between ascending times (n,) that are longer than `longest` [s]."""
    before = np.flatnonzero(np.diff(times) > longest)
    return [(float(times[i]), float(times[i + 1])) for i in before]


def interval_of(times: Array) -> float:
    """The usual time [s] between the ascending times (n,) s; 0 of fewer than two."""
    return float(np.median(np.diff(times))) if len(times) > 1 else 0.0


def holes_of_fixes(times: Array) -> list[Hole]:
    """The holes between fixes at the ascending times (f,) s."""
    return holes(times, HOLE_OF_FIXES * interval_of(times))


def holes_of_imu(times: Array) -> list[Hole]:
    """The holes between inertial samples at the ascending times (n,) s."""
    return holes(times, max(HOLE_OF_IMU_S, HOLE_OF_SAMPLES * interval_of(times)))
