"""The onboard program for a host with the harness of tests/fuzz/fuzz_tick.c, and the orders that it obeys."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from codegen.blocks.block_c import write_files
from codegen.blocks.expressions import c_name
from codegen.firmware.bundle import BLOCKS, library
from codegen.firmware.telemetry import OFFSETS
from harness.onboard.processors import Processor, Received, Reply, open_processor
from harness.onboard.radio import HEADER
from harness.onboard.stand_in import Onboard
from models.commands import Command
from models.kit.declaration import Type, flatten

FUZZ = Path(__file__).resolve().parents[2] / "fuzz"
(RAW, NAV, FIX, SAMPLE, MESSAGE, MISSION, START, DAMAGE, BACKGROUND, TICK, TICKS, MOST, FORGED, REPLAY) = (
    range(14)
)
SAMPLES, FIXES, HEARTBEATS, PVT, OBEY = 1, 2, 4, 8, 16  # in the background
ALL = SAMPLES | FIXES | HEARTBEATS | OBEY
HOME = (326_000_000, -854_900_000)  # 1e-7 deg, where the harness's animal begins
SOURCES = ("gps", "imu", "radio")


def declared_c() -> str:
    """The function that holds all states and outputs against their declarations."""
    lines = ['#include "onboard.h"', "#include <assert.h>", "#include <math.h>",
             "void check_declared(const onboard *m);",
             "void check_declared(const onboard *m)", "{"]  # fmt: skip
    for member, block in BLOCKS.items():
        for kind, group in (("state", "state"), ("output", "out")):
            for name, variable in flatten(block.group(kind)):
                field = f"m->{member}.{group}.{c_name(name)}"
                if variable.type is Type.REAL:
                    lines.append(f"    assert(isfinite({field}));")
                if variable.type is not Type.BOOLEAN:
                    if variable.min is not None:
                        lines.append(f"    assert({field} >= {variable.min:.0f});")
                    if variable.max is not None:
                        lines.append(f"    assert({field} <= {variable.max:.0f});")
    return "\n".join([*lines, "}", ""])


def write_program(folder: Path, *, constants: bool = False) -> list[str]:
    """The library without its main, the harness and its checks, into a folder; the sources to compile."""
    files = library(constants=constants) | {
        "declared.c": declared_c(),
        "fuzz_tick.c": (FUZZ / "fuzz_tick.c").read_text(),
        "signed.h": (FUZZ / "signed.h").read_text(),
        "offsets.h": "".join(
            f"#define AT_{name.upper()} {HEADER.size + at}U\n" for name, at in OFFSETS.items()
        ),
    }
    del files["main.c"]
    write_files(files, folder)
    return sorted(name for name in files if name.endswith(".c"))


# --- orders ---


def raw(source: str, data: bytes) -> bytes:
    """Bytes as they are."""
    pieces = [data[i : i + 255] for i in range(0, len(data), 255)]
    return b"".join(bytes([RAW, SOURCES.index(source), len(piece)]) + piece for piece in pieces)


def fix(
    latitude: int,
    longitude: int,
    *,
    h_acc: int = 2000,
    speed: int = 0,
    course: int = 0,
    s_acc: int = 200,
    pvt: bool = True,
    go_on: bool = True,
) -> bytes:
    """A fix in the receiver's units, as one message or as three, from where the animal goes on."""
    style = (1 if pvt else 0) | (8 if go_on else 0)
    return bytes([FIX, style]) + struct.pack("<iiIIiI", latitude, longitude, h_acc, speed, course, s_acc)


def sample(accel: float, pitch_deg: float, yaw_deg: float) -> bytes:
    """Specific force and attitude of the inertial unit."""
    return bytes([SAMPLE]) + struct.pack("<3f", accel, pitch_deg, yaw_deg)


def message(type: int, payload: bytes = b"") -> bytes:
    """A message by radio."""
    return bytes([MESSAGE, type, len(payload)]) + payload


def forged(type: int, payload: bytes = b"") -> bytes:
    """A message by radio with a wrong tag."""
    return bytes([FORGED, type, len(payload)]) + payload


