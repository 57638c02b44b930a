"""Do the sensors of a recording agree: in time by correlation, and with gravity?"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
import numpy.typing as npt
from scipy.integrate import cumulative_trapezoid

from harness.recording.attitude import Array
from harness.recording.order import Mask
from harness.recording.recording import Fixes, Recording
from harness.recording.signals import MOVING_M_S

FURTHEST_S = 3.0  # s, the largest offset that is looked for
STEP_S = 0.02  # s between the offsets
LEAST = 30  # pairs of fixes, one behind the other, for a correlation that means something
STRONG = 0.6  # a correlation from which on an offset is told
APART_S = 1.0  # s from the best offset, from which on another one that is as good makes it ambiguous
MARGIN = 0.1  # in correlation, by which the best one beats those
LARGEST_TILT_DEG = 20.0  # deg between gravity and the mounting: more is a wrong mounting, not a posture
PAIR_GAP = 1.5  # times the usual time between the fixes of a pair
Value = TypeVar("Value", np.float64, np.complex128)


@dataclass(frozen=True)
class Offset:
    """What the clock of the IMU lacks to that of the fixes, by one correlation.

    Attributes:
        seconds: to be added to the time of the IMU; None where it cannot be told.
        correlation: the largest one; None without pairs.
        pairs: of fixes that were compared.
        reason: why it cannot be told; "" if it can.
        reversed: one signal follows the other with the opposite sign, and with its own nowhere nearly so.
    """

    seconds: float | None
    correlation: float | None
    pairs: int
    reason: str
    reversed: bool = False


@dataclass(frozen=True)
class Gravity:
    """The mean specific force over the recording, against straight up.

    Attributes:
        force: m/s2, its length.
        off_deg: deg between it and straight up in the body's axes.
        roll_deg, pitch_deg: deg, of the IMU in a level body, by it; the yaw is not told by gravity.
    """

    force: float
    off_deg: float
    roll_deg: float
    pitch_deg: float

    @property
    def warning(self) -> str:
        """What is wrong with the mounting; "" if nothing is."""
        if self.off_deg <= LARGEST_TILT_DEG:
            return ""
        return (
            f"gravity is {self.off_deg:.0f} deg off the mounting that is used; by gravity, the IMU sits at "
            f"roll {self.roll_deg:z.0f}, pitch {self.pitch_deg:z.0f} deg, with a yaw that gravity does not "
            "tell; state imu.mounting in recording.toml"
        )


def gravity(specific_force: Array, mounting: Array) -> Gravity:
    """Compare a specific force (n, 3) m/s2 in the axes of the IMU with gravity, under a mounting (3, 3).

    The accelerations of an animal average out, so the mean force is what holds it against gravity.
    """
    x, y, z = (float(axis) for axis in specific_force.mean(axis=0))
    along, across, down = (float(axis) for axis in mounting @ (x, y, z))
    return Gravity(
        force=math.hypot(x, y, z),
        off_deg=math.degrees(math.atan2(math.hypot(along, across), -down)),
        roll_deg=math.degrees(math.atan2(-y, -z)),
        pitch_deg=math.degrees(math.atan2(x, math.hypot(y, z))),
    )


def swept(times: Array, values: npt.NDArray[Value]) -> npt.NDArray[Value]:
    """The integral of `values` (n,) from the first of the times (n,) s to each."""
    return np.asarray(cumulative_trapezoid(values, times, initial=0))


def turning_offset(recording: Recording, apart_s: float = 0.0) -> Offset:
    """By the rate of the course between moving fixes, some time apart [s], against the yaw rate."""
    _, turned, moving = _turns(recording.fixes)
    # the yaw rate: about the vertical, which the mean force gives
    up = recording.specific_force.mean(axis=0)
    return _best(recording, turned, moving, -recording.rate @ up / np.linalg.norm(up), apart_s)


def pushing_offset(recording: Recording) -> Offset:
    """By the rate of the speed between moving fixes against the specific force forward."""
    speed = np.hypot(recording.fixes.velocity_north, recording.fixes.velocity_east)
    moving = (speed[1:] > MOVING_M_S) | (speed[:-1] > MOVING_M_S)
    return _best(recording, np.diff(speed), moving, recording.specific_force[:, 0])


def swerving_offset(recording: Recording) -> Offset:
    """By speed times the rate of the course against the specific force sideways.

    A body that looks where it will go turns before its course does; the force on it does not.
    """
    speed, turned, moving = _turns(recording.fixes)
    return _best(recording, turned * speed, moving, recording.specific_force[:, 1])


def _turns(fixes: Fixes) -> tuple[Array, Array, Mask]:
    """Mean speed [m/s] and change of course [rad] from each fix to the next, (f - 1,); do both move?"""
    speed = np.hypot(fixes.velocity_north, fixes.velocity_east)
    turned = np.diff(np.unwrap(np.arctan2(fixes.velocity_east, fixes.velocity_north)))
    moving = (speed[1:] > MOVING_M_S) & (speed[:-1] > MOVING_M_S)
    return (speed[1:] + speed[:-1]) / 2, turned, moving


def _best(recording: Recording, change: Array, moving: Mask, signal: Array, apart_s: float = 0.0) -> Offset:
    """The offset at which `signal` (n,), averaged between two fixes, follows their change best.

    Args:
        change: from each fix to the next (f - 1,), of which those `moving` are used.
        apart_s: s between the fixes of a pair; less than their interval stands for neighbours.
    """
    t, imu_t = recording.fixes.t, recording.imu_t
    interval = float(np.median(np.diff(t))) if len(t) > 1 else 1.0
    apart = max(1, round(apart_s / interval))
    summed_change, resting = np.r_[0, np.cumsum(change)], np.r_[0, np.cumsum(~moving)]
    first, last = np.arange(max(0, len(t) - apart)), np.arange(apart, max(apart, len(t)))
    used = (resting[first] == resting[last]) & (t[last] - t[first] <= PAIR_GAP * apart * interval)
    used &= (t[first] >= imu_t[0] + FURTHEST_S) & (t[last] <= imu_t[-1] - FURTHEST_S)
    first, last = first[used], last[used]
    pairs = len(first)
    if pairs < LEAST * apart:
        return Offset(None, None, pairs, f"only {pairs // apart} pairs of moving fixes, {LEAST} are needed")
    lasts = t[last] - t[first]
    rate = (summed_change[last] - summed_change[first]) / lasts
    summed = swept(imu_t, signal)
    offsets = np.arange(-round(FURTHEST_S / STEP_S), round(FURTHEST_S / STEP_S) + 1) * STEP_S
    correlations = np.zeros(len(offsets))
    for i, offset in enumerate(offsets):  # a sample at t + offset on the clock of the fixes was taken at t
        start, end = (np.interp(t[fix] - offset, imu_t, summed) for fix in (first, last))
        mean = (end - start) / lasts
        if rate.std() > 0 and mean.std() > 0:
            correlations[i] = np.corrcoef(rate, mean)[0, 1]
    worst, most = float(correlations.min()), float(correlations.max())
    if worst < -STRONG and -worst > most:
        reason = f"one is the reverse of the other, correlation {worst:.2f}"
        return Offset(None, worst, pairs, reason, reversed=-worst > most + MARGIN)
    best = int(correlations.argmax())
    strength, seconds = float(correlations[best]), float(offsets[best])
    elsewhere = float(correlations[np.abs(offsets - seconds) > APART_S].max())
    reason = ""
    if strength < STRONG:
        reason = f"the correlation is at most {strength:.2f}, {STRONG} is needed"
    elif best in (0, len(offsets) - 1):
        reason = f"it is beyond {FURTHEST_S:g} s"
    elif strength - elsewhere < MARGIN:
        reason = f"another offset is nearly as good, {elsewhere:.2f} against {strength:.2f}"
    return Offset(None if reason else seconds, strength, pairs, reason)
