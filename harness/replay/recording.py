"""Reads a recording of a GPS receiver and an IMU, and turns it into the estimator's sensor signals at 25 Hz.

A folder holds one `*.ubx` (u-blox binary stream), one `imu*.csv` (ax, ay, az [g], gx, gy, gz [deg/s],
tick [ms since power-up]), and beside each file its RTKLIB time tag, `*.tag`.

Clocks: a fix carries GPS time of week, an IMU line only the IMU's own tick. The tag of the IMU's file gives
the time when the logging computer, whose clock keeps GPS time, received each line. Transport only delays, so
the smallest (arrival - tick) of the recording is the offset between the clocks. The receiver's tag shows that
the computer's clock is right.
"""

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
from pyubx2 import UBX_PROTOCOL, UBXReader, calc_checksum

from harness.log.geodesy import TangentPlane
from harness.replay.attitude import TICK_S, Array, align_heading, anti_alias, euler_angles
from models.errors import CanineError

Mask = npt.NDArray[np.bool_]
Index = npt.NDArray[np.int64]

STANDARD_GRAVITY = 9.80665  # m/s2, the accelerometer's unit of 1 g
WEEK_S = 604_800
GPS_EPOCH_S = 315_964_800  # 1980-01-06 from 1970-01-01: the tags count GPS time from the latter
NAV_PVT, NAV_POSLLH, NAV_VELNED = b"\x01\x07", b"\x01\x02", b"\x01\x12"

# Forward, right and down in the axes of the IMU: roll, pitch, yaw = 180, 0, -90 deg.
MOUNTING = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

MOVING_M_S = 0.5  # m/s, speed above which the course over ground is used
ALIGNING_S = 10.0  # s, time constant with which the heading's offset forgets older courses
MIN_OVERLAP_S = 20.0  # s with both sensors: one outage of 10 s and 10 s before it
MAX_RECEIVER_LATENCY_S = 0.5  # s from the epoch of a fix to its arrival
MAX_CLOCK_DRIFT_S = 0.05  # s, of the IMU's clock against the computer's over the recording
MAX_H_ACC_M = 100.0  # m; NAV-POSLLH has no fix flag, and without a fix its accuracy is far worse


class RecordingError(CanineError):
    """A file of a recording is missing or wrong."""


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

    fixes: Fixes
    imu_t: Array  # (n,)
    specific_force: Array  # (n, 3) m/s2, forward, right, down
    rate: Array  # (n, 3) rad/s, forward, right, down
    checksum_errors: int  # number of UBX frames dropped

    @property
    def ticks(self) -> int:
        """Number of ticks k * TICK_S, from k = 0 on, that both sensors cover."""
        return int(min(np.ceil(self.fixes.t[-1] / TICK_S - 1e-6), np.floor(self.imu_t[-1] / TICK_S))) + 1

    @cached_property
    def on_ticks(self) -> Array:
        """Specific force, rate, roll, pitch, unaligned heading, all delayed by one filter: (ticks, 9)."""
        angles = euler_angles(self.imu_t, self.specific_force, self.rate)
        return anti_alias(self.imu_t, np.hstack([self.specific_force, self.rate, angles]), self.ticks)


@dataclass(frozen=True)
class SensorSignals:
    """The inputs of an estimator at each tick, and the reference to compare its outputs with.

    Arrays are (ticks,), in SI units and rad; body axes are forward, right, down. The inertial signals are
    delayed by the filter. The gps signals hold their last value between fixes and during outages. The
    reference has the withheld fixes too; an estimator never gets it.
    """

    t: Array
    accel_x: Array  # specific force
    accel_y: Array
    accel_z: Array
    gyro_x: Array
    gyro_y: Array
    gyro_z: Array
    mag_x: Array  # zeros: there is no magnetometer
    mag_y: Array
    mag_z: Array
    roll_meas: Array
    pitch_meas: Array  # nose up positive
    heading_meas: Array  # clockwise from north, but from an arbitrary zero until the first moving fix
    gps_fix: Mask  # a new fix at this tick
    gps_north: Array  # from the origin, the position of the fix at t = 0
    gps_east: Array
    gps_speed: Array
    gps_course: Array
    gps_h_acc: Array
    gps_s_acc: Array
    reference_fix: Mask
    reference_north: Array
    reference_east: Array
    reference_speed: Array
    reference_course: Array
    origin_latitude: float
    origin_longitude: float


