"""Reads the byte stream of an Xsens MT as the onboard program does (codegen/firmware/onboard/mt.c).

Source: Xsens MT low-level communication protocol, message MTData, output mode 0x0006 (calibrated data and
orientation), settings 0x00000005 (Euler angles and sample counter, single precision). A frame: FA, FF (bus
address), 32 (message), length, data, checksum: the bytes behind FA sum up to 0 mod 256. Big-endian. The axes
are the unit's own: forward, left, up as it leaves the factory. Its angles turn them into north, west, up.

A damaged frame is lost and nothing else: the search goes on at the byte behind its preamble.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.recording.attitude import Array
from harness.recording.mounting import rotations
from harness.recording.recording import RecordingError, SampleStream, read_file

PREAMBLE, ADDRESS, MTDATA = 0xFA, 0xFF, 0x32
NORTH_EAST_DOWN = np.diag([1.0, -1.0, -1.0])  # of north, west, up
DATA = 50  # bytes: twelve floats and the counter
HEADER, CHECKSUM = 4, 1
START = bytes([PREAMBLE, ADDRESS, MTDATA])
RECORD = np.dtype([("values", ">f4", 12), ("counter", ">u2")])
RATE_SLACK = 0.01  # part by which the rate that arrivals show may differ from a whole number
WRAP = 1 << 16  # of the sample counter


def read_xsens(path: Path, rate_hz: float) -> SampleStream:
    """The samples of a log, timed by the unit's sample counter, which counts at `rate_hz`.

    Raises:
        RecordingError: it holds no sample.
    """
    content = read_file(path)
    frames, dropped = find_samples(content)
    if not frames:
        raise RecordingError(
            f"{path}: got {dropped['MTData of another mode']} MTData messages of another output mode and "
            "none of 0x0006 with settings 0x00000005 (calibrated data, Euler angles, sample counter); set "
            "the unit so"
        )
    records = np.frombuffer(
        b"".join(content[end - CHECKSUM - DATA : end - CHECKSUM] for end in frames), RECORD
    )
    counter = records["counter"].astype(np.int64)
    step = (np.diff(counter) + WRAP // 2) % WRAP - WRAP // 2  # back: the unit was restarted
    kept = int(np.append(np.flatnonzero(step < 0) + 1, len(counter))[0])
    moved = np.concatenate([[True], step[: kept - 1] != 0])
    elapsed = np.concatenate([[0], np.cumsum(step[: kept - 1])])[moved]
    values = records["values"][:kept][moved].astype(np.float64)
    dropped["MTData whose counter did not move"] = int((~moved).sum())
    dropped["MTData after a restart of the unit"] = len(counter) - kept
    dropped["MTData lost, by the counter"] = int((np.diff(elapsed) - 1).sum())
    return SampleStream(
        path.name,
        elapsed / rate_hz,
        specific_force=values[:, 0:3],
        rate=values[:, 3:6],
        ends=np.array(frames[:kept])[moved],
        dropped=dropped,
        attitude=NORTH_EAST_DOWN @ rotations(*np.radians(values[:, 9:12]).T),
    )


def find_samples(content: bytes) -> tuple[list[int], Counter[str]]:
    """The position behind each whole MTData frame of our mode, and how many others there were, by cause."""
    ends: list[int] = []
    dropped: Counter[str] = Counter()
    at = content.find(START)
    while at >= 0:
        length = content[at + 3] if at + 3 < len(content) else DATA
        end = at + HEADER + length + CHECKSUM
        intact = end <= len(content) and sum(content[at + 1 : end]) % 256 == 0
        if length == DATA and intact:
            ends.append(end)
        elif length == DATA:
            dropped["MTData with a wrong checksum" if end <= len(content) else "MTData cut at the end"] += 1
        elif intact:
            dropped["MTData of another mode"] += 1
        at = content.find(START, end if length == DATA and intact else at + 1)
    return ends, dropped


def timed_by_arrival(samples: SampleStream, arrival: Array) -> SampleStream:
    """Samples whose clock is their counter, with it in s: at the whole rate that their arrival [s] shows.

    Raises:
        RecordingError: the arrival shows no whole rate.
    """
    first, last = len(arrival) // 10, len(arrival) - 1 - len(arrival) // 10  # not the ends: a start is uneven
    elapsed = float(arrival[last] - arrival[first])
    rate = float(samples.clock[last] - samples.clock[first]) / elapsed if elapsed > 0 else 0.0
    if round(rate) < 1 or abs(rate / round(rate) - 1) > RATE_SLACK:
        raise RecordingError(
            f"{samples.file}: its time tag shows {rate:.3f} samples a second, expected a whole number; state "
            "imu.rate in recording.toml"
        )
    return replace(samples, clock=samples.clock / round(rate))
