"""Finds a u-blox receiver's own inertial samples among its messages: UBX-ESF-RAW and UBX-ESF-MEAS.

Source: u-blox M8 and F9 interface descriptions, messages UBX-ESF-RAW (10 03), UBX-ESF-MEAS (10 02), and
"ESF measurement data". A measurement is 24 bits of two's complement with a type above it: 14, 13, 5 are the
rates about x, y, z [2^-12 deg/s], 16, 17, 18 the specific forces along x, y, z [2^-10 m/s2]; temperatures and
wheel ticks are passed over. The axes are those of the receiver's IMU.

Clock: ESF-MEAS has one time tag for all its measurements, ESF-RAW one for each, both on the clock of the
sensor; the descriptions do not tie it to GPS time, nor do they name the unit in ESF-RAW. What ties them is
the order of the messages in the stream: a sample that came just before a fix and the one that came just after
it enclose the time when the fix was sent. So the time is known to about the distance of two messages, and
`canine check` shows what the correlation with the fixes makes of it.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pyubx2 import UBX_MSGIDS

from harness.recording.attitude import Array
from harness.recording.recording import (
    WEEK_S,
    FixStream,
    Index,
    RecordingError,
    SampleStream,
    added,
    read_file,
)
from harness.recording.ubx import Frame, find_frames

ESF_MEAS, ESF_RAW = b"\x10\x02", b"\x10\x03"
RATES, FORCES = (14, 13, 5), (16, 17, 18)  # types of x, y, z
RATE_UNIT = np.radians(2.0**-12)  # rad/s
FORCE_UNIT = 2.0**-10  # m/s2
CALIBRATED = 0x08  # in the flags of ESF-MEAS: 4 bytes of calibrated time follow the measurements
TAG_UNITS_S = (1e-3, 1 / 25_600)  # s: those that are seen in ESF-RAW; ESF-MEAS has the former
UNIT_SLACK = 0.02  # part by which the measured tick may differ
LEAST_FIXES = 10
MAX_DRIFT_S = 0.1  # s over the recording
WRAP = 1 << 32  # of a time tag
LENGTHS = {ESF_RAW: range(12, 4096, 8), ESF_MEAS: range(12, 140, 4)}  # bytes of a payload
FORCE_GAPS = 1.5  # gaps between forces within which a rate has a force beside it


def read_esf(path: Path) -> SampleStream:
    """The samples in a u-blox stream, their clock in ticks of the sensor.

    Raises:
        RecordingError: there is none.
    """
    frames, damaged = find_frames(read_file(path), LENGTHS)
    samples = esf_samples(path.name, frames)
    if samples is None:
        raise RecordingError(
            f"{path}: got no inertial samples, expected UBX-ESF-RAW or UBX-ESF-MEAS with rates and forces; "
            "switch them on in a receiver with an IMU, or keep the IMU's file beside it"
        )
    return replace(samples, dropped=added(damaged, samples.dropped))


def message_counts(path: Path) -> dict[str, int]:
    """How many of which message a stream has, the most frequent first."""
    frames, _ = find_frames(read_file(path), {kind[:2]: range(1, 1 << 16) for kind in UBX_MSGIDS})
    counts = Counter(frame.kind for frame in frames)
    return {UBX_MSGIDS.get(kind, f"{kind[0]:02X} {kind[1]:02X}"): n for kind, n in counts.most_common()}


def decode_raw(payload: bytes) -> list[tuple[int, int, int]]:
    """Type, value and time tag of each measurement of an ESF-RAW; empty where its length is wrong."""
    if len(payload) < 12 or len(payload) % 8 != 4:
        return []
    return [(*_split(word), tag) for word, tag in struct.iter_unpack("<II", payload[4:])]


def decode_meas(payload: bytes) -> list[tuple[int, int, int]]:
    """Type, value and time tag of each measurement of an ESF-MEAS; empty where its length is wrong."""
    if len(payload) < 12 or len(payload) % 4:
        return []
    tag, flags, _ = struct.unpack_from("<IHH", payload)
    count = flags >> 11
    held = len(payload) // 4 - 2 - (1 if flags & CALIBRATED else 0)
    if held < 1 or count not in (0, held):  # receivers before M8 leave it at 0
        return []
    return [(*_split(word), tag) for (word,) in struct.iter_unpack("<I", payload[8 : 8 + 4 * held])]


def _split(word: int) -> tuple[int, int]:
    """The type of a measurement, and its 24 bits as a signed number."""
    value = word & 0xFFFFFF
    return word >> 24 & 0x3F, value - (1 << 24 if value & 0x800000 else 0)


def esf_samples(file: str, messages: Sequence[Frame]) -> SampleStream | None:
    """The samples in some messages, their clock in ticks of the sensor.

    ESF-RAW is taken where there is any, since it has every sample; else ESF-MEAS. A sample is a rate about
    three axes, and the force along three axes at that time: between two, where they have tags of their own.
    None if there is no sample.
    """
    kinds = {kind for kind, _, _ in messages}
    kind, decode = (ESF_RAW, decode_raw) if ESF_RAW in kinds else (ESF_MEAS, decode_meas)
    dropped: Counter[str] = Counter()
    vectors: dict[tuple[int, ...], dict[int, dict[int, int]]]  # tag -> type -> value
    vectors = {RATES: {}, FORCES: {}}
    ends: dict[int, int] = {}
    latest = None
    for of_kind, payload, end in messages:
        if of_kind != kind:
            dropped["ESF-MEAS messages beside ESF-RAW"] += of_kind == ESF_MEAS
            continue
        measurements = decode(payload)
        dropped["ESF messages of a wrong length"] += not measurements
        for of_type, value, tag in measurements:
            unwrapped = tag if latest is None else latest + (tag - latest + WRAP // 2) % WRAP - WRAP // 2
            for types, found in vectors.items():
                if of_type in types:
                    found.setdefault(unwrapped, {}).setdefault(of_type, value)
                    ends.setdefault(unwrapped, end)
                    latest = unwrapped
    (rate_tags, rates), (force_tags, forces) = (
        _whole(vectors[types], types, dropped) for types in (RATES, FORCES)
    )
    if not len(rate_tags) or not len(force_tags):
        return None
    if len(force_tags) > 1:
        distance = np.abs(rate_tags - force_tags[_nearest(force_tags, rate_tags)])
        beside = distance <= FORCE_GAPS * np.median(np.diff(force_tags))
    else:
        beside = rate_tags == force_tags[0]
    dropped["ESF rates without a force beside them"] += int((~beside).sum())
    rate_tags, rates = rate_tags[beside], rates[beside]
    force = np.column_stack([np.interp(rate_tags, force_tags, axis) for axis in forces.T])
    at = np.array([ends[int(tag)] for tag in rate_tags], dtype=np.int64)
    return SampleStream(
        file, rate_tags.astype(np.float64), force * FORCE_UNIT, rates * RATE_UNIT, at, dropped, in_ticks=True
    )


def _whole(
    by_tag: dict[int, dict[int, int]], types: tuple[int, ...], dropped: Counter[str]
) -> tuple[Index, Array]:
    """The tags in their order at which all three axes were measured, (k,), and the values, (k, 3)."""
    tags = sorted(tag for tag, values in by_tag.items() if len(values) == len(types))
    dropped["ESF vectors without all three axes"] += len(by_tag) - len(tags)
    values = [[by_tag[tag][of_type] for of_type in types] for tag in tags]
    return np.array(tags, dtype=np.int64), np.array(values, dtype=np.float64).reshape(-1, len(types))


def _nearest(sorted_tags: Index, tags: Index) -> Index:
    """Index of the nearest of `sorted_tags` to each of `tags`."""
    right = np.clip(np.searchsorted(sorted_tags, tags), 1, len(sorted_tags) - 1)
    return right - (tags - sorted_tags[right - 1] < sorted_tags[right] - tags)


def tie(fixes: FixStream, samples: SampleStream) -> tuple[SampleStream, float, float]:
    """The samples with their clock in s; what it lacks to GPS time of week; how well that is known [s].

    Each fix lies in the stream between two messages with samples. Their middle is when it was sent, which is
    when it was taken, but for the receiver's latency of less than 0.1 s.

    Raises:
        RecordingError: too few fixes between samples, or a clock of an unknown unit or one that jumps.
    """
    ends, last = np.unique(samples.ends[::-1], return_index=True)  # of each message
    newest = samples.clock[len(samples.clock) - 1 - last]
    after = np.searchsorted(ends, fixes.ends)
    between = (after > 0) & (after < len(ends))
    if between.sum() < LEAST_FIXES:
        raise RecordingError(
            f"{samples.file}: got {between.sum()} fixes with ESF messages before and behind them, expected "
            f"at least {LEAST_FIXES}; the order of the messages ties the clocks"
        )
    t = np.unwrap(fixes.rows[between, 0], period=WEEK_S)
    before, behind = newest[after[between] - 1], newest[after[between]]
    ticks = (before + behind) / 2
    half = len(t) // 2
    ticks_passed = float(np.median(ticks[half:]) - np.median(ticks[:half]))
    unit = float(np.median(t[half:]) - np.median(t[:half])) / ticks_passed if ticks_passed > 0 else 0.0
    known = [tag for tag in TAG_UNITS_S if abs(unit / tag - 1) < UNIT_SLACK]
    if not known:
        raise RecordingError(
            f"{samples.file}: its sensor's clock has ticks of {unit * 1e6:.4g} us, expected "
            f"{' or '.join(f'{tag * 1e6:.6g}' for tag in TAG_UNITS_S)} us; cut the recording at a restart"
        )
    offsets = t - ticks * known[0]
    early, late = float(np.median(offsets[:half])), float(np.median(offsets[half:]))
    width = float(np.median(behind - before)) * known[0]
    if abs(late - early) > max(width, MAX_DRIFT_S):
        raise RecordingError(
            f"{samples.file}: from the first half to the second the sensor's clock drifts {late - early:.3f} "
            f"s against GPS time, expected at most {max(width, MAX_DRIFT_S):.3f} s; cut it at a restart"
        )
    timed = replace(samples, clock=samples.clock * known[0], in_ticks=False)
    return timed, float(np.median(offsets)), width / 2
