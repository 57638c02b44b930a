"""A made-up walk of 60 s in turns, at a changing speed, and the bytes of instruments that record it."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
import numpy.typing as npt
from pyubx2 import GET, UBXMessage, calc_checksum

from harness.recording.recording import WEEK_S
from harness.recording.tags import GPS_EPOCH_S

Array = npt.NDArray[np.float64]

TOW = 415_800.0  # s, start in GPS week 2381
DURATION = 60.0  # s
LATITUDE, LONGITUDE, HEIGHT = 40.0, -105.0, 1580.0  # deg, deg, m
METRES = 111_035.0 + 27.6, 85_394.0 + 21.1  # of a degree of latitude and of longitude there
G = 9.80665

FINE = np.arange(0, DURATION + 1, 1e-3)
SPEED = 1.5 + 0.7 * np.sin(0.9 * FINE)
YAW_RATE = 0.1 + 0.5 * np.sin(0.7 * FINE)
HEADING = np.cumsum(YAW_RATE) * 1e-3
NORTH, EAST = np.cumsum(SPEED * np.cos(HEADING)) * 1e-3, np.cumsum(SPEED * np.sin(HEADING)) * 1e-3


def at(t: Array, quantity: Array) -> Array:
    return np.interp(t, FINE, quantity)


def force_and_rate(t: Array) -> tuple[Array, Array]:
    """Specific force [m/s2] and rate [rad/s] at times from the start, (n, 3) each: forward, right, down."""
    zeros = np.zeros(len(t))
    speed, yaw_rate = at(t, SPEED), at(t, YAW_RATE)
    force = np.column_stack([0.63 * np.cos(0.9 * t), speed * yaw_rate, zeros - G])
    return force, np.column_stack([zeros, zeros, yaw_rate])


def fix_times(every: float = 0.25) -> Array:
    return np.arange(every, DURATION, every)


def place(t: float) -> dict[str, float]:
    """Latitude and longitude [deg] at a time from the start."""
    return {
        "lat": LATITUDE + float(at(np.array([t]), NORTH)[0]) / METRES[0],
        "lon": LONGITUDE + float(at(np.array([t]), EAST)[0]) / METRES[1],
    }


def velocity(t: float) -> tuple[float, float]:
    """North and east [m/s] at a time from the start."""
    speed, heading = (float(at(np.array([t]), quantity)[0]) for quantity in (SPEED, HEADING))
    return speed * np.cos(heading), speed * np.sin(heading)


def pvt(t: float) -> bytes:
    """A NAV-PVT with the fix at a time from the start."""
    north, east = velocity(t)
    message = UBXMessage(
        "NAV", "NAV-PVT", GET, iTOW=round((TOW + t) * 1000), validTime=1, fixType=3, gnssFixOk=1, **place(t),
        height=round(HEIGHT * 1000), velN=round(north * 1000), velE=round(east * 1000), hAcc=1500, sAcc=150,
    )  # fmt: skip
    return bytes(message.serialize())


def frame(kind: bytes, payload: bytes) -> bytes:
    body = kind + struct.pack("<H", len(payload)) + payload
    return b"\xb5\x62" + body + bytes(calc_checksum(body))


def word(of_type: int, value: float) -> int:
    return of_type << 24 | round(value) & 0xFFFFFF


def words(force: Array, rate: Array) -> list[int]:
    """The six measurements of a sample, (3,) each, in the axes of the receiver's IMU."""
    return [
        *(word(kind, np.degrees(w) * 4096) for kind, w in zip((14, 13, 5), rate, strict=True)),
        *(word(kind, f * 1024) for kind, f in zip((16, 17, 18), force, strict=True)),
    ]


def esf_raw(samples: list[tuple[int, Array, Array]]) -> bytes:
    """One ESF-RAW with some samples: time tag, specific force and rate."""
    content = b"".join(
        struct.pack("<II", w, tag % 2**32) for tag, force, rate in samples for w in words(force, rate)
    )
    return frame(b"\x10\x03", bytes(4) + content)


def esf_meas(tag: int, force: Array, rate: Array) -> bytes:
    content = b"".join(struct.pack("<I", w) for w in words(force, rate))
    return frame(b"\x10\x02", struct.pack("<IHH", tag % 2**32, 6 << 11, 0) + content)


def stream(mounting: Array, tag_unit: float = 1 / 25_600, first_tag: int = 4_294_000_000) -> bytes:
    """A u-blox stream: fixes at 4 Hz, each 40 ms late, and 100 samples a second, ten in an ESF-RAW."""
    events = [(t + 0.04, pvt(float(t))) for t in fix_times()]
    times = np.arange(0, DURATION, 0.01)
    force, rate = force_and_rate(times)
    force, rate = force @ mounting, rate @ mounting  # into the axes of the IMU
    for i in range(0, len(times), 10):
        batch = [(first_tag + round(times[k] / tag_unit), force[k], rate[k]) for k in range(i, i + 10)]
        events.append((times[i + 9], esf_raw(batch)))
    return b"".join(message for _, message in sorted(events, key=lambda event: event[0]))


def mtdata(force: Array, rate: Array, counter: int) -> bytes:
    """One MTData of an Xsens MT, in its axes."""
    body = bytes([0xFF, 0x32, 50]) + struct.pack(
        ">12fH", *force, *rate, 0.5, 0.0, -0.5, 0.0, 0.0, 0.0, counter % 65536
    )
    return b"\xfa" + body + bytes([-sum(body) % 256])


def write_tag(path: Path, arrivals: list[tuple[float, int]]) -> None:
    """RTKLIB's time tag of a file: when its first bytes up to a position had arrived [s from the start]."""
    seconds = GPS_EPOCH_S + 2381 * WEEK_S + int(TOW)
    header = b"TIMETAG RTKLIB".ljust(60, b"\0") + struct.pack("<IId", 0, seconds, 0.0)
    pairs = b"".join(struct.pack("<II", round(t * 1000), size) for t, size in arrivals)
    path.with_name(path.name + ".tag").write_bytes(header + pairs)


def write_with_tag(path: Path, pieces: list[tuple[float, bytes]]) -> None:
    """Write pieces of a file, and its time tag."""
    path.write_bytes(b"".join(piece for _, piece in pieces))
    sizes = np.cumsum([len(piece) for _, piece in pieces])
    write_tag(path, [(t, int(size)) for (t, _), size in zip(pieces, sizes, strict=True)])


def write_ubx(folder: Path) -> None:
    write_with_tag(folder / "gnss.ubx", [(float(t) + 0.05, pvt(float(t))) for t in fix_times()])
