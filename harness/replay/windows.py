"""The outages of a recording that can be judged; the others are left out and counted by cause.

An outage is judged at its last withheld fix. That measures the outage only if this fix is near its end, if
the estimator had fixes up to its start, and if it had inertial samples all along. A *hole* is a time without
fixes or samples that is longer than their rate explains.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from harness.log.channel import Array
from harness.recording.attitude import TICK_S
from harness.recording.holes import Hole, holes_of_fixes, interval_of

Window = tuple[float, float]  # s, start and end of an outage

SETTLE = 10.0  # s of motion for the estimator to settle: before the first outage, and after a hole of the IMU
NEAR_END = 1.5  # intervals between fixes from the last fix in an outage to its end, at most

NO_FIX_AT_THE_END = "no fix near the end"
NO_FIXES_BEFORE = "fixes missing before the start"
NO_SAMPLES = "IMU samples missing"
NOT_VALID = "an estimator not valid at the start"


@dataclass(frozen=True)
class Outages:
    """The simulated outages of a replay: those to judge, and how many were left out by cause.

    Attributes:
        length: of each [s].
        windows: to be judged, in the order of time.
        left_out: cause -> number; empty where none was left out.
        reach: when the recording moves first and when it has its last fix, in words.
    """

    length: float
    windows: Sequence[Window]
    left_out: Mapping[str, int]
    reach: str


def choose(
    fixes: Array,
    moving: Array,
    imu_holes: Sequence[Hole],
    *,
    length: float,
    every: float,
    settle: float = SETTLE,
) -> Outages:
    """Outages of `length` [s], one every `every` [s], from `settle` [s] after the first moving fix on.

    Args:
        fixes: times [s] of the fixes to judge by (f,), ascending.
        moving: those at which the receiver moves (m,).
        imu_holes: start and end of the times without inertial samples.
    """
    if len(moving) == 0:
        return Outages(length, (), {}, "it never moves" if len(fixes) else "it has no fix")
    reach = f"it moves from {moving[0]:.1f} s on and has its last fix at {fixes[-1]:.1f} s"
    starts = np.arange(np.ceil(moving[0] + settle), fixes[-1] - length + 1e-9, every)
    interval = interval_of(fixes)
    windows: list[Window] = []
    left_out: Counter[str] = Counter()

    def settled(hole: Hole) -> float:
        """When the estimator has settled after a hole of the IMU: its heading is found by moving anew."""
        after = moving[moving >= hole[1]]
        return float(after[0]) + settle if len(after) else np.inf

    blind = [(start, settled((start, end))) for start, end in imu_holes]
    # after a hole of fixes the estimator settles for as long as it was on its own, as after its start at most
    alone = [(a, b + min(b - a, settle)) for a, b in holes_of_fixes(fixes)]
    for start in map(float, starts):
        end = start + length
        # a fix falls on the tick after it: one on the first tick may have come before the outage
        inside = fixes[(fixes > start + TICK_S / 2) & (fixes <= end)]
        if not len(inside) or end - inside[-1] > NEAR_END * interval:
            left_out[NO_FIX_AT_THE_END] += 1
        elif any(a < start - NEAR_END * interval and start < b for a, b in alone):
            left_out[NO_FIXES_BEFORE] += 1
        elif any(a < end and start < b for a, b in blind):
            left_out[NO_SAMPLES] += 1
        else:
            windows.append((start, end))
    return Outages(length, tuple(windows), dict(left_out), reach)
