"""Bytes as they come to the onboard program, tick by tick, made without it: good, damaged, and none."""

from __future__ import annotations

import math
import random
import struct

from pyubx2 import GET, UBXMessage

from harness.onboard import radio
from harness.onboard.processors import Received
from models.commands import Command
from tests.harness.onboard.frames import answering, encode

LATITUDE, LONGITUDE = 32.6, -85.49  # deg, where the walk begins
DEGREE = 111_000.0  # m, about
HOME = radio.Position(LATITUDE, LONGITUDE)
MISSION = radio.Mission(
    HOME,
    (radio.Position(LATITUDE + 40 / DEGREE, LONGITUDE), radio.Position(LATITUDE + 40 / DEGREE, -85.4895)),
)
OPERATOR: dict[int, radio.Message] = {
    2: MISSION,
    4: radio.Start(MISSION.id ^ 1),  # of another mission
    5: radio.Start(MISSION.id),
    70: radio.Override(Command.RECALL),
    76: radio.Override(Command.NONE),
    110: radio.Abort(),
}


def mt_sample(accel: float, pitch: float, yaw: float, counter: int) -> bytes:
    """MTData: acceleration, turn rates, field, Euler angles [deg], counter."""
    values = (accel, 0.1, 9.81, 0.01, 0.02, -0.03, 0.4, 0.1, -0.8, 1.5, pitch, yaw)
    body = b"\xff\x32" + struct.pack(">B12fH", 50, *values, counter % 65536)
    return b"\xfa" + body + bytes([-sum(body) % 256])


def epoch(time_ms: int, north: float, speed: float, fix: int = 3) -> bytes:
    """POSLLH, VELNED and SOL of a receiver that goes north."""
    place = {"lat": LATITUDE + north / DEGREE, "lon": LONGITUDE, "hAcc": 2500}
    motion = {"gSpeed": round(100 * speed), "heading": 1.5, "sAcc": 20}
    messages = (
        UBXMessage("NAV", "NAV-POSLLH", GET, iTOW=time_ms, **place),
        UBXMessage("NAV", "NAV-VELNED", GET, iTOW=time_ms, **motion),
        UBXMessage("NAV", "NAV-SOL", GET, iTOW=time_ms, gpsFix=fix, gpsfixOK=1, numSV=8),
    )
    return b"".join(message.serialize() for message in messages)


def traffic(ticks: int, seed: int = 1) -> list[Received]:
    """What comes in so many ticks: an animal that stands, walks and runs, and everything that goes wrong.

    From tick 80 on bytes are damaged, NaN and infinity come from the inertial unit, and noise; from 120 on
    all is silent for 20 ticks, then good again.
    """
    draw = random.Random(seed)
    north, received = 0.0, []
    for k in range(ticks):
        speed = 0.0 if k < 20 else 1.2 if k < 50 else 3.0 + 0.05 * (k % 60)
        north += 0.04 * speed
        accel = 0.3 * math.sin(k / 7)
        if 80 <= k < 120 and k % 9 == 0:
            accel = draw.choice([math.nan, math.inf, -1e30, 1e-40])
        imu = mt_sample(accel, 3 * math.sin(k / 5), 180 * math.sin(k / 40), k)
        gps = epoch(200_000 + 40 * k, north, speed, fix=2 if 30 <= k < 35 else 3) if k % 6 == 0 else b""
        sent = OPERATOR.get(k, radio.Heartbeat(7) if k % 12 == 0 else None)
        link = encode(sent, answering(k)) if sent else b""
        if 80 <= k < 120:
            gps, imu, link = (spoil(data, draw) for data in (gps, imu, link))
        received.append(Received() if 120 <= k < 140 else Received(gps, imu, link))
    return received


def spoil(data: bytes, draw: random.Random) -> bytes:
    """The same, or with a byte changed, cut, or noise in front or behind."""
    kind = draw.randrange(6)
    if data and kind == 1:
        place = draw.randrange(len(data))
        return data[:place] + bytes([data[place] ^ 1 << draw.randrange(8)]) + data[place + 1 :]
    noise = draw.randbytes(draw.randrange(60))
    return {2: data[: len(data) // 2], 3: noise + data, 4: data + noise, 5: noise}.get(kind, data)
