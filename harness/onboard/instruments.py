"""The instruments on the vest: the sensors' signals as the bytes that the units send."""

from __future__ import annotations

import math
import struct
from collections.abc import Mapping
from dataclasses import dataclass

from harness.log.geodesy import TangentPlane

SensorValues = Mapping[str, float]  # the sensors' outputs by name, SI

WEEK_MS = 604_800_000  # after which the receiver's time of week begins anew
FIX_3D = 3
FIX = ("gps_north", "gps_east", "gps_speed", "gps_course", "gps_h_acc", "gps_s_acc")
GREATEST = 2e6  # m, m/s, rad: more does not fit the messages' 32 bits, and no receiver measures it
FLT_MAX = 3.4028234e38
SATELLITES = 9  # in the messages; the program does not read it
MT_PREAMBLE, MT_BUS, MT_DATA = 0xFA, 0xFF, 0x32
MT_VALUES = struct.Struct(">12fH")  # accel, gyro, mag, roll, pitch, yaw; sample counter
FIELD = 4.9e-5  # T: the field where the unit was calibrated, its unit of magnetic fields


@dataclass(frozen=True)
class Receiver:
    """A u-blox receiver: each fix as NAV-POSLLH, NAV-SOL and NAV-VELNED, or as one NAV-PVT.

    Attributes:
        plane: north = east = 0 of the sensors.
        pvt: a newer receiver's one message instead of the three.
    """

    plane: TangentPlane
    pvt: bool = False

    def fix(self, time: float, signals: SensorValues) -> bytes:
        """The receiver's messages on a tick; none without a fix.

        Args:
            time: s, of the tick.
            signals: `gps_fix gps_north gps_east gps_speed gps_course gps_h_acc gps_s_acc`.
        """
        if not (signals["gps_fix"] and all(abs(signals[name]) <= GREATEST for name in FIX)):
            return b""
        latitude, longitude = self.plane.place(signals["gps_north"], signals["gps_east"])
        # whole units, since pyubx2 truncates
        latitude, longitude = round(latitude * 1e7) / 1e7, round(longitude * 1e7) / 1e7
        when, course = round(time * 1000) % WEEK_MS, math.degrees(signals["gps_course"]) % 360
        speed, s_acc = max(signals["gps_speed"], 0.0), signals["gps_s_acc"]  # over ground: never negative
        h_acc = max(round(signals["gps_h_acc"] * 1000), 1)  # no receiver states an accuracy of 0
        if self.pvt:
            fields = {
                "fixType": FIX_3D,
                "gnssFixOk": 1,
                "validTime": 1,
                "numSV": SATELLITES,
                "lat": latitude,
                "lon": longitude,
            }
            fields |= {"hAcc": h_acc, "gSpeed": round(speed * 1000), "headMot": course}
            return _ubx("PVT", when, fields | {"sAcc": max(round(s_acc * 1000), 1)})
        return (
            _ubx("POSLLH", when, {"lat": latitude, "lon": longitude, "hAcc": h_acc})
            + _ubx("SOL", when, {"gpsFix": FIX_3D, "gpsfixOK": 1, "numSV": SATELLITES})
            + _ubx(
                "VELNED",
                when,
                {"gSpeed": round(speed * 100), "heading": course, "sAcc": max(round(s_acc * 100), 1)},
            )
        )


def _ubx(name: str, time_ms: int, fields: Mapping[str, float]) -> bytes:
    from pyubx2 import GET, UBXMessage  # noqa: PLC0415 - 0.1 s that only runs on board need

    message: bytes = UBXMessage("NAV", f"NAV-{name}", GET, iTOW=time_ms, **fields).serialize()
    return message


@dataclass(frozen=True)
class InertialUnit:
    """An Xsens MT in output mode 0x0006: one MTData message for each sample.

    Attributes:
        z_up: its axes are forward, left, up (its factory setting), or forward, right, down.
    """

    z_up: bool = True

    def sample(self, tick: int, signals: SensorValues) -> bytes:
        """The unit's message with the sample of a tick.

        Args:
            signals: `accel_x .. gyro_z mag_x .. mag_z roll_meas pitch_meas heading_meas`.
        """
        side = -1.0 if self.z_up else 1.0
        vectors = [
            sign * signals[f"{name}_{axis}"] / unit
            for name, unit in (("accel", 1.0), ("gyro", 1.0), ("mag", FIELD))
            for axis, sign in (("x", 1.0), ("y", side), ("z", side))
        ]
        angles = [
            math.degrees(signals["roll_meas"]),
            side * math.degrees(signals["pitch_meas"]),
            side * math.degrees(signals["heading_meas"]),
        ]
        values = [min(max(value, -FLT_MAX), FLT_MAX) for value in (*vectors, *angles)]
        payload = MT_VALUES.pack(*values, tick % 65536)
        body = bytes([MT_BUS, MT_DATA, len(payload)]) + payload
        return bytes([MT_PREAMBLE]) + body + bytes([-sum(body) % 256])
