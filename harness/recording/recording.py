"""A recording: fixes of a GPS receiver and samples of an IMU, joined on one clock."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np
import numpy.typing as npt

from harness.recording.attitude import TICK_S, Array, anti_alias
from harness.recording.mounting import euler_angles
from harness.recording.order import Mask, late_run, longest_rise, repeats
from models.errors import CanineError

Index = npt.NDArray[np.int64]

WEEK_S = 604_800
MIN_OVERLAP_S = 20.0  # s with both sensors: one outage of 10 s and 10 s before it
MAX_OVERLAP_S = 4 * 3600.0  # s with both sensors: what a laptop's memory holds at 1 kHz
LEAD_S = 60.0  # s of samples before the first fix that are used
MAX_SPEED = 100.0  # m/s; no animal, nor a person or car that carries the rig for a test, is faster
MAX_ACC = 1e6  # m and m/s of accuracy: more says nothing
MAX_JUMPS = 1000  # in the positions of a recording
EARTH_RADIUS = 6_371_000.0  # m
MAX_FORCE, MAX_RATE = 200.0, 100.0  # m/s2 and rad/s on an axis: more than any such IMU measures
SILENT = "epochs without a message, by the rate of the others"
MAX_LATE_S = 1.0  # s by which several records in a row may be late; above it the clock was set


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
        kinds: how many fixes there are of each kind.
    """

    file: str
    rows: Array
    ends: Index
    dropped: Mapping[str, int] = field(default_factory=dict)
    kinds: Mapping[str, int] = field(default_factory=dict)

    def only(self, kept: Mask, cause: str) -> FixStream:
        """The fixes in a mask (f,); the others are counted as dropped for a cause."""
        dropped = added(self.dropped, {cause: int((~kept).sum())})
        return replace(self, rows=self.rows[kept], ends=self.ends[kept], dropped=dropped)

    def in_order(self) -> FixStream:
        """Without fixes that are out of range, repeated, late or too far off; time goes on at a week's end.

        Raises:
            RecordingError: no fix is left, the clock was set amid the recording, or positions jump too often.
        """
        greatest = (WEEK_S, np.pi / 2, 2 * np.pi, np.finfo(np.float64).max, *[MAX_SPEED] * 2, *[MAX_ACC] * 2)
        possible = _within(self.rows, greatest) & (self.rows[:, 6:] > 0).all(axis=1)
        stream = self.only(possible, "fixes out of range")
        stream = stream.only(~repeats(stream.rows), "fixes repeated")
        if not len(stream.rows):
            raise RecordingError(f"{self.file}: got no fixes, expected some; record under open sky")
        rows = stream.rows.copy()
        rows[:, 0] = np.unwrap(rows[:, 0], period=WEEK_S)
        rising = _require_one_clock(self.file, rows[:, 0], longest_rise(rows[:, 0], strict=True))
        ordered = replace(stream, rows=rows).only(rising, "fixes out of order")
        reached = _reachable(self.file, ordered.rows)
        return ordered.only(reached, "fixes where nothing moves so fast")._with_silence_counted()

    def _with_silence_counted(self) -> FixStream:
        """The same, with the epochs counted of which no message is left, not even a damaged one."""
        intervals = np.diff(self.rows[:, 0])
        if not len(intervals):
            return self
        missing = int((np.round(intervals / np.median(intervals)) - 1).clip(0).sum())
        silent = max(0, missing - sum(self.dropped.values()))
        return replace(self, dropped=added(self.dropped, {SILENT: silent}))


