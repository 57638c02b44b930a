"""Reads inertial samples from a csv: ax, ay, az [g], gx, gy, gz [deg/s], tick [ms since power-up]."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.recording.recording import RecordingError, SampleStream

STANDARD_GRAVITY = 9.80665  # m/s2, the accelerometer's unit of 1 g


def read_imu_csv(path: Path) -> SampleStream:
    """The samples in a csv; its logger truncates the first and the last line.

    Raises:
        RecordingError: a line is no sample, or there is none.
    """
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
    return SampleStream(
        file=path.name,
        clock=samples[:, 6] / 1000,
        specific_force=samples[:, 0:3] * STANDARD_GRAVITY,
        rate=np.radians(samples[:, 3:6]),
        ends=np.cumsum([len(line) + 1 for line in lines[:-1]])[1:],
    )
