"""A recording: fixes of a GPS receiver and samples of an IMU, joined on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import numpy.typing as npt

from harness.recording.attitude import TICK_S, Array, anti_alias, euler_angles
from models.errors import CanineError

Index = npt.NDArray[np.int64]

WEEK_S = 604_800
MIN_OVERLAP_S = 20.0  # s with both sensors: one outage of 10 s and 10 s before it


class RecordingError(CanineError):
    """A file of a recording is missing or wrong."""


@dataclass(frozen=True)
class FixStream:
    """The valid fixes in a file, f of them, in its order.

    Attributes:
        file: name of the file.
        rows: (f, 8): GPS time of week [s], latitude, longitude [rad], height above the ellipsoid [m],
            velocity north and east [m/s], accuracy of the position [m] and of the speed [m/s], as in `Fixes`.
        ends: (f,) position in the file behind each.
        dropped: how many fixes or frames were dropped, by cause.
    """

    file: str
    rows: Array
    ends: Index
    dropped: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class SampleStream:
    """The inertial samples in a file, n of them, in its order and in the axes of the IMU.

    Attributes:
        file: name of the file.
        clock: (n,) s, the IMU's own, from an arbitrary zero.
        specific_force: (n, 3) m/s2.
        rate: (n, 3) rad/s.
        ends: (n,) position in the file behind each.
        dropped: how many were dropped, by cause.
    """

    file: str
    clock: Array
    specific_force: Array
    rate: Array
    ends: Index
    dropped: Mapping[str, int] = field(default_factory=dict)


@dataclass(frozen=True)
class Fixes:
    """The valid fixes of a recording, arrays (f,) in s, rad, m and m/s."""

    t: Array
    latitude: Array
    longitude: Array
    height: Array  # above the ellipsoid
    velocity_north: Array
    velocity_east: Array
    h_acc: Array
    s_acc: Array


@dataclass(frozen=True)
class Recording:
    """Both sensors' data on one clock [s], which is zero at the first fix with IMU samples: the origin."""

    name: str
    fixes: Fixes
    imu_t: Array  # (n,)
    specific_force: Array  # (n, 3) m/s2, forward, right, down
    rate: Array  # (n, 3) rad/s, forward, right, down
    dropped: Mapping[str, int]  # how many fixes, samples or frames were not used, by cause in plain words

    @property
    def ticks(self) -> int:
        """Number of ticks k * TICK_S, from k = 0 on, that both sensors cover."""
        return int(min(np.ceil(self.fixes.t[-1] / TICK_S - 1e-6), np.floor(self.imu_t[-1] / TICK_S))) + 1

    @cached_property
    def on_ticks(self) -> Array:
        """Specific force, rate, roll, pitch, unaligned heading, all delayed by one filter: (ticks, 9)."""
        angles = euler_angles(self.imu_t, self.specific_force, self.rate)
        return anti_alias(self.imu_t, np.hstack([self.specific_force, self.rate, angles]), self.ticks)


def join(name: str, fixes: FixStream, samples: SampleStream, offset: float, mounting: Array) -> Recording:
    """Put both sensors' data on one clock.

    Args:
        name: of the recording.
        offset: s, GPS time of week minus the clock of the IMU, whole weeks apart.
        mounting: (3, 3), turns vectors in the axes of the IMU into forward, right, down.

    Raises:
        RecordingError: a clock goes back, or both sensors hardly overlap.
    """
    fix_t = np.unwrap(fixes.rows[:, 0], period=WEEK_S)
    require_increasing(fixes.file, fix_t)
    require_increasing(samples.file, samples.clock)
    imu_t = fix_t[0] + wrap_week(samples.clock + offset - fix_t[0])
    overlap = min(fix_t[-1], imu_t[-1]) - max(fix_t[0], imu_t[0])
    if overlap < MIN_OVERLAP_S:
        raise RecordingError(
            f"{name}: {fixes.file} and {samples.file} overlap by {overlap:.1f} s, expected at least "
            f"{MIN_OVERLAP_S} s; record both together and longer"
        )
    zero = fix_t[fix_t >= imu_t[0]][0]
    return Recording(
        name=name,
        fixes=Fixes(fix_t - zero, *fixes.rows[:, 1:].T),
        imu_t=imu_t - zero,
        specific_force=samples.specific_force @ mounting.T,
        rate=samples.rate @ mounting.T,
        dropped=added(fixes.dropped, samples.dropped),
    )


def added(*counts: Mapping[str, int]) -> dict[str, int]:
    """The sums of counts by cause, without zeros."""
    total: dict[str, int] = {}
    for count in counts:
        for cause, number in count.items():
            total[cause] = total.get(cause, 0) + number
    return {cause: number for cause, number in total.items() if number}


def require_increasing(file: str, clock: Array) -> None:
    """Refuse a clock that stands or goes back.

    Raises:
        RecordingError: it does, naming the record.
    """
    for i in np.flatnonzero(~(np.diff(clock) > 0))[:1]:
        raise RecordingError(
            f"{file}: the clock goes from {clock[i]:.3f} to {clock[i + 1]:.3f} s at record {i + 2}, expected "
            "an increase; cut the recording there"
        )


def wrap_week(seconds: Array) -> Array:
    """A difference of times of week, wrapped to half a week around 0."""
    return (seconds + WEEK_S / 2) % WEEK_S - WEEK_S / 2