@dataclass(frozen=True)
class SampleStream:
    """The inertial samples in a file, n of them, in its order and in the axes of the IMU.

    Attributes:
        file: name of the file.
        clock: (n,) s, the IMU's own, from an arbitrary zero; in ticks of an unknown length if `in_ticks`.
        specific_force: (n, 3) m/s2.
        rate: (n, 3) rad/s.
        ends: (n,) position in the file behind each.
        dropped: how many were dropped, by cause.
        attitude: (n, 3, 3) turns vectors in the axes of the IMU into north, east, down, by its own AHRS;
            None without one.
    """

    file: str
    clock: Array
    specific_force: Array
    rate: Array
    ends: Index
    dropped: Mapping[str, int] = field(default_factory=dict)
    in_ticks: bool = False
    attitude: Array | None = None

    def only(self, kept: Mask, cause: str) -> SampleStream:
        """The samples in a mask (n,); the others are counted as dropped for a cause."""
        return replace(
            self,
            clock=self.clock[kept],
            specific_force=self.specific_force[kept],
            rate=self.rate[kept],
            attitude=None if self.attitude is None else self.attitude[kept],
            ends=self.ends[kept],
            dropped=added(self.dropped, {cause: int((~kept).sum())}),
        )

    def in_order(self) -> SampleStream:
        """Without samples that are out of range, repeated or late. Two may have the same time.

        Raises:
            RecordingError: no sample is left, or the clock was set amid the recording.
        """
        values = np.column_stack([self.clock, self.specific_force, self.rate])
        greatest = (np.finfo(np.float64).max, *[MAX_FORCE] * 3, *[MAX_RATE] * 3)
        possible = _within(values, greatest)
        if self.attitude is not None:
            possible &= np.isfinite(self.attitude).all(axis=(1, 2))
        stream, values = self.only(possible, "IMU samples out of range"), values[possible]
        stream = stream.only(~repeats(values), "IMU samples repeated")
        if not len(stream.clock):
            raise RecordingError(
                f"{self.file}: got no samples, expected some of at most {MAX_FORCE:g} m/s2 and "
                f"{MAX_RATE:g} rad/s on an axis; are the units right?"
            )
        rising = longest_rise(stream.clock, strict=False)
        return stream.only(_require_one_clock(self.file, stream.clock, rising), "IMU samples out of order")


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
    notes: tuple[str, ...] = ()  # what a result rests on
    doubts: tuple[str, ...] = ()  # what looks wrong
    attitude: Array | None = None  # (n, 3) roll, pitch and heading [rad] of the body, where they are recorded

    @property
    def ticks(self) -> int:
        """Number of ticks k * TICK_S, from k = 0 on, that both sensors cover."""
        return int(min(np.ceil(self.fixes.t[-1] / TICK_S - 1e-6), np.floor(self.imu_t[-1] / TICK_S))) + 1

    @property
    def ticks_before(self) -> int:
        """Number of ticks before the origin with IMU samples, of which the attitude makes use."""
        return int(min(max(-self.imu_t[0], 0.0), LEAD_S) / TICK_S)

    @cached_property
    def on_ticks(self) -> Array:
        """Specific force, and mean rate since the last tick, delayed by one filter: (before + ticks, 6)."""
        return np.hstack([self._filtered(self.specific_force), self._filtered(self.rate, mean=True)])

    @cached_property
    def attitude_on_ticks(self) -> Array | None:
        """The recorded roll, pitch and heading, unwrapped and delayed by one filter: (before + ticks, 3)."""
        return None if self.attitude is None else self._filtered(np.unwrap(self.attitude, axis=0))

    def _filtered(self, samples: Array, *, mean: bool = False) -> Array:
        """Samples (n, m) of the IMU at the ticks from `ticks_before` on."""
        before = self.ticks_before
        return anti_alias(self.imu_t + before * TICK_S, samples, before + self.ticks, mean=mean)


def join(name: str, fixes: FixStream, samples: SampleStream, offset: float, mounting: Array) -> Recording:
    """Put both sensors' data in order and on one clock.

    Args:
        name: of the recording.
        offset: s, GPS time of week minus the clock of the IMU, whole weeks apart.
        mounting: (3, 3), turns vectors in the axes of the IMU into forward, right, down.

    Raises:
        RecordingError: a clock was set amid the recording, or both sensors overlap too little or too long.
    """
    fixes, samples = fixes.in_order(), samples.in_order()
    fix_t = fixes.rows[:, 0]
    apart = samples.clock + offset - fix_t[0]
    imu_t = fix_t[0] + apart - WEEK_S * np.round(np.median(apart) / WEEK_S)
    overlap = min(fix_t[-1], imu_t[-1]) - max(fix_t[0], imu_t[0])
    if not MIN_OVERLAP_S <= overlap <= MAX_OVERLAP_S:
        expected, advice = (
            (f"at least {MIN_OVERLAP_S}", "record both together and longer")
            if overlap < MIN_OVERLAP_S
            else (f"at most {MAX_OVERLAP_S:.0f}", "cut the recording into parts")
        )
        raise RecordingError(
            f"{name}: {fixes.file} and {samples.file} overlap by {overlap:.1f} s, expected {expected} s; "
            f"{advice}"
        )
    zero = fix_t[fix_t >= imu_t[0]][0]
    return Recording(
        name=name,
        fixes=Fixes(fix_t - zero, *fixes.rows[:, 1:].T),
        imu_t=imu_t - zero,
        specific_force=samples.specific_force @ mounting.T,
        rate=samples.rate @ mounting.T,
        dropped=added(fixes.dropped, samples.dropped),
        attitude=None if samples.attitude is None else euler_angles(samples.attitude @ mounting.T),
    )


