"""A vest that runs a bundle's program, spoken to as by its instruments and its operator, in real time.

The animal stands still and looks at the one waypoint, 50 m to the east.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Iterator

from codegen.firmware.key import SIMULATION_KEY
from codegen.firmware.telemetry import Flag, Telemetry
from harness.log.geodesy import TangentPlane
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.operator import Operator
from harness.onboard.radio import Link, Mission, Position
from models.commands import Command
from models.kit.timing import TICK

LATITUDE, LONGITUDE = 32.6, -85.5  # deg
EAST = 50.0  # m from home to the waypoint
TICKS_PER_FIX = 6  # about 4 Hz

Send = Callable[[bytes], object]


def still(tick: int) -> dict[str, float]:
    """The sensors' signals: it looks to the east; gravity is what the accelerometer feels of standing.

    The unit lives: it never repeats itself.
    """
    signals = {f"{kind}_{axis}": 0.0 for kind in ("accel", "gyro", "mag") for axis in "xyz"}
    signals |= {"accel_z": -9.81, "roll_meas": 0.0, "heading_meas": math.pi / 2}
    signals |= {"pitch_meas": 1e-3 * (tick % 2)}
    signals |= {
        "gps_fix": float(tick % TICKS_PER_FIX == 0),
        "gps_north": 0.0,
        "gps_east": 0.0,
        "gps_speed": 0.0,
    }
    return signals | {"gps_course": 0.0, "gps_h_acc": 1.0, "gps_s_acc": 0.2}


def lead(
    gps: Send,
    imu: Send,
    radio: Send,
    heard: Callable[[], bytes],
    *,
    seconds: float,
    override: Callable[[], Command] = lambda: Command.NONE,
) -> Iterator[Telemetry]:
    """What the vest tells while it is to lead the animal, tick by tick, for so many seconds at most.

    Args:
        heard: gives what has come by radio.
        override: gives the operator's own command.
    """
    plane = TangentPlane(math.radians(LATITUDE), math.radians(LONGITUDE))
    receiver, unit = Receiver(plane), InertialUnit()
    waypoint = (math.degrees(x) for x in plane.from_plane(0.0, EAST))
    operator = Operator(Mission(Position(LATITUDE, LONGITUDE), (Position(*waypoint),)), Link(SIMULATION_KEY))
    began = time.monotonic()
    for tick in range(round(seconds / TICK)):
        signals = still(tick)
        gps(receiver.fix(tick * TICK, signals))
        imu(unit.sample(tick, signals))
        radio(operator.send(tick * TICK, True, override(), True))
        time.sleep(max(0.0, began + (tick + 1) * TICK - time.monotonic()))
        telemetry = operator.receive(heard())
        if telemetry is not None:
            yield telemetry


def lead_until_forward(gps: Send, imu: Send, radio: Send, *, heard: Callable[[], bytes]) -> list[Telemetry]:
    """What the vest tells until it has been leading for a second; the animal would be late after three."""
    reports: list[Telemetry] = []
    for telemetry in lead(gps, imu, radio, heard, seconds=30.0):
        reports.append(telemetry)
        if len(reports) >= 5 and telemetry.command == 1 and telemetry.imu_frames >= 25:
            return reports
    raise AssertionError(f"the animal is not led; the last of {len(reports)}: {reports[-1:]}")


def check_telemetry(reports: list[Telemetry]) -> None:
    """Of an animal that stands still at home and looks to the waypoint 50 m to the east."""
    last = reports[-1]
    assert (
        Flag(last.flags) == Flag.VALID | Flag.IMU_OK | Flag.LINK_OK | Flag.FIXED | Flag.LOADED | Flag.STARTED
    )
    assert abs(last.latitude - 326_000_000) <= 10  # 1e-7 deg: 0.1 m
    assert abs(last.longitude + 855_000_000) <= 10
    assert abs(last.heading - 15_708) <= 1  # 1e-4 rad: pi / 2
    assert abs(last.distance - 500) <= 2  # dm
    assert last.command == 1  # FORWARD
    assert last.gps_frames >= 9  # three a fix
    assert last.imu_frames >= 25
    # five a second, each up to 80 ms late; on a busy machine some are read together, of which the last counts
    between = [b.time_ms - a.time_ms for a, b in itertools.pairwise(reports)]
    assert all(ms >= 120 and ms % 40 == 0 for ms in between)
    assert min(between) <= 280