def read_recording(folder: Path) -> Recording:
    """Read a folder's UBX stream, IMU samples and time tags.

    Raises:
        RecordingError: a file is missing, damaged, or does not fit the others.
    """
    if not folder.is_dir():
        raise RecordingError(f"{folder}: no such folder; expected the folder of a recording")
    ubx, imu = _only_file(folder, "*.ubx"), _only_file(folder, "imu*.csv")
    fixes, fix_ends, checksum_errors = _read_ubx(ubx)
    samples, sample_ends = _read_imu(imu)

    fix_t, tick = fixes[:, 0], samples[:, 6] / 1000
    latency = float(np.median(_wrap_week(_arrival(ubx, fix_ends) - fix_t)))
    if not 0 <= latency <= MAX_RECEIVER_LATENCY_S:
        raise RecordingError(
            f"{ubx}.tag: fixes arrive {latency:.3f} s after their epoch, expected 0 to "
            f"{MAX_RECEIVER_LATENCY_S} s; the logging computer's clock must keep GPS time"
        )
    delay = _arrival(imu, sample_ends) - tick
    early, late = (
        float(np.median(part)) for part in (delay[: len(delay) // 2 + 1], delay[len(delay) // 2 :])
    )
    if abs(late - early) > MAX_CLOCK_DRIFT_S:
        raise RecordingError(
            f"{imu}.tag: from the first half to the second the IMU's clock drifts {late - early:.3f} s "
            f"against the computer's, expected at most {MAX_CLOCK_DRIFT_S} s; is it the tag of this file?"
        )
    imu_t = fix_t[0] + _wrap_week(tick + delay.min() - fix_t[0])
    overlap = min(fix_t[-1], imu_t[-1]) - max(fix_t[0], imu_t[0])
    if overlap < MIN_OVERLAP_S:
        raise RecordingError(
            f"{folder}: {ubx.name} and {imu.name} overlap by {overlap:.1f} s, expected at least "
            f"{MIN_OVERLAP_S} s; record both together and longer"
        )
    zero = fix_t[fix_t >= imu_t[0]][0]
    return Recording(
        fixes=Fixes(fix_t - zero, *fixes[:, 1:].T),
        imu_t=imu_t - zero,
        specific_force=samples[:, 0:3] @ MOUNTING.T * STANDARD_GRAVITY,
        rate=np.radians(samples[:, 3:6] @ MOUNTING.T),
        checksum_errors=checksum_errors,
    )


def sensor_signals(recording: Recording, outages: Sequence[tuple[float, float]] = ()) -> SensorSignals:
    """Resample a recording to ticks, and withhold the fixes at start <= t <= end [s] of each outage.

    A fix falls on the first tick at or after it. Fixes faster than MOVING_M_S align the heading, with the
    time constant ALIGNING_S.

    Raises:
        RecordingError: an outage hides the fix at 0, which is the origin, or ends before it starts.
    """
    fixes = recording.fixes
    origin = int(np.searchsorted(fixes.t, 0.0))
    plane = TangentPlane(*(float(field[origin]) for field in (fixes.latitude, fixes.longitude, fixes.height)))
    north, east = plane.to_plane(fixes.latitude, fixes.longitude)
    speed = np.hypot(fixes.velocity_north, fixes.velocity_east)
    course = np.arctan2(fixes.velocity_east, fixes.velocity_north)

    clock = np.arange(recording.ticks, dtype=np.int64)
    tick = np.ceil(fixes.t / TICK_S - 1e-6).astype(np.int64)
    covered = (tick >= 0) & (tick < recording.ticks)
    used = covered.copy()
    for start, end in outages:
        if not 0 < start <= end:
            raise RecordingError(f"outage from {start} to {end} s: expected 0 < start <= end")
        used &= (fixes.t < start) | (fixes.t > end)

    def held(among: Mask, field: Array) -> Array:
        return field[among][np.searchsorted(tick[among], clock, side="right") - 1]

    accel_x, accel_y, accel_z, gyro_x, gyro_y, gyro_z, roll, pitch, heading = recording.on_ticks.T
    aligning = used & (speed > MOVING_M_S)
    zeros = np.zeros(recording.ticks)
    return SensorSignals(
        t=np.asarray(clock * TICK_S),
        accel_x=accel_x,
        accel_y=accel_y,
        accel_z=accel_z,
        gyro_x=gyro_x,
        gyro_y=gyro_y,
        gyro_z=gyro_z,
        mag_x=zeros,
        mag_y=zeros,
        mag_z=zeros,
        roll_meas=roll,
        pitch_meas=pitch,
        heading_meas=align_heading(heading, tick[aligning], course[aligning], ALIGNING_S),
        gps_fix=np.isin(clock, tick[used]),
        gps_north=held(used, north),
        gps_east=held(used, east),
        gps_speed=held(used, speed),
        gps_course=held(used, course),
        gps_h_acc=held(used, fixes.h_acc),
        gps_s_acc=held(used, fixes.s_acc),
        reference_fix=np.isin(clock, tick[covered]),
        reference_north=held(covered, north),
        reference_east=held(covered, east),
        reference_speed=held(covered, speed),
        reference_course=held(covered, course),
        origin_latitude=float(fixes.latitude[origin]),
        origin_longitude=float(fixes.longitude[origin]),
    )


def _only_file(folder: Path, pattern: str) -> Path:
    paths = sorted(folder.glob(pattern))
    if len(paths) != 1:
        got = ", ".join(path.name for path in paths) or "none"
        raise RecordingError(
            f"{folder}: got {got} for {pattern}, expected one file; keep one recording in each folder"
        )
    for path in (paths[0], _tag(paths[0])):
        if not path.is_file():
            raise RecordingError(
                f"{path}: missing; expected the time tag that RTKLIB writes with {paths[0].name}"
            )
        if path.stat().st_size == 0:
            raise RecordingError(f"{path}: got an empty file, expected a recording; copy it again")
    return paths[0]


def _tag(path: Path) -> Path:
    return path.with_name(path.name + ".tag")


def _read_ubx(path: Path) -> tuple[Array, Index, int]:
    """Valid fixes (f, 8), columns as in `Fixes`; the file position after each; number of frames dropped."""
    pvt: list[tuple[float, ...]] = []
    pairs: list[tuple[float, ...]] = []
    errors, posllh = 0, None
    with path.open("rb") as stream:
        for frame, _ in UBXReader(stream, protfilter=UBX_PROTOCOL, parsing=False):
            kind, end = frame[2:4], stream.tell()
            if calc_checksum(frame[2:-2]) != frame[-2:]:
                errors += 1
            elif kind in (NAV_PVT, NAV_POSLLH, NAV_VELNED):
                m: Any = UBXReader.parse(frame)
                if kind == NAV_PVT and m.gnssFixOk and m.fixType in (2, 3, 4):
                    pvt.append((end, *_position(m), m.velN / 1e3, m.velE / 1e3, m.hAcc / 1e3, m.sAcc / 1e3))
                elif kind == NAV_POSLLH:
                    posllh = m if m.hAcc / 1e3 < MAX_H_ACC_M else None
                elif kind == NAV_VELNED and posllh is not None and posllh.iTOW == m.iTOW:
                    velocity = m.velN / 1e2, m.velE / 1e2
                    pairs.append((end, *_position(posllh), *velocity, posllh.hAcc / 1e3, m.sAcc / 1e2))
    rows = np.array(pvt or pairs)
    if not len(rows):
        raise RecordingError(
            f"{path}: got no fixes, expected NAV-PVT or NAV-POSLLH with NAV-VELNED; "
            "enable them in the receiver and record under open sky"
        )
    fixes = rows[:, 1:]
    fixes[:, 0] = np.unwrap(fixes[:, 0], period=WEEK_S)
    _require_increasing(path, fixes[:, 0])
    return fixes, rows[:, 0].astype(np.int64), errors


def _position(m: Any) -> tuple[float, float, float, float]:
    return m.iTOW / 1e3, np.radians(m.lat), np.radians(m.lon), m.height / 1e3


def _read_imu(path: Path) -> tuple[Array, Index]:
    """Samples (n, 7) and the file position after each; the logger truncates the first and the last line."""
    lines = path.read_bytes().split(b"\n")
    samples = np.empty((max(len(lines) - 2, 0), 7))
    for i, line in enumerate(lines[1:-1]):
        try:
            samples[i] = [float(field) for field in line.split(b",")]
        except ValueError:
            raise RecordingError(
                f"{path}, line {i + 2}: got {line.decode(errors='replace')!r}, expected the seven numbers "
                "ax,ay,az,gx,gy,gz,tick; mend the line or cut the recording there"
            ) from None
    if not len(samples):
        raise RecordingError(
            f"{path}: got {len(lines)} lines, expected samples between a first and a last line"
        )
    _require_increasing(path, samples[:, 6] / 1000)
    return samples, np.cumsum([len(line) + 1 for line in lines[:-1]])[1:]


def _arrival(path: Path, ends: Index) -> Array:
    """GPS time of week [s] at which the computer had received the file up to each position in `ends`.

    A tag has 64 bytes of header, the start as GPS time since 1970 (uint32 s and float64 s), then pairs of
    uint32: ms since the start, and the size of the file at that time.
    """
    tag = _tag(path).read_bytes()
    if not tag.startswith(b"TIMETAG RTKLIB") or len(tag) < 84 or (len(tag) - 76) % 8:
        raise RecordingError(
            f"{_tag(path)}: got {len(tag)} bytes, expected TIMETAG RTKLIB, a header of 76 and pairs of 8; "
            "it is truncated or not a time tag, copy it again"
        )
    seconds, fraction = struct.unpack_from("<Id", tag, 64)
    ms, received = np.frombuffer(tag, "<u4", offset=76).reshape(-1, 2).astype(np.int64).T
    excess = int(received[-1]) - path.stat().st_size
    if excess == len(ends) + 1:  # a copy turned CR LF into LF: each line is a byte shorter than when received
        ends = ends + np.arange(2, len(ends) + 2)
    elif excess != 0:
        raise RecordingError(
            f"{path}: got {path.stat().st_size} bytes, expected {received[-1]} by its tag; one of the two is "
            "truncated or from another recording"
        )
    started = (seconds - GPS_EPOCH_S) % WEEK_S + fraction
    return np.asarray(started + ms[np.searchsorted(received, ends)] / 1000)


def _require_increasing(path: Path, clock: Array) -> None:
    for i in np.flatnonzero(~(np.diff(clock) > 0))[:1]:
        raise RecordingError(
            f"{path}: the clock goes from {clock[i]:.3f} to {clock[i + 1]:.3f} s at record {i + 2}, expected "
            "an increase; cut the recording there"
        )


def _wrap_week(seconds: Array) -> Array:
    """A difference of times of week, wrapped to half a week around 0."""
    return (seconds + WEEK_S / 2) % WEEK_S - WEEK_S / 2