def added(*counts: Mapping[str, int]) -> dict[str, int]:
    """The sums of counts by cause, without zeros."""
    total: dict[str, int] = {}
    for count in counts:
        for cause, number in count.items():
            total[cause] = total.get(cause, 0) + number
    return {cause: number for cause, number in total.items() if number}


def _within(rows: Array, greatest: tuple[float, ...]) -> Mask:
    """Which rows (n, m) have no value greater than `greatest` (m,), or NaN."""
    return np.asarray((np.abs(rows) <= greatest).all(axis=1))


def _reachable(file: str, rows: Array) -> Mask:
    """The most fixes (f, 8) of which each can be reached from the one before at MAX_SPEED, as a mask.

    Raises:
        RecordingError: there are more than MAX_JUMPS between neighbours that cannot.
    """

    def reached(first: Array, then: Array) -> Mask:
        north = then[..., 1] - first[..., 1]
        east = (then[..., 2] - first[..., 2] + np.pi) % (2 * np.pi) - np.pi
        metres = EARTH_RADIUS * np.hypot(north, east * np.cos(first[..., 1]))
        slack = 2 * (first[..., 6] + then[..., 6])
        return np.asarray(metres <= MAX_SPEED * (then[..., 0] - first[..., 0]) + slack)

    starts = np.r_[0, np.flatnonzero(~reached(rows[:-1], rows[1:])) + 1]  # of the parts without a jump
    if len(starts) > MAX_JUMPS:
        raise RecordingError(
            f"{file}: {len(starts) - 1} times the position jumps as nothing moves, above {MAX_SPEED:g} m/s; "
            "are the columns and units right?"
        )
    ends = np.r_[starts[1:], len(rows)]
    most = ends - starts  # fixes in a chain that ends with each part
    before = np.full(len(starts), -1)
    for i in range(1, len(starts)):
        chained = np.where(reached(rows[ends[:i] - 1], rows[starts[i]]), most[:i], 0)
        if chained.max() > 0:
            before[i] = int(chained.argmax())
            most[i] += chained.max()
    kept = np.zeros(len(rows), dtype=np.bool_)
    i = int(most.argmax())
    while i >= 0:
        kept[starts[i] : ends[i]] = True
        i = int(before[i])
    return kept


def _require_one_clock(file: str, clock: Array, rising: Mask) -> Mask:
    """The mask itself, if what it leaves out was late and the clock was not set.

    Raises:
        RecordingError: several records in a row are late by more than MAX_LATE_S, between others.
    """
    run = late_run(clock, rising)
    if run and run[1] > run[0]:
        first, last = run
        back = float(max(clock[first - 1] - clock[first], clock[last] - clock[last + 1]))
        if back > MAX_LATE_S:
            raise RecordingError(
                f"{file}: the clock goes back by {back:.3f} s near record {first + 1}, and on from there; "
                "expected one clock; cut the recording there"
            )
    return rising


def read_file(path: Path) -> bytes:
    """The content of a file of a recording.

    Raises:
        RecordingError: it cannot be read, or is empty.
    """
    try:
        content = path.read_bytes()
    except OSError as reason:
        raise RecordingError(f"{path}: cannot be read ({reason.strerror or reason})") from None
    if not content:
        raise RecordingError(f"{path}: got an empty file, expected a recording; copy it again")
    return content


def as_number(text: bytes | str) -> float:
    """A number as instruments write it; `float` reads 1_000 as well.

    Raises:
        ValueError: it is none.
    """
    if ("_" if isinstance(text, str) else b"_") in text:  # type: ignore[operator]
        raise ValueError
    return float(text)


def wrap_week(seconds: Array) -> Array:
    """A difference of times of week, wrapped to half a week around 0."""
    return (seconds + WEEK_S / 2) % WEEK_S - WEEK_S / 2
