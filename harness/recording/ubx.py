"""Finds the fixes in the byte stream of a u-blox receiver, by the rules of the program on board.

What makes a fix is stated in codegen/firmware/fixes.py for both. Frames are found as the scanner on board
finds them (codegen/firmware/onboard/scanner.h): one with a wrong checksum or an impossible length is searched
again from its second byte on and never swallows the good one behind it; other messages are searched as well.
"""

from __future__ import annotations

import math
import struct
from collections import Counter
from collections.abc import Collection, Iterator, Mapping
from itertools import accumulate
from pathlib import Path
from typing import NamedTuple

import numpy as np

from codegen.firmware.fixes import (
    MESSAGES,
    NOT_3D,
    NOT_GOOD,
    OUT_OF_RANGE,
    THREE_DIMENSIONAL,
    Message,
    Rule,
    in_range,
)
from harness.recording.recording import FixStream, RecordingError, added, read_file
from harness.recording.velocity import from_ecef

SYNC = b"\xb5\x62"
NAV = 0x01
HEADER, CHECKSUM = 6, 2  # bytes before and behind the payload

POSLLH, SOL, PVT, VELNED = (bytes([NAV, MESSAGES[name].id]) for name in ("posllh", "sol", "pvt", "velned"))
PVAT_MESSAGE = Message(  # of receivers with dead reckoning, which the program on board does not read
    0x17,
    (116,),
    (
        Rule(24, 0xFF, THREE_DIMENSIONAL, NOT_3D),  # fixType
        Rule(25, 0x01, (1,), NOT_GOOD),  # flags: gnssFixOK
        Rule(5, 0x02, (2,), "fixes whose time the receiver marks invalid"),  # valid: validTime
    ),
)
PVAT = bytes([NAV, PVAT_MESSAGE.id])
LENGTHS = {bytes([NAV, message.id]): message.lengths for message in (*MESSAGES.values(), PVAT_MESSAGE)}
TYPES = {3: "3D", 4: "3D with dead reckoning"}  # fixType, gpsFix
CARRIER = {1: " RTK float", 2: " RTK fixed"}  # carrSoln, bits 6 and 7 of the flags
MAX_H_ACC_MM = 100_000  # without NAV-SOL no message tells of a fix; without one hAcc is far worse than this


class Frame(NamedTuple):
    """A whole frame: class and number of its message, payload, and the position in the stream behind it."""

    kind: bytes
    payload: bytes
    end: int


def find_frames(content: bytes, lengths: Mapping[bytes, Collection[int]]) -> tuple[list[Frame], Counter[str]]:
    """The frames of some kinds in a stream, and how many damaged ones were dropped, by cause.

    Args:
        lengths: of the payload that each kind can have.
    """
    frames: list[Frame] = []
    dropped: Counter[str] = Counter()
    at = content.find(SYNC)
    while 0 <= at <= len(content) - HEADER:
        kind, length = content[at + 2 : at + 4], int.from_bytes(content[at + 4 : at + 6], "little")
        end, behind = at + HEADER + length + CHECKSUM, at + 1
        if kind in lengths:
            if length not in lengths[kind]:
                dropped["UBX frames of an impossible length"] += length > 0  # without payload: a poll
            elif end > len(content):
                dropped["UBX frames cut off by the end of the file"] += 1
            elif checksum(content[at + 2 : end - CHECKSUM]) == content[end - CHECKSUM : end]:
                frames.append(Frame(kind, content[at + HEADER : end - CHECKSUM], end))
                behind = end
            else:
                dropped["UBX frames with a wrong checksum"] += 1
        at = content.find(SYNC, behind)
    return frames, dropped


def checksum(body: bytes) -> bytes:
    """Fletcher's checksum of class, number, length and payload."""
    return bytes([sum(body) % 256, sum(accumulate(body)) % 256])


class Fix(NamedTuple):
    """What a receiver says of an epoch, in its own units."""

    values: Mapping[str, int]  # of a ubx_fix on board
    height: int  # mm above the ellipsoid
    velocity_north: int  # mm/s
    velocity_east: int
    whole: bool  # by NAV-PVT or NAV-PVAT; else of several messages
    kind: str  # in words

    @property
    def row(self) -> tuple[float, ...]:
        """As in a `FixStream`."""
        v = self.values
        return (
            v["time_ms"] / 1e3, np.radians(v["latitude"] * 1e-7), np.radians(v["longitude"] * 1e-7),
            self.height / 1e3, self.velocity_north / 1e3, self.velocity_east / 1e3,
            v["h_acc"] / 1e3, v["s_acc"] / 1e3,
        )  # fmt: skip


