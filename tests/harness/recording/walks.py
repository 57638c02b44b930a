"""Made-up walks as folders of a recording: a receiver's stream, a csv of an IMU, and their time tags.

A walker stands for 4 s, then walks at 1.5 m/s on a circle of 20 m. Nothing here comes from the reader.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Sequence
from pathlib import Path

TOW_MS = 100_000_000
FIXES = 120  # at 4 Hz: 30 s
PERIOD_MS = 250


def frame(message: int, payload: bytes, of_class: int = 1) -> bytes:
    """A UBX frame."""
    body = bytes([of_class, message]) + struct.pack("<H", len(payload)) + payload
    a = b = 0
    for byte in body:
        a = (a + byte) % 256
        b = (b + a) % 256
    return b"\xb5\x62" + body + bytes([a, b])


def walker(t: float) -> tuple[float, float, float, float]:
    """North, east [m], speed [m/s] and course [rad] at a time [s]."""
    turned = max(0.0, t - 4) * 1.5 / 20
    return 20 * math.sin(turned), 20 * (1 - math.cos(turned)), 1.5 if t > 4 else 0.0, turned


def pvt(
    k: int,
    *,
    origin: tuple[int, int] = (100_000_000, 200_000_000),
    late_ms: int = 0,
    north_m: float = 0.0,
    length: int = 92,
    **byte: int,
) -> bytes:
    """The NAV-PVT of fix k.

    Args:
        origin: latitude and longitude [1e-7 deg].
        late_ms: by which its time is ahead.
        north_m: by which its position is wrong.
        byte: `valid`, `fix`, `flags` or `flags3`.
    """
    north, east, speed, course = walker(k * PERIOD_MS / 1000)
    payload = bytearray(92)
    struct.pack_into("<I", payload, 0, TOW_MS + PERIOD_MS * k + late_ms)
    payload[11], payload[20], payload[21], payload[78] = (
        byte.get(name, usual) for name, usual in (("valid", 7), ("fix", 3), ("flags", 1), ("flags3", 0))
    )
    unit = 0.0111319  # m in 1e-7 deg of a great circle
    longitude = origin[1] + round(east / unit / math.cos(math.radians(origin[0] * 1e-7)))
    longitude = (longitude + 1_800_000_000) % 3_600_000_000 - 1_800_000_000
    struct.pack_into("<iiiiI", payload, 24, longitude, origin[0] + round((north + north_m) / unit), 0, 0, 800)
    velocity = round(1000 * speed * math.cos(course)), round(1000 * speed * math.sin(course)), 0
    degrees = round(math.degrees(course) % 360 * 1e5)
    struct.pack_into("<iiiiiI", payload, 48, *velocity, round(1000 * speed), degrees, 150)
    return frame(7, bytes(payload[:length]))


def samples() -> list[str]:
    """Lines of an IMU at 50 Hz whose axes are those of the recorder: right, up turned by 180 and -90 deg."""
    lines = []
    for i in range(FIXES * 50 // 4 + 50):
        _, _, speed, _ = walker(i / 50)
        inward, rate = speed**2 / 20 / 9.80665, math.degrees(speed / 20)
        lines.append(f"{-inward:.4f},0.0001,1.0000,0.01,0.02,{-rate:.3f},{5000 + 20 * i}")
    return lines


def fixes() -> list[bytes]:
    """The NAV-PVT of a whole walk."""
    return [pvt(k) for k in range(FIXES)]


def write_walk(
    folder: Path, stream: Sequence[bytes] | None = None, lines: Sequence[str] | None = None, pair: str = "<II"
) -> Path:
    """Write the folder of a recording.

    Args:
        stream: what the receiver sent for each fix.
        lines: what the IMU sent, the k-th 5 ms after the time k / 50 s.
        pair: of a time tag.
    """
    folder.mkdir(parents=True, exist_ok=True)
    chunks = fixes() if stream is None else stream
    csv = ["cut", *(samples() if lines is None else lines), "c"]
    texts = [line.encode(errors="surrogateescape") for line in csv]  # "\udcff" is the byte FF
    body = [text + b"\n" for text in texts[:-1]] + texts[-1:]
    _write(folder / "gnss.ubx", chunks, (k * PERIOD_MS + 50 for k in range(len(chunks))), pair)
    ticks = [_tick(text) for text in texts]
    _write(folder / "imu.csv", body, (max(ticks[: i + 1]) + 5 for i in range(len(ticks))), pair)
    return folder


def _tick(line: bytes) -> int:
    last = line.rpartition(b",")[2]
    return int(last) - 5000 if last.isdigit() else 0


def _write(path: Path, parts: Sequence[bytes], arrivals: Iterable[int], pair: str) -> None:
    path.write_bytes(b"".join(parts))
    started = 315_964_800 + 2300 * 604_800 + TOW_MS // 1000 - 1
    header = b"TIMETAG RTKLIB".ljust(64, b"\0") + struct.pack("<Id", started, 0.0)
    size, pairs = 0, b""
    for part, ms in zip(parts, arrivals, strict=True):
        size += len(part)
        pairs += struct.pack(pair, ms + 1000, size)
    path.with_name(path.name + ".tag").write_bytes(header + pairs)
