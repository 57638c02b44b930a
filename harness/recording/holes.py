"""Holes: times without samples that are longer than the rate of the samples explains."""

from __future__ import annotations

import numpy as np

from harness.log.log import Array

Hole = tuple[float, float]  # s, the last sample before it and the first after it

HOLE_OF_IMU_S = 0.1  # s; a shorter gap of the IMU is bridged by holding its last sample
HOLE_OF_SAMPLES = 3.0  # intervals between inertial samples


def holes(times: Array, longest: float) -> list[Hole]:
    """The gaps between ascending times (n,) that are longer than `longest` [s]."""
    before = np.flatnonzero(np.diff(times) > longest)
    return [(float(times[i]), float(times[i + 1])) for i in before]


def holes_of_imu(times: Array) -> list[Hole]:
    """The holes between inertial samples at the ascending times (n,) s."""
    return holes(times, max(HOLE_OF_IMU_S, HOLE_OF_SAMPLES * float(np.median(np.diff(times)))))