def mission(*offsets: tuple[int, int], fence: Sequence[tuple[int, int]] = ()) -> bytes:
    """Home, waypoints and fence by their offsets [1e-7 deg] from the animal."""
    places = b"".join(struct.pack("<hh", *offset) for offset in (*fence, *offsets))
    return bytes([MISSION, len(offsets) - 1, len(fence)]) + places


def background(what: int, heading_deg: float = 0.0, speed: float = 0.0) -> bytes:
    """What comes on its own, and how the animal walks unless it obeys."""
    return bytes([BACKGROUND, what, round(heading_deg / 360 * 256) % 256, round(speed * 10)])


def ticks(n: int) -> bytes:
    """So many ticks."""
    tens, ones = divmod(n, 10)
    most, rest = divmod(tens, 255)
    return bytes([TICKS, 255]) * most + (bytes([TICKS, rest]) if rest else b"") + bytes([TICK]) * ones


START_IT, ABORT, AGAIN = bytes([START]), message(4), bytes([REPLAY])
BEGUN = background(ALL) + ticks(10) + mission((0, 0), (2000, 0), (2000, 2000)) + ticks(5) + START_IT


def override(command: int) -> bytes:
    """The operator's own command."""
    return message(3, bytes([command]))


# --- a recorded trial ---


class Recorder:
    """A processor whose bytes are kept."""

    def __init__(self, processor: Processor) -> None:
        self.processor, self.image, self.start = processor, processor.image, processor.start
        self.received: list[Received] = []

    def tick(self, received: Received) -> Reply:
        """One tick."""
        self.received.append(received)
        return self.processor.tick(received)

    def stack(self) -> int | None:
        """Not known."""
        return self.processor.stack()

    def close(self) -> None:
        """Stop it."""
        self.processor.close()


def recorded_trial(seconds: float) -> list[Received]:
    """What the program receives while it leads an animal that obeys at once past two waypoints and home."""
    north = east = heading = speed = 0.0
    mission_ = {"waypoint_count": 2.0, "waypoint_north[1]": 15.0, "waypoint_east[1]": 0.0,
                "waypoint_north[2]": 15.0, "waypoint_east[2]": 15.0}  # fmt: skip
    recorder = Recorder(open_processor("host"))
    onboard = Onboard(recorder, (HOME[0] / 1e7, HOME[1] / 1e7), {"controller": mission_})
    try:
        for k in range(round(seconds / 0.04)):
            onboard.step(0.04 * k, dict(_signals(k, north, east, speed, heading)), {"start": 1.0})
            command = onboard.command
            speed = 2.0 if command in (Command.FORWARD, Command.RECALL) else 0.0
            turn = {Command.RIGHT: 0.04, Command.LEFT: -0.04}.get(command, 0.0)
            if command == Command.RECALL:  # home
                turn = math.remainder(math.atan2(-east, -north) - heading, 2 * math.pi)
            heading = math.remainder(heading + turn, 2 * math.pi)
            north += 0.04 * speed * math.cos(heading)
            east += 0.04 * speed * math.sin(heading)
    finally:
        onboard.close()
    return recorder.received


def _signals(k: int, north: float, east: float, speed: float, heading: float) -> Iterator[tuple[str, float]]:
    for name in ("accel", "gyro", "mag"):
        for axis in "xyz":
            yield f"{name}_{axis}", -9.81 if (name, axis) == ("accel", "z") else 0.0
    yield from {"roll_meas": 0.0, "pitch_meas": 1e-3 * (k % 2), "heading_meas": heading}.items()
    yield from {"gps_fix": float(k % 6 == 0), "gps_north": north, "gps_east": east, "gps_speed": speed,
                "gps_course": heading, "gps_h_acc": 2.0, "gps_s_acc": 0.2}.items()  # fmt: skip


def as_orders(received: Iterable[Received]) -> bytes:
    """A recorded trial as orders: each tick's bytes, then the tick."""
    return b"".join(
        b"".join(raw(source, getattr(r, source)) for source in SOURCES) + bytes([TICK]) for r in received
    )


