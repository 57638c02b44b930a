"""Ties the clock of an IMU to GPS time by RTKLIB's time tags, `*.tag` beside each file.

A fix carries GPS time of week, a sample only the IMU's own tick. The tag of the IMU's file gives
the time when the logging computer, whose clock keeps GPS time, received each line. Transport only delays, so
the smallest (arrival - tick) of the recording is the offset between the clocks. The receiver's tag shows that
the computer's clock is right.
"""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

from harness.recording.attitude import Array
from harness.recording.order import longest_rise
from harness.recording.recording import (
    WEEK_S,
    FixStream,
    Index,
    RecordingError,
    SampleStream,
    read_file,
    wrap_week,
)

GPS_EPOCH_S = 315_964_800  # 1980-01-06 from 1970-01-01: the tags count GPS time from the latter

HEADER = 76  # bytes of a tag
PAIRS = tuple(np.dtype([("ms", "<u4"), ("size", size)]) for size in ("<u4", "<u8"))

MAX_RECEIVER_LATENCY_S = 0.5  # s from the epoch of a fix to its arrival
EARLY_S = 0.02  # s before the earliest arrivals; what is earlier has a damaged time
MAX_CLOCK_DRIFT_S = 0.05  # s, of the IMU's clock against the computer's over the recording


def timely_fixes(path: Path, fixes: FixStream) -> FixStream:
    """The fixes whose time agrees with that of their arrival; the receiver had set the others' clock wrong.

    Raises:
        RecordingError: most do not, or the tag does not fit the file.
    """
    latency = wrap_week(arrival(path, fixes.ends) - fixes.rows[:, 0])
    middle = float(np.median(latency))
    if not 0 <= middle <= MAX_RECEIVER_LATENCY_S:
        raise RecordingError(
            f"{path}.tag: fixes arrive {middle:.3f} s after their epoch, expected 0 to "
            f"{MAX_RECEIVER_LATENCY_S} s; the logging computer's clock must keep GPS time"
        )
    timely = np.abs(latency - middle) <= MAX_RECEIVER_LATENCY_S
    return fixes.only(timely, "fixes whose time is not that of their arrival")


def timed_samples(path: Path, samples: SampleStream) -> tuple[SampleStream, float]:
    """The samples in order, and GPS time of week minus the clock of the IMU [s].

    Raises:
        RecordingError: the clock drifts, or the tag does not fit the file.
    """
    samples = samples.in_order()
    delay = arrival(path, samples.ends) - samples.clock
    early, late = (
        float(np.median(part)) for part in (delay[: len(delay) // 2 + 1], delay[len(delay) // 2 :])
    )
    if not abs(late - early) <= MAX_CLOCK_DRIFT_S:
        raise RecordingError(
            f"{path}.tag: from the first half to the second the IMU's clock drifts {late - early:.3f} s "
            f"against the computer's, expected at most {MAX_CLOCK_DRIFT_S} s; is it the tag of this file?"
        )
    early, median = np.percentile(delay, [5, 50])
    timely = delay >= early - max(EARLY_S, median - early)
    samples = samples.only(timely, "IMU samples with a time after their arrival")
    return samples, float(delay[timely].min())


def tag_of(path: Path) -> Path:
    """The time tag that RTKLIB writes with a file."""
    return path.with_name(path.name + ".tag")


def arrival(path: Path, ends: Index) -> Array:
    """GPS time of week [s] at which the computer had received the file up to each position in `ends`.

    A tag has 64 bytes of header, the start as GPS time since 1970 (uint32 s and float64 s), then pairs: ms
    since the start (uint32), and the size of the file at that time (uint32, in newer versions uint64). Pairs
    out of order are passed over.

    Raises:
        RecordingError: it is no such tag, or not the tag of this file.
    """
    if not tag_of(path).exists():
        raise RecordingError(
            f"{tag_of(path)}: missing; expected the time tag that RTKLIB writes with {path.name}"
        )
    tag, content = read_file(tag_of(path)), read_file(path)
    newlines = np.flatnonzero(np.frombuffer(content, np.uint8) == ord("\n")) + 1
    sizes = {
        len(content): ends,
        len(content) + len(newlines): ends + np.searchsorted(newlines, ends, "right"),
    }
    if len(tag) >= HEADER and tag.startswith(b"TIMETAG RTKLIB"):
        seconds, fraction = struct.unpack_from("<Id", tag, HEADER - 12)
        if not 0 <= fraction < 1:
            raise RecordingError(
                f"{tag_of(path)}: got a start with {fraction:g} s of a second at byte {HEADER - 8}, "
                "expected 0 to 1; it is damaged, copy it again"
            )
        for pair in PAIRS:
            if (len(tag) - HEADER) % pair.itemsize:
                continue
            pairs = np.frombuffer(tag, pair, offset=HEADER)
            received = pairs["size"].astype(np.float64)
            if len(pairs) and received[-1] in sizes:
                rising = longest_rise(received, strict=False) & (received <= received[-1])
                rising[rising] = longest_rise(pairs["ms"][rising].astype(np.float64), strict=False)
                rising[-1] = True
                at = np.searchsorted(received[rising], sizes[int(received[-1])])
                at = np.minimum(at, rising.sum() - 1)  # a file that another program rewrites meanwhile
                started = (seconds - GPS_EPOCH_S) % WEEK_S + fraction
                return np.asarray(started + pairs["ms"][rising][at] / 1000)
        if len(tag) >= HEADER + 8 and (len(tag) - HEADER) % 8 == 0:
            got = np.frombuffer(tag, PAIRS[0], offset=HEADER)["size"][-1]
            raise RecordingError(
                f"{path}: got {len(content)} bytes, expected {got} by its tag; one of the two is truncated "
                "or from another recording"
            )
    raise RecordingError(
        f"{tag_of(path)}: got {len(tag)} bytes, expected TIMETAG RTKLIB, a header of {HEADER} and pairs of 8 "
        "or 12; it is truncated or not a time tag, copy it again"
    )
