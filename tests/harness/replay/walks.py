"""The files of a made-up recording: a walk in a circle of 20 m at 1.5 m/s, after four seconds of standing."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np
from pyubx2 import GET, UBXMessage

from harness.recording.tags import GPS_EPOCH_S

Files = dict[str, bytes]  # name -> content

TOW = 100_000.0  # s, GPS time of week of the first fix
RADIUS_M, SPEED_M_S, STANDS_S = 20.0, 1.5, 4.0
GRAVITY = 9.80665


def circle(t: float) -> tuple[float, float, float, float]:
    """North and east [m], speed [m/s] and course [rad] at `t` s after the first fix."""
    angle = max(0.0, t - STANDS_S) * SPEED_M_S / RADIUS_M
    north, east = RADIUS_M * np.sin(angle), RADIUS_M * (1 - np.cos(angle))
    return float(north), float(east), SPEED_M_S if t > STANDS_S else 0.0, angle


def fix(t: float) -> bytes:
    """The frame NAV-PVT of `t` s."""
    north, east, speed, course = circle(t)
    message = UBXMessage(
        "NAV", "NAV-PVT", GET, iTOW=round((TOW + t) * 1000), fixType=3, gnssFixOk=1, validDate=1, validTime=1,
        fullyResolved=1, numSV=12, lat=np.degrees(north / 6_378_137), lon=20 + np.degrees(east / 6_378_137),
        velN=round(1000 * speed * np.cos(course)), velE=round(1000 * speed * np.sin(course)),
        gSpeed=round(1000 * speed), hAcc=800, vAcc=1500, sAcc=150,
    )  # fmt: skip
    return bytes(message.serialize())


def sample(t: float, noise: np.random.Generator) -> bytes:
    """A line of the IMU at `t` s, in the axes of the rig: each is minus right, minus forward, minus down."""
    _, _, speed, _ = circle(t)
    force = np.array([-(speed**2) / RADIUS_M / GRAVITY, 0, 1]) + noise.normal(0, 0.003, 3)
    rate = np.array([0, 0, -np.degrees(speed / RADIUS_M)]) + noise.normal(0, 0.1, 3)
    numbers = ",".join(f"{value:.3f}" for value in (*force, *rate))
    return f"{numbers},{round(t * 1000) + 5000}\n".encode()


def tag(arrivals: list[float], parts: list[bytes]) -> bytes:
    """The time tag of a file whose parts arrived at some times [s after the first fix]."""
    seconds = GPS_EPOCH_S + 2300 * 604_800 + int(TOW) - 1
    header = b"TIMETAG RTKLIB".ljust(60, b"\0") + struct.pack("<IId", 0, seconds, 0.0)
    ends = np.cumsum([len(part) for part in parts])
    return header + b"".join(
        struct.pack("<II", round((at + 1) * 1000), end) for at, end in zip(arrivals, ends, strict=True)
    )


def files(seconds: float = 50.0) -> Files:
    """The four files of the walk: fixes at 4 Hz, samples at 50 Hz."""
    noise = np.random.default_rng(1)
    fixes, samples = np.arange(0, seconds, 0.25), np.arange(0, seconds + 1, 0.02)
    frames = [fix(t) for t in fixes]
    lines = [b"cut\n", *(sample(t, noise) for t in samples), b"c"]
    arrivals = [0.0, *(samples + 0.005), samples[-1] + 0.005]
    return {
        "gnss.ubx": b"".join(frames),
        "gnss.ubx.tag": tag(list(fixes + 0.05), frames),
        "imu.csv": b"".join(lines),
        "imu.csv.tag": tag(arrivals, lines),
    }


def write(folder: Path, content: Files) -> Path:
    """Write a recording's files."""
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in content.items():
        (folder / name).write_bytes(data)
    return folder
