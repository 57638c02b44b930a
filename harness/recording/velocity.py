"""Velocities of fixes whose receiver sent none: from differences of positions, or from ECEF velocities."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.log.geodesy import TangentPlane
from harness.recording.attitude import Array
from harness.recording.recording import wrap_week

MAX_STEP_S = 2.0  # s between the two fixes of which a velocity is the difference


def with_differences(rows: Array) -> tuple[Array, int]:
    """Rows of a `FixStream` with velocities from the fix before each; how many have none and are left out.

    The accuracy is that of two positions whose errors are independent: too large rather than too small, since
    a receiver's errors move slowly. It is causal: nothing of a fix is known before it.
    """
    rows = rows.copy()
    usable = np.zeros(len(rows), dtype=np.bool_)
    if len(rows) > 1:
        t, latitude, longitude, height, _, _, h_acc, _ = rows.T
        elapsed = wrap_week(np.diff(t))
        north, east = TangentPlane(float(latitude[0]), float(longitude[0]), float(height[0])).to_plane(
            latitude, longitude
        )
        steps = np.column_stack([np.diff(north), np.diff(east), np.hypot(h_acc[1:], h_acc[:-1])])
        usable[1:] = (elapsed > 0) & (elapsed <= MAX_STEP_S)
        rows[usable, 4], rows[usable, 5], rows[usable, 7] = (steps[usable[1:]] / elapsed[usable[1:], None]).T
    return rows[usable], int((~usable).sum())


def from_ecef(velocity: Sequence[float], latitude: float, longitude: float) -> tuple[float, float]:
    """North and east [m/s] of a velocity in earth-centred, earth-fixed axes, at a place in rad."""
    x, y, z = velocity
    outward = x * np.cos(longitude) + y * np.sin(longitude)
    north = z * np.cos(latitude) - outward * np.sin(latitude)
    return float(north), float(y * np.cos(longitude) - x * np.sin(longitude))
