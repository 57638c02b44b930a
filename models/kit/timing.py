"""The tick, and the one way to compare a time with a number of ticks.

A time of a whole number of ticks must count as many in float32, where both sides of the comparison are
rounded. So a comparison has a tolerance: a tenth of a tick, unless another is given. The age of
a fix (four_state) and the windows of outages (sensors) are compared without one.
"""

from __future__ import annotations

from models.kit import casadi as ca
from models.kit.declaration import SX

TICK = 0.04  # s, the 25 Hz of the IMU (2.3)
TOLERANCE = 0.1  # ticks


def lasted(ticks: SX, time: SX, sample_time: float, tolerance: float | None = None) -> SX:
    """Have the ticks lasted the time [s]? `tolerance` [s] is a tenth of a tick by default."""
    return ticks * sample_time > time - (TOLERANCE * sample_time if tolerance is None else tolerance)


def ticks_within(time: SX, sample_time: float) -> SX:
    """How many whole ticks the time [s] holds: rounded down."""
    return ca.floor(time / sample_time + TOLERANCE)


def ticks_until(time: SX, sample_time: float) -> SX:
    """After how many ticks the time [s] is over: rounded up."""
    return ca.floor(time / sample_time - TOLERANCE) + 1