# --- hard inputs ---

NAN, INF = math.nan, math.inf
EXTREMES: Mapping[str, bytes] = {
    "a mission done": BEGUN + ticks(2500) + ABORT + ticks(60) + START_IT + ticks(200),
    "overrides of every kind": BEGUN + b"".join(override(c) + ticks(40) for c in (1, 2, 3, 4, 5, 0, 6, 255)),
    "aborts behind beginnings of missions": BEGUN + b"".join(
        ticks(7) + raw("radio", b"\xa5\x5a\x01\x8a" * n) + ABORT + ticks(50) + START_IT for n in (1, 2, 27)
    ),
    "a stranger's orders and recorded ones": BEGUN + ticks(50) + ABORT + AGAIN + ticks(50) + b"".join(
        order + ticks(10)
        for order in (forged(1, bytes(18)), START_IT, AGAIN, forged(2, bytes(2)), forged(3, b"\4"),
                      override(4), AGAIN, forged(4), forged(5, bytes(4)), ABORT, AGAIN)
    ) + background(SAMPLES | FIXES | OBEY) + (forged(5, bytes(4)) + AGAIN + ticks(10)) * 20,
    "a lost link": BEGUN + ticks(100) + background(SAMPLES | FIXES | OBEY) + ticks(200)
    + background(ALL) + ticks(200),
    "an outage and what comes back elsewhere": BEGUN + ticks(100) + background(SAMPLES | HEARTBEATS, 90, 3.0)
    + ticks(500) + background(ALL, 90, 3.0) + ticks(200),
    "a silent inertial unit": BEGUN + ticks(100) + background(FIXES | HEARTBEATS | OBEY) + ticks(100)
    + background(ALL) + ticks(100),
    "long silence": BEGUN + ticks(50) + background(0) + ticks(5900),
    "an inertial unit alone at its limit": BEGUN + ticks(20) + background(HEARTBEATS)
    + b"".join(sample(199.9, 0.05 * (k % 2), 45.0) + ticks(1) for k in range(2500)),
    "a frozen inertial unit": BEGUN + ticks(50) + background(FIXES | HEARTBEATS | OBEY)
    + b"".join(sample(0.1, 0.0, 0.0) + ticks(1) for _ in range(40)) + background(ALL) + ticks(100),
    "a unit that is mounted the wrong way round": background(FIXES | HEARTBEATS, 180, 1.5)
    + b"".join(sample(0.1 * (k % 2), 0.0, 0.0) + ticks(1) for k in range(200)) + background(ALL, 180, 1.5)
    + ticks(200),
    "samples that are not numbers": BEGUN + background(FIXES | HEARTBEATS) + b"".join(
        sample(*values) + ticks(5)
        for values in ((NAN, 0, 0), (0, NAN, 0), (0, 0, NAN), (INF, 0, 0), (0, -INF, 0), (0, 0, INF),
                       (3.4e38, 3.4e38, 3.4e38), (-3.4e38, -3.4e38, -3.4e38), (1e-45, 1e-45, 1e-45),
                       (200, 229, 401), (-200, -229, -401), (-0.0, -0.0, -0.0), (200.01, 0, 0))
    ),
    **{
        f"fixes at {name}": background(SAMPLES | HEARTBEATS) + b"".join(
            fix(latitude, longitude, pvt=k % 2 == 0) + ticks(6) for k in range(4)
        ) + mission((0, 0), (-2000 if latitude > 0 else 2000, 0), (0, 4000)) + ticks(5) + START_IT
        + background(ALL, 90) + ticks(600)
        for name, latitude, longitude in (
            ("the north pole", 900_000_000, 0), ("the south pole", -900_000_000, 1_800_000_000),
            ("the date line", 0, 1_800_000_000), ("the date line from the west", 0, -1_800_000_000),
            ("nowhere", 0, 0), ("a corner", -900_000_000, -1_800_000_000),
        )
    },
    **{
        f"fixes from {a} to {b}": background(SAMPLES | HEARTBEATS) + b"".join(
            (fix(*(a, b)[k // 6 % 2], go_on=False) + ticks(6)) for k in range(60)
        )
        for a, b in (
            ((900_000_000, 1_800_000_000), (-900_000_000, -1_800_000_000)),
            ((0, 1_799_999_999), (0, -1_799_999_999)), ((0, 0), (0, -1_800_000_000)),
            ((0, 1_800_000_000), (0, 0)), ((0, 450_000_000), (0, -1_350_000_001)),
        )
    },
    "accuracies and speeds at limits": background(SAMPLES | HEARTBEATS) + b"".join(
        fix(*HOME, h_acc=h, speed=speed, s_acc=s, course=course) + ticks(6)
        for h in (0, 1, 2, 999_999, 1_000_000, 1_000_001, 2**32 - 1)
        for s in (0, 1, 100_000, 100_001, 2**32 - 1)
        for speed, course in ((0, 0), (49_999, 36_000_000), (50_001, -36_000_000), (515_000, 1), (2**31, 0))
        for _ in range(2)
    ),
    "far missions": background(ALL) + ticks(20) + b"".join(
        message(1, struct.pack(">HB4i", 7, 0, *home, *waypoint)) + ticks(3) + START_IT + ticks(30) + ABORT
        + ticks(50)
        for home in (HOME, (900_000_000, 1_800_000_000), (-900_000_000, -1_800_000_000))
        for waypoint in ((900_000_000, -1_800_000_000), (HOME[0], 945_100_000), (HOME[0], 945_099_999),
                         (HOME[0] + 8_990_000, HOME[1]), (-900_000_000, 0), (2**31 - 1, 0), (-(2**31), 0))
    ),
    "missions of all lengths": background(ALL)
    + ticks(20)
    + b"".join(
        mission((0, 0), *((2000, 2000 * (i % 2)) for i in range(n)))
        + ticks(n % 3 * 10)
        + START_IT
        + ticks(30)
        + ABORT
        + ticks(80)
        for n in range(18)
    ),
    "missions with a leg that is too short": background(ALL) + ticks(20) + b"".join(
        mission(*places) + ticks(5) + START_IT + ticks(30)
        for places in (((0, 0), (0, 0)), ((0, 0), (2000, 0), (2000, 0)), ((0, 0), (2000, 0), (2000, 700)))
    ),
    **{
        f"a fence of {len(fence)} corners": background(ALL) + ticks(10)
        + mission((0, 0), (2000, 0), (2000, 2000), fence=fence) + ticks(20) + START_IT + ticks(400)
        + background(SAMPLES | FIXES | HEARTBEATS, 200, 3.0) + ticks(800)
        for fence in (((-900, -900), (2900, -900), (2900, 2900)), ((-900, -900), (1000, -900), (1000, 900)),
                      ((-900, -900), (2900, -900), (2900, 2900), (1900, 2900), (1900, 700), (-900, 700)),
                      ((2500, 300), (2500, 2500), (1500, 2500), (1500, 500), (-300, 900), (-800, 0),
                       (-300, -900)))
    },
    "fences that are none": background(ALL) + ticks(10) + b"".join(
        mission((0, 0), (2000, 0), fence=[(900, 900)] * n) + ticks(12) + START_IT + ticks(20)
        for n in range(9)
    ),
    "missions, starts and aborts while one is under way": BEGUN + ticks(50) + b"".join(
        order + ticks(20) for order in (mission((0, 0), (0, 2000)), START_IT, override(4) + ABORT + START_IT,
                                        START_IT, mission((0, 0), (0, 3000)) + START_IT, ABORT + START_IT)
    ) + START_IT + ticks(100),
    "blocks of one byte": bytes([MOST, 0]) + BEGUN + ticks(300) + bytes([MOST, 9]) + ticks(300),
    "more bytes than a tick reads": background(ALL)
    + b"".join((raw(s, bytes([0xB5, 0xFA, 0xA5] * 85))) * 6 for s in SOURCES) + ticks(300),
}  # fmt: skip
