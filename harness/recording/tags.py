"""Reads a u-blox stream and a csv of inertial samples whose clocks are tied by RTKLIB's time tags.

A folder holds one `*.ubx` (u-blox binary stream), one `imu*.csv` (ax, ay, az [g], gx, gy, gz [deg/s],
tick [ms since power-up]), and beside each file its RTKLIB time tag, `*.tag`.

Clocks: a fix carries GPS time of week, an IMU line only the IMU's own tick. The tag of the IMU's file gives
the time when the logging computer, whose clock keeps GPS time, received each line. Transport only delays, so
the smallest (arrival - tick) of the recording is the offset between the clocks. The receiver's tag shows that
the computer's clock is right.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from harness.recording.attitude import Array
from harness.recording.imu_csv import read_imu_csv
from harness.recording.recording import WEEK_S, Index, Recording, RecordingError, join, wrap_week
from harness.recording.ubx import read_ubx

GPS_EPOCH_S = 315_964_800  # 1980-01-06 from 1970-01-01: the tags count GPS time from the latter

# Forward, right and down in the axes of the IMU: roll, pitch, yaw = 180, 0, -90 deg.
MOUNTING = np.array([[0.0, -1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

MAX_RECEIVER_LATENCY_S = 0.5  # s from the epoch of a fix to its arrival
MAX_CLOCK_DRIFT_S = 0.05  # s, of the IMU's clock against the computer's over the recording


def read_tagged(folder: Path) -> Recording:
    """Read a folder's UBX stream, IMU samples and time tags.

    Raises:
        RecordingError: a file is missing, damaged, or does not fit the others.
    """
    ubx, imu = _only_file(folder, "*.ubx"), _only_file(folder, "imu*.csv")
    fixes, samples = read_ubx(ubx), read_imu_csv(imu)
    latency = float(np.median(wrap_week(arrival(ubx, fixes.ends) - fixes.rows[:, 0])))
    if not 0 <= latency <= MAX_RECEIVER_LATENCY_S:
        raise RecordingError(
            f"{ubx}.tag: fixes arrive {latency:.3f} s after their epoch, expected 0 to "
            f"{MAX_RECEIVER_LATENCY_S} s; the logging computer's clock must keep GPS time"
        )
    delay = arrival(imu, samples.ends) - samples.clock
    early, late = (
        float(np.median(part)) for part in (delay[: len(delay) // 2 + 1], delay[len(delay) // 2 :])
    )
    if abs(late - early) > MAX_CLOCK_DRIFT_S:
        raise RecordingError(
            f"{imu}.tag: from the first half to the second the IMU's clock drifts {late - early:.3f} s "
            f"against the computer's, expected at most {MAX_CLOCK_DRIFT_S} s; is it the tag of this file?"
        )
    return join(folder.resolve().name, fixes, samples, float(delay.min()), MOUNTING)


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


def arrival(path: Path, ends: Index) -> Array:
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
