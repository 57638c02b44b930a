"""Reads inertial samples from a csv: ax, ay, az [g], gx, gy, gz [deg/s], tick [ms since power-up]."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from harness.recording.recording import RecordingError, SampleStream, as_number, read_file

LARGEST = 1e12  # ms are 30 years
STANDARD_GRAVITY = 9.80665  # m/s2, the accelerometer's unit of 1 g


def read_imu_csv(path: Path) -> SampleStream:
    """The samples in a csv; its logger truncates the first and the last line.

    A line that is no sample is dropped and counted.

    Raises:
        RecordingError: half of the lines are no samples, or there is none.
    """
    lines = read_file(path).split(b"\n")
    parsed = [_numbers(line) for line in lines[1:-1]]
    wrong = [i for i, sample in enumerate(parsed) if sample is None]
    if wrong and 2 * len(wrong) >= len(parsed):
        line = lines[1 + wrong[0]]
        raise RecordingError(
            f"{path}, line {wrong[0] + 2}: got {line[:80].decode(errors='replace')!r}, expected the seven "
            f"numbers ax,ay,az,gx,gy,gz,tick; {len(wrong)} of {len(parsed)} lines are not: is it such a file?"
        )
    if not parsed:
        raise RecordingError(
            f"{path}: got {len(lines)} lines, expected samples between a first and a last line"
        )
    samples = np.array([sample for sample in parsed if sample is not None])
    ends = np.cumsum([len(line) + 1 for line in lines[:-1]])[1:]
    return SampleStream(
        file=path.name,
        clock=samples[:, 6] / 1000,
        specific_force=samples[:, 0:3] * STANDARD_GRAVITY,
        rate=np.radians(samples[:, 3:6]),
        ends=np.delete(ends, wrong),
        dropped={f"IMU lines without seven numbers (the first: line {wrong[0] + 2})": len(wrong)}
        if wrong
        else {},
    )


def _numbers(line: bytes) -> list[float] | None:
    """The seven numbers of a line; None if it has others, or such as no IMU sends."""
    try:
        numbers = [as_number(field) for field in line.split(b",")]
    except ValueError:
        return None
    possible = all(abs(value) < LARGEST for value in numbers)
    return numbers if len(numbers) == 7 and possible else None