def read_ubx(path: Path) -> FixStream:
    """The valid fixes in a stream: NAV-PVT or NAV-PVAT, or NAV-POSLLH and NAV-VELNED, with NAV-SOL if any.

    Without NAV-VELNED the velocity is that of NAV-SOL, and its accuracy that of all three axes.

    Raises:
        RecordingError: it has none.
    """
    frames, damaged = find_frames(read_file(path), LENGTHS)
    rows, ends, refused, counted = [], [], Counter[str](), Counter[str]()
    last: Fix | None = None
    for fix, cause, end in _epochs(frames):
        if cause:
            refused[cause] += 1
        elif not in_range(fix.values):
            refused[OUT_OF_RANGE] += 1
        elif not (last and last.values["time_ms"] == fix.values["time_ms"] and last.whole != fix.whole):
            rows.append(fix.row)  # an epoch that is sent both ways counts once
            ends.append(end)
            counted[fix.kind] += 1
            last = fix
    if not rows:
        seen = ", ".join(f"{number} {cause}" for cause, number in added(damaged, refused).items())
        if {frame.kind for frame in frames} == {POSLLH}:
            raise RecordingError(
                f"{path}: got NAV-POSLLH without a velocity; switch on NAV-PVT, or NAV-SOL or NAV-VELNED "
                "beside it"
            )
        raise RecordingError(
            f"{path}: got no fixes ({seen or 'no such messages'}), expected NAV-PVT or NAV-POSLLH with "
            "NAV-VELNED or NAV-SOL; enable them in the receiver and record under open sky"
        )
    return FixStream(path.name, np.array(rows), np.array(ends, np.int64), added(damaged, refused), counted)


def _epochs(frames: Collection[Frame]) -> Iterator[tuple[Fix, str, int]]:
    """The epochs with position and velocity: the fix, why it is refused or "", the position behind it."""
    kinds = {frame.kind for frame in frames}
    parts: dict[bytes, bytes] = {}
    needed = {POSLLH} | ({SOL, VELNED} & kinds or {VELNED})
    for kind, payload, end in frames:
        if kind == PVT:
            yield _of_pvt(payload, PVT_LAYOUT), MESSAGES["pvt"].refused(payload), end
            continue
        if kind == PVAT:
            yield _of_pvt(payload, PVAT_LAYOUT), PVAT_MESSAGE.refused(payload), end
            continue
        if any(part[:4] != payload[:4] for part in parts.values()):  # another time of week
            parts.clear()
        parts[kind] = payload
        if parts.keys() >= needed:
            fix = _of_parts(parts)
            if SOL in parts:
                yield fix, MESSAGES["sol"].refused(parts[SOL]), end
            elif not kinds & {PVT, PVAT}:
                bad = fix.values["h_acc"] >= MAX_H_ACC_MM
                yield fix, "positions too inaccurate to be a fix" if bad else "", end
            parts.clear()


class Layout(NamedTuple):
    """Where a message that has the whole fix has its parts: name, and bytes in the payload."""

    name: str
    type: int
    position: int
    velocity: int
    course: int
    s_acc: int


PVT_LAYOUT = Layout("NAV-PVT", type=20, position=24, velocity=48, course=64, s_acc=68)
PVAT_LAYOUT = Layout("NAV-PVAT", type=24, position=28, velocity=52, course=84, s_acc=68)


def _of_pvt(payload: bytes, at: Layout) -> Fix:
    (time_ms,) = struct.unpack_from("<I", payload, 0)
    longitude, latitude, height, _, h_acc = struct.unpack_from("<iiiiI", payload, at.position)
    north, east, _, speed = struct.unpack_from("<iiii", payload, at.velocity)
    (course,) = struct.unpack_from("<i", payload, at.course)
    (s_acc,) = struct.unpack_from("<I", payload, at.s_acc)
    values = {
        "time_ms": time_ms, "latitude": latitude, "longitude": longitude, "h_acc": h_acc,
        "speed": speed, "course": course, "s_acc": s_acc,
    }  # fmt: skip
    carrier = CARRIER.get(payload[at.type + 1] >> 6, "")
    return Fix(values, height, north, east, True, f"{at.name} {TYPES.get(payload[at.type], '')}{carrier}")


def _of_parts(parts: Mapping[bytes, bytes]) -> Fix:
    time_ms, longitude, latitude, height, _, h_acc = struct.unpack_from("<IiiiiI", parts[POSLLH], 0)
    if VELNED in parts:
        north, east, _, _, speed, course, s_acc = struct.unpack_from("<iiiIIiI", parts[VELNED], 4)  # cm/s
        north, east, speed, velocity_by = 10 * north, 10 * east, 10 * speed, "NAV-VELNED"
    else:
        *ecef, s_acc = struct.unpack_from("<iiiI", parts[SOL], 28)  # cm/s
        place = np.radians(latitude * 1e-7), np.radians(longitude * 1e-7)
        north, east = (round(10 * axis) for axis in from_ecef(ecef, *place))
        speed, velocity_by = round(math.hypot(north, east)), "NAV-SOL"
        course = round(math.degrees(math.atan2(east, north)) * 1e5)
    values = {
        "time_ms": time_ms, "latitude": latitude, "longitude": longitude, "h_acc": h_acc,
        "speed": speed, "course": course, "s_acc": min(10 * s_acc, 2**32 - 1),
    }  # fmt: skip
    kind = f"NAV-POSLLH with {velocity_by} {TYPES.get(parts[SOL][10], '') if SOL in parts else ''}"
    return Fix(values, height, north, east, False, kind.rstrip())
