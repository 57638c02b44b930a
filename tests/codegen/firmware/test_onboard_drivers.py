"""The parsers on board: captures against pyubx2, damaged and random bytes, and what the messages mean."""

from __future__ import annotations

import ctypes
import io
import math
import re
import struct
from collections.abc import Callable, Iterable
from functools import cache
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pyubx2 import UBX_PROTOCOL, UBXReader
from siphashc import siphash

from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.onboard import radio
from models.commands import Command
from tests.codegen.firmware.onboard_drivers import (
    ABORT,
    DATA,
    FENCE,
    FIX,
    FRAME,
    GOOD,
    HEARTBEAT,
    MESSAGES,
    MISSION,
    MISSION_16,
    MT_SAMPLE,
    OVERRIDE,
    POSLLH,
    PVT,
    SOL,
    START,
    STRUCTS,
    VELNED,
    VELNED_SAMPLE,
    Driver,
    as_dict,
    library,
    mt_frame,
    posllh,
    pvt,
    sol,
    ubx_frame,
    velned,
)
from tests.codegen.firmware.siphash_vectors import VECTORS
from tests.harness.onboard.frames import SESSION, encode, raw_frame, with_crc

SIZE = 212  # bytes; no frame is longer
U16, U32 = 2**16 - 1, 2**32 - 1
positions = st.builds(
    radio.Position,
    st.integers(-900_000_000, 900_000_000).map(lambda x: x / 1e7),
    st.integers(-1_800_000_000, 1_800_000_000).map(lambda x: x / 1e7),
)
missions = st.builds(
    radio.Mission,
    home=positions,
    waypoints=st.lists(positions, min_size=1, max_size=16).map(tuple),
    fence=st.sampled_from([(), FENCE[:3], FENCE]),
)
FRAMES = [pytest.param(name, frame, id=f"{name}-{i}") for name in GOOD for i, frame in enumerate(GOOD[name])]
each_driver = pytest.mark.parametrize("name", GOOD)


@pytest.fixture(scope="session")
def c(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The drivers as a library."""
    return library(tmp_path_factory.mktemp("onboard"))


@pytest.fixture(scope="session", params=[False, True], ids=["int of 4 bytes", "int of 2 bytes"])
def machine(
    request: pytest.FixtureRequest, c: ctypes.CDLL, tmp_path_factory: pytest.TempPathFactory
) -> ctypes.CDLL:
    """The drivers for this machine, and as for a small one."""
    return library(tmp_path_factory.mktemp("small"), small=True) if request.param else c


def driver(c: ctypes.CDLL, name: str) -> Driver:
    """A parser; the radio's holds the mission that GOOD starts."""
    first: dict[str, list[int]] = {"mt": [False], "link": [SESSION]}
    parser = Driver(c, name, *first.get(name, []))
    if name == "link":
        parser.state.mission.count, parser.state.mission.id = 16, MISSION_16.id
    return parser


@cache
def capture(path: str) -> bytes:
    if not (DATA / path).is_file():
        pytest.skip(f"no capture {path} in {DATA}; set CANINE_DATA to the folder of ubx_captures")
    return (DATA / path).read_bytes()


@cache
def messages_of_pyubx2(data: bytes) -> list[tuple[bytes, Any]]:
    """Frames and their meaning, of the kinds and lengths that are read on board."""
    sizes = {POSLLH: 28, SOL: 52, PVT: 92, VELNED: 36}  # no capture has a PVT of 84
    stream = UBXReader(io.BytesIO(data), protfilter=UBX_PROTOCOL, quitonerror=0)
    return [(raw, m) for raw, m in stream if raw[2] == 1 and len(raw) == sizes.get(raw[3], -1) + 8]


def frames_of_pyubx2(data: bytes) -> list[bytes]:
    return [raw for raw, _ in messages_of_pyubx2(data)]


def fixes(c: ctypes.CDLL, *frames: bytes) -> list[dict[str, Any]]:
    ubx = driver(c, "ubx")
    return [as_dict(ubx.state.fix) for event in ubx.receive(b"".join(frames)) if event == FIX]


def test_structs_of_the_drivers_have_the_compilers_sizes(c: ctypes.CDLL) -> None:
    sizes = (ctypes.c_size_t * len(STRUCTS)).in_dll(c, "SIZES")
    assert dict(zip(STRUCTS, sizes, strict=True)) == {n: ctypes.sizeof(s) for n, s in STRUCTS.items()}


# --- samples and captures ---


def test_sample_of_velned_is_read(c: ctypes.CDLL) -> None:
    # given the sample, of 1.12 m/s on 33.34 deg (0x01fcc807 = 33343495) +- 0.20 m/s by hand
    ubx = driver(c, "ubx")
    # when it comes
    assert list(ubx.receive(VELNED_SAMPLE)) == [FRAME]
    # then its speeds are in mm/s, and without position and solution there is no fix
    epoch = as_dict(ubx.state.epoch)
    assert (epoch["time_ms"], epoch["speed"], epoch["s_acc"], epoch["course"]) == (
        123_000,
        1120,
        200,
        33_343_495,
    )
    assert not ubx.state.fixed
    # and pyubx2 reads the same
    ((_, peer),) = UBXReader(io.BytesIO(VELNED_SAMPLE))
    assert (peer.gSpeed, peer.sAcc, round(peer.heading * 1e5)) == (112, 20, 33_343_495)


def test_sample_of_mt_in_z_down_axes_is_read_unchanged(c: ctypes.CDLL) -> None:
    mt = Driver(c, "mt", False)
    assert list(mt.receive(MT_SAMPLE)) == [True]
    values = struct.unpack(">12fH", MT_SAMPLE[4:-1])
    sample = mt.sample
    assert [*sample["accel"], *sample["gyro"], *sample["mag"]] == list(values[:9])
    assert sample["accel"] == [0.25, np.float32(-0.1), np.float32(9.81)]
    degrees = np.degrees([sample["roll"], sample["pitch"], sample["heading"]])
    np.testing.assert_allclose(degrees, [1.5, -2.0, 45.0], rtol=1.2e-7)  # two roundings of 2^-24
    assert mt.state.counter == 1234


def test_sample_of_mt_is_turned_from_z_up_axes(c: ctypes.CDLL) -> None:
    # given a unit at rest with z up, turned 45 deg counter-clockwise from north, its nose up (pitch -2 deg)
    mt = Driver(c, "mt", True)
    list(mt.receive(MT_SAMPLE))
    sample = mt.sample
    # then gravity's reaction points up, that is, against z down; left becomes minus right
    assert sample["accel"] == [0.25, np.float32(0.1), np.float32(-9.81)]
    assert sample["gyro"] == [np.float32(0.01), np.float32(0.02), np.float32(-0.03)]
    assert sample["mag"] == [np.float32(0.2), 0.0, np.float32(0.8)]
    assert math.degrees(sample["roll"]) == pytest.approx(1.5)
    assert math.degrees(sample["pitch"]) == pytest.approx(2.0)
    assert math.degrees(sample["heading"]) == pytest.approx(-45.0)


def test_mt_turns_nan_and_infinity_into_the_greatest_float(c: ctypes.CDLL) -> None:
    for z_up in (False, True):
        mt = Driver(c, "mt", z_up)
        list(
            mt.receive(mt_frame([math.nan, math.inf, -math.inf, *[0.0] * 6, math.nan, math.inf, math.nan], 0))
        )
        sample = mt.sample
        greatest = float(np.finfo(np.float32).max)
        assert sample["accel"] == [greatest] * 3
        # angles from degrees as all others: beyond every range of the estimator's, and finite
        for angle in (sample["roll"], sample["pitch"], sample["heading"]):
            assert angle == pytest.approx(math.radians(greatest))


@pytest.mark.parametrize(
    ("path", "count"),
    [
        ("ubx_captures/pygpsdata-MIXED.log", 108),
        ("ubx_captures/pygpsdata-SF-calibration.log", 0),
        ("walk_ublox_imu/gnss_1730.ubx", 536),
    ],
)
@pytest.mark.parametrize("block", [65535, 255, 7])
def test_captures_hold_the_frames_that_pyubx2_finds(
    c: ctypes.CDLL, path: str, count: int, block: int
) -> None:
    data = capture(path)
    expected = frames_of_pyubx2(data)
    assert len(expected) == count
    ubx = driver(c, "ubx")
    assert ubx.frames(data, block) == expected
    assert sum(map(len, expected)) + ubx.accounted == len(data)
    assert ubx.state.scanner.errors == 0


@pytest.mark.parametrize("path", ["ubx_captures/pygpsdata-MIXED.log", "walk_ublox_imu/gnss_1730.ubx"])
def test_captures_hold_the_fixes_that_pyubx2_reads(c: ctypes.CDLL, path: str) -> None:
    data = capture(path)
    expected = []
    for raw, m in messages_of_pyubx2(data):
        if m.identity == "NAV-PVT" and m.fixType in (3, 4) and m.gnssFixOk:
            expected.append({
                "time_ms": struct.unpack_from("<I", raw, 6)[0],  # pyubx2 makes a time of day of it
                "latitude": round(m.lat * 1e7), "longitude": round(m.lon * 1e7), "h_acc": m.hAcc,
                "speed": m.gSpeed, "course": round(m.headMot * 1e5), "s_acc": m.sAcc,
            })  # fmt: skip
    assert len(expected) in (39, 536)
    # each epoch's triple, where there is one, comes beside its PVT: one fix nevertheless
    assert fixes(c, data) == expected


def test_capture_gives_the_same_fix_by_three_messages_as_by_one(c: ctypes.CDLL) -> None:
    # given the epochs that were sent both ways
    frames = frames_of_pyubx2(capture("ubx_captures/pygpsdata-MIXED.log"))
    by_one = {fix["time_ms"]: fix for fix in fixes(c, *(f for f in frames if f[3] == PVT))}
    by_three = fixes(c, *(f for f in frames if f[3] != PVT))
    # then those with all three messages are fixes
    times = [
        {struct.unpack_from("<I", f, 6)[0] for f in frames if f[3] == kind} for kind in (POSLLH, SOL, VELNED)
    ]
    assert {fix["time_ms"] for fix in by_three} == set.intersection(*times)
    assert len(by_three) > 5
    # with the same values, but that VELNED counts in cm/s
    for fix in by_three:
        one = by_one[fix["time_ms"]]
        for name in ("latitude", "longitude", "h_acc", "course"):
            assert fix[name] == one[name]
        for name in ("speed", "s_acc"):
            assert abs(fix[name] - one[name]) < 10


# --- the stream: cut, damaged, foreign ---


def counted(driver: Driver) -> tuple[int, int, int, bytes]:
    """The state of a driver, without the place of the bytes in its scanner."""
    s = driver.state.scanner
    return s.frames, s.errors, s.skipped, bytes(driver.state)[ctypes.sizeof(s) :]


@each_driver
@settings(max_examples=100, deadline=None)
@given(data=st.data())
def test_a_stream_cut_into_any_blocks_gives_the_same_frames(
    c: ctypes.CDLL, name: str, data: st.DataObject
) -> None:
    # given good, damaged and foreign bytes; an ABORT is taken at once, out of another frame too
    good = [frame for frame in GOOD[name] if frame[2] != ABORT]
    pieces = st.one_of(
        st.sampled_from(good),
        st.sampled_from(good).flatmap(lambda f: st.integers(0, len(f)).map(lambda n: f[:n])),
        st.binary(max_size=9),
    )
    stream = b"".join(data.draw(st.lists(pieces, max_size=12)))
    whole, cut = driver(c, name), driver(c, name)
    # when they come at once and in blocks
    at_once = [(event, counted(whole)) for event in whole.receive(stream)]
    in_blocks = []
    start = 0
    while start < len(stream):
        size = data.draw(st.integers(1, 40))
        in_blocks += [(event, counted(cut)) for event in cut.receive_block(stream[start : start + size])]
        start += size
    # then they give the same frames, values and counts
    assert at_once == in_blocks
    assert whole.accounted == cut.accounted


@pytest.mark.parametrize(("name", "frame"), FRAMES)
def test_no_frame_with_one_bit_changed_is_taken_and_the_next_is_found(
    c: ctypes.CDLL, name: str, frame: bytes
) -> None:
    for good in GOOD[name]:
        for bit in range(8 * len(frame)):
            damaged = bytearray(frame)
            damaged[bit // 8] ^= 1 << bit % 8
            assert driver(c, name).frames(bytes(damaged) + good + bytes(SIZE)) == [good]


@pytest.mark.parametrize(("name", "frame"), FRAMES)
def test_a_frame_cut_off_swallows_no_frame_behind_it(c: ctypes.CDLL, name: str, frame: bytes) -> None:
    for good in GOOD[name]:
        for length in range(len(frame)):
            # however the stream goes on
            assert driver(c, name).frames(frame[:length] + good + bytes(SIZE)) == [good]
            # and when it does not, once it is given up
            silent = driver(c, name)
            frames = silent.frames(frame[:length] + good) + [silent.frame for _ in silent.idle()]
            assert frames == [good]


@each_driver
def test_repeated_beginnings_of_frames_hide_no_frame(c: ctypes.CDLL, name: str) -> None:
    for frame in GOOD[name]:
        for length in range(1, 7):
            parser = driver(c, name)
            stream = frame[:length] * 100 + frame + bytes(SIZE)
            assert parser.frames(stream, 13) == [frame]


def random_bytes(seed: int, count: int) -> bytes:
    return np.random.default_rng(seed).bytes(count)


@pytest.mark.parametrize(
    ("name", "expected_errors"),
    [
        # In 1e7 places a header stands by chance; its checksum is right in 1 of 65536 (mt: 256):
        ("ubx", 4e7 / 2**48),  # B5 62 01, one of four messages, its length 0: six bytes
        ("mt", 1e7 / 2**32),  # FA FF 32 32: four bytes
        ("link", 1e7 / 2**16 * 196 / 256),  # A5 5A, any type, 0 to 195: 117 headers, 0.002 frames
    ],
)
def test_ten_million_random_bytes_hold_no_frame(c: ctypes.CDLL, name: str, expected_errors: float) -> None:
    parser = driver(c, name)
    data = random_bytes(1, 10_000_000)
    assert parser.frames(data) == []
    assert abs(parser.state.scanner.errors - expected_errors) <= 5 * math.sqrt(expected_errors)
    assert parser.accounted == len(data)
    for good in GOOD[name]:
        assert good in parser.frames(good + bytes(SIZE))


@pytest.mark.parametrize(("name", "odds"), [("ubx", 2**16), ("mt", 2**8), ("link", 2**16)])
def test_random_bytes_behind_a_header_pass_as_often_as_the_checksum_lets_them(
    c: ctypes.CDLL, name: str, odds: int
) -> None:
    # given 50,000 headers with random bytes behind: false frames that only the checksum tells
    header = {
        "ubx": velned(0)[:6],
        "mt": MT_SAMPLE[:4],
        "link": encode(radio.Override(Command.NONE), 0)[:4],
    }
    rest = {"ubx": 38, "mt": 51, "link": 15}[name]
    noise = random_bytes(2, 50_000 * rest)
    stream = b"".join(header[name] + noise[i : i + rest] for i in range(0, len(noise), rest))
    parser = driver(c, name)
    # then no more of them pass than 50,000 / odds and five standard deviations: 266 for mt, 5 for the others
    parser.frames(stream)
    passed = parser.state.scanner.frames
    assert abs(passed - 50_000 / odds) <= 5 * math.sqrt(50_000 / odds)


@each_driver
def test_counters_stop_at_their_greatest_value(c: ctypes.CDLL, name: str) -> None:
    parser = driver(c, name)
    frame = GOOD[name][0]
    for counter in ("frames", "errors", "skipped"):
        setattr(parser.state.scanner, counter, U32 - 1)
    damaged = frame[:-1] + bytes([frame[-1] ^ 1])
    parser.frames((frame + damaged) * 3 + bytes(SIZE))
    scanner = parser.state.scanner
    assert (scanner.frames, scanner.errors, scanner.skipped) == (U32, U32, U32)


# --- epochs of the receiver ---

FIX_VALUES = {
    "latitude": 325_000_000, "longitude": -855_000_000, "h_acc": 2500,
    "speed": 1120, "course": 18_152_648, "s_acc": 200,
}  # fmt: skip


@pytest.mark.parametrize(
    "order", list(permutations((posllh, velned, sol))), ids=lambda o: "-".join(f.__name__ for f in o)
)
def test_three_messages_of_one_time_are_a_fix_in_any_order(c: ctypes.CDLL, order: Iterable[Any]) -> None:
    assert fixes(c, *(make(5000) for make in order)) == [{"time_ms": 5000, **FIX_VALUES}]


def test_a_solution_with_dead_reckoning_is_a_fix_as_in_pvt(c: ctypes.CDLL) -> None:
    assert fixes(c, posllh(5000), velned(5000), sol(5000, fix=4)) == [{"time_ms": 5000, **FIX_VALUES}]


def test_pvt_is_a_fix(c: ctypes.CDLL) -> None:
    assert fixes(c, pvt(5000), pvt(5250, fix=4), pvt(5500, length=84, flags3=1)) == [
        {"time_ms": t, **FIX_VALUES} for t in (5000, 5250, 5500)
    ]


@pytest.mark.parametrize(
    "frames",
    [
        pytest.param([posllh(0), velned(0)], id="no solution"),
        pytest.param([posllh(0), sol(0)], id="no velocity"),
        pytest.param([velned(0), sol(0), velned(0), sol(0)], id="no position"),
        pytest.param([posllh(0), velned(250), sol(0)], id="three times mixed"),
        pytest.param([posllh(0), velned(0), sol(250)], id="solution of the next time"),
        pytest.param([posllh(0), velned(0), sol(0, fix=2)], id="two-dimensional"),
        pytest.param([posllh(0), velned(0), sol(0, fix=1)], id="dead reckoning alone"),
        pytest.param([posllh(0), velned(0), sol(0, flags=0x0C)], id="not called good"),
        pytest.param([pvt(0, fix=2)], id="pvt two-dimensional"),
        pytest.param([pvt(0, fix=5)], id="pvt time only"),
        pytest.param([pvt(0, flags=0xFE)], id="pvt not called good"),
        pytest.param([pvt(0, valid=0xF5)], id="pvt with an invalid time"),
        pytest.param([pvt(0, flags3=1)], id="pvt with an invalid position"),
    ],
)
def test_an_epoch_that_is_incomplete_or_not_called_good_gives_no_fix(
    c: ctypes.CDLL, frames: list[bytes]
) -> None:
    ubx = driver(c, "ubx")
    assert set(ubx.receive(b"".join(frames))) == {FRAME}
    assert ubx.state.refused == 0
    # and the next epoch is not in its way
    assert list(ubx.receive(posllh(9000) + velned(9000) + sol(9000))) == [FRAME, FRAME, FIX]


def test_an_epoch_is_one_fix_when_sent_both_ways(c: ctypes.CDLL) -> None:
    three = [posllh(5000), velned(5000), sol(5000)]
    assert len(fixes(c, pvt(5000), *three)) == 1
    assert len(fixes(c, *three, pvt(5000), *three)) == 1
    assert len(fixes(c, *three[:2], pvt(5000), three[2], pvt(5250))) == 2


def test_the_epoch_at_the_beginning_of_the_week_is_a_fix(c: ctypes.CDLL) -> None:
    assert [fix["time_ms"] for fix in fixes(c, pvt(604_799_750), pvt(0), pvt(250))] == [604_799_750, 0, 250]
    assert len(fixes(c, posllh(0), velned(0), sol(0))) == 1


@pytest.mark.parametrize(
    "frames",
    [
        [posllh(0, latitude=900_000_001)],
        [posllh(0, latitude=-900_000_001)],
        [posllh(0, longitude=1_800_000_001)],
        [posllh(0, longitude=-1_800_000_001)],
        [posllh(0, h_acc=0)],
        [velned(0, s_acc=0)],
        [velned(0, course=36_000_001)],
        [velned(0, course=-36_000_001)],
        [velned(0, speed=51_501)],
        [velned(0, speed=429_496_730)],  # times 10 is 4 modulo 2^32
        [pvt(0, gSpeed=-1)],
        [pvt(0, lat=-(2**31))],
        [pvt(0, hAcc=0)],
        [pvt(0, sAcc=0)],
    ],
    ids=str,
)
def test_a_fix_with_a_value_out_of_range_is_refused_and_counted(c: ctypes.CDLL, frames: list[bytes]) -> None:
    ubx = driver(c, "ubx")
    kinds = {frame[3] for frame in frames}
    rest = [] if PVT in kinds else [f for f in (posllh(0), velned(0), sol(0)) if f[3] not in kinds]
    assert FIX not in list(ubx.receive(b"".join(frames + rest)))
    assert ubx.state.refused == 1
    assert not ubx.state.fixed
    ubx.state.refused = U32
    list(ubx.receive(pvt(250, hAcc=0)))
    assert ubx.state.refused == U32


def test_fixes_at_the_edges_of_the_ranges_are_taken(c: ctypes.CDLL) -> None:
    taken = fixes(
        c,
        pvt(1, lat=900_000_000, lon=1_800_000_000, hAcc=1, sAcc=1, gSpeed=515_000, headMot=36_000_000),
        pvt(2, lat=-900_000_000, lon=-1_800_000_000, hAcc=U32, sAcc=U32, gSpeed=0, headMot=-36_000_000),
        posllh(3), velned(3, speed=51_500, s_acc=U32), sol(3),
    )  # fmt: skip
    assert [fix["time_ms"] for fix in taken] == [1, 2, 3]
    assert (taken[2]["speed"], taken[2]["s_acc"]) == (515_000, U32)


def test_ubx_messages_of_another_length_or_class_are_skipped(c: ctypes.CDLL) -> None:
    ubx = driver(c, "ubx")
    other = posllh(0)[:2] + b"\x02" + posllh(0)[3:]
    assert (
        ubx.frames(ubx_frame(PVT, bytes(85)) + ubx_frame(0x03, bytes(16)) + ubx_frame(POSLLH, b"") + other)
        == []
    )
    assert ubx.state.scanner.errors == 0


# --- samples of the inertial unit ---


@pytest.mark.parametrize(
    ("counters", "lost"),
    [
        ([7, 8, 9], 0),
        ([7, 9], 1),
        ([65_534, 65_535, 0, 1], 0),
        ([65_534, 2], 3),
        ([7, 7 + 32_768], 32_767),
        ([500, 0, 1], 0),  # begun anew
    ],
)
def test_samples_that_the_counter_skips_are_counted_as_lost(
    c: ctypes.CDLL, counters: list[int], lost: int
) -> None:
    mt = Driver(c, "mt", False)
    frames = b"".join(mt_frame([0.0] * 12, counter) for counter in counters)
    assert list(mt.receive(frames)) == [True] * len(counters)
    assert mt.state.lost == lost


def test_a_sample_whose_counter_stands_still_is_not_taken_again(c: ctypes.CDLL) -> None:
    mt = Driver(c, "mt", False)
    frames = mt_frame([1.0] * 12, 7) + mt_frame([2.0] * 12, 7) + mt_frame([3.0] * 12, 8)
    assert [mt.sample["accel"][0] for _ in mt.receive(frames)] == [1.0, 3.0]
    assert mt.state.scanner.frames == 3


# --- the radio ---


def degrees_e7(position: radio.Position) -> tuple[int, int]:
    return round(position.latitude * 1e7), round(position.longitude * 1e7)


def position_of(c_position: Any) -> tuple[int, int]:
    return c_position.latitude, c_position.longitude


@settings(max_examples=100, deadline=None)
@given(mission=missions, counter=st.integers(1, 254))
def test_mission_arrives_whole_and_starts(c: ctypes.CDLL, mission: radio.Mission, counter: int) -> None:
    link = driver(c, "link")
    assert list(link.receive(encode(mission, counter))) == [MISSION]
    held = link.state.mission
    assert position_of(held.home) == degrees_e7(mission.home)
    assert (held.count, held.corners) == (len(mission.waypoints), len(mission.fence))
    assert [position_of(p) for p in held.fence[: held.corners]] == [degrees_e7(p) for p in mission.fence]
    assert [position_of(p) for p in held.waypoints[: held.count]] == [
        degrees_e7(p) for p in mission.waypoints
    ]
    assert (held.id, link.state.received) == (mission.id, counter)
    assert list(link.receive(encode(radio.Start(mission.id), counter + 1))) == [START]


def test_override_abort_and_heartbeat_arrive(c: ctypes.CDLL) -> None:
    link = driver(c, "link")
    for command in Command:
        assert list(link.receive(encode(radio.Override(command), 3 + command))) == [OVERRIDE]
        assert link.state.override == command
    assert list(link.receive(encode(radio.Abort(), 40) + encode(radio.Heartbeat(0xC0FFEE01), 50))) == [
        ABORT,
        HEARTBEAT,
    ]
    assert (link.state.received, link.state.nonce) == (50, 0xC0FFEE01)


HERE = struct.pack(">ii", 326_000_000, -854_900_000)


def raw_mission(corners: int, positions: bytes) -> bytes:
    """A MISSION of any number of corners and positions."""
    return raw_frame(MISSION, struct.pack(">HB", 7, corners) + positions)


@pytest.mark.parametrize(
    "message",
    [
        pytest.param(raw_frame(MISSION, b""), id="mission of nothing"),
        pytest.param(raw_frame(MISSION, b"\0\7"), id="mission of an id"),
        pytest.param(raw_mission(0, HERE), id="mission without a waypoint"),
        pytest.param(raw_mission(0, HERE * 3 + b"1234"), id="mission of half a waypoint"),
        pytest.param(raw_mission(0, HERE * 18), id="mission of 17 waypoints"),
        pytest.param(raw_mission(0, HERE * 16 + struct.pack(">ii", 900_000_001, 0)), id="latitude at last"),
        pytest.param(raw_mission(0, struct.pack(">ii", 0, 1_800_000_001) + HERE), id="longitude of home"),
        pytest.param(raw_mission(0, HERE + struct.pack(">ii", -(2**31), 0)), id="least latitude"),
        pytest.param(raw_mission(1, HERE * 9), id="fence of one corner"),
        pytest.param(raw_mission(2, HERE * 9), id="fence of two corners"),
        pytest.param(raw_mission(8, HERE * 12), id="fence of eight corners"),
        pytest.param(raw_mission(255, HERE * 24), id="fence of 255 corners"),
        pytest.param(raw_mission(3, HERE * 4), id="fence without a waypoint"),
        pytest.param(raw_mission(3, HERE * 21), id="fence and 17 waypoints"),
        pytest.param(
            raw_mission(3, struct.pack(">ii", 0, -1_800_000_001) + HERE * 5), id="longitude of a corner"
        ),
        pytest.param(raw_frame(START, struct.pack(">HB", MISSION_16.id, 0)), id="start too long"),
        pytest.param(raw_frame(OVERRIDE, b"\6"), id="unknown command"),
        pytest.param(raw_frame(OVERRIDE, b""), id="no command"),
        pytest.param(raw_frame(ABORT, b"\0"), id="abort too long"),
        pytest.param(raw_frame(HEARTBEAT, b"\0" * 5), id="heartbeat too long"),
        pytest.param(raw_frame(HEARTBEAT, b""), id="heartbeat without a nonce"),
    ],
)
def test_a_radio_message_with_a_wrong_value_is_only_counted(c: ctypes.CDLL, message: bytes) -> None:
    # given a mission held
    link = driver(c, "link")
    list(link.receive(encode(MISSION_16, 1)))
    before = bytes(link.state.mission), link.state.override, link.state.nonce
    # when it comes, then
    assert list(link.receive(message)) == []
    assert (bytes(link.state.mission), link.state.override, link.state.nonce) == before
    assert (link.state.refused, link.state.unknown) == (1, 0)
    # and it is not taken later
    assert (link.state.received, list(link.receive(message)), link.state.replayed) == (77, [], 1)
    link.state.refused, link.state.received = U32, 0
    list(link.receive(message))
    assert link.state.refused == U32


def test_a_start_tells_the_mission_that_it_asks_for(c: ctypes.CDLL) -> None:
    # given a vest without a mission, and one with another: whether it can begin is decided in onboard.c
    for link in (Driver(c, "link", SESSION), driver(c, "link")):
        assert list(link.receive(encode(radio.Start(0xBEEF), 3))) == [START]
        assert (link.state.asked, link.state.received, link.state.refused) == (0xBEEF, 3, 0)


def test_rule_9_no_mission_is_taken_while_it_is_locked(c: ctypes.CDLL) -> None:
    link = driver(c, "link")
    link.state.locked = True
    held = bytes(link.state.mission)
    assert list(link.receive(encode(MISSION_16, 1))) == []
    assert (bytes(link.state.mission), link.state.refused) == (held, 1)
    link.state.locked = False
    assert list(link.receive(encode(MISSION_16, 2))) == [MISSION]


def test_a_mission_that_is_too_long_is_not_taken_for_a_frame(c: ctypes.CDLL) -> None:
    link = Driver(c, "link", SESSION)
    assert list(link.receive(raw_frame(MISSION, HERE * 25) + raw_frame(ABORT, b""))) == [ABORT]
    assert link.state.mission.count == 0


def test_messages_of_unknown_types_are_counted(c: ctypes.CDLL) -> None:
    link = driver(c, "link")
    for counter, kind in enumerate((0, 6, 16, 255), start=1):
        assert list(link.receive(raw_frame(kind, b"any", counter))) == []
    assert (link.state.unknown, link.state.refused, link.state.received) == (4, 0, 4)
    # and a known one right behind is found in the same call
    assert list(link.receive(raw_frame(99, b"", 5) + raw_frame(ABORT, b"", 6))) == [ABORT]


@settings(max_examples=300, deadline=None)
@given(data=st.data())
def test_rule_10_an_abort_is_taken_with_its_last_byte_whatever_bytes_came_before(
    c: ctypes.CDLL, data: st.DataObject
) -> None:
    # given whole and cut frames, headers that claim any length, and noise
    headers = st.builds(lambda *values: b"\xa5\x5a" + bytes(values), *[st.integers(0, 255)] * 2)
    cut = st.sampled_from(GOOD["link"]).flatmap(lambda f: st.integers(0, len(f)).map(lambda n: f[:n]))
    pieces = st.one_of(headers, cut, st.sampled_from(GOOD["link"]), st.binary(max_size=9))
    before = b"".join(data.draw(st.lists(pieces, max_size=12)))
    stream = before + encode(radio.Abort(), data.draw(st.integers(205, 255)))
    # when they come in any blocks, an ABORT behind them
    link, events, start = driver(c, "link"), list[int](), 0
    while start < len(stream):
        size = data.draw(st.integers(1, 300))
        events = list(link.receive_block(stream[start : start + size]))
        start += size
    # then it is taken from the block in which it ends
    assert ABORT in events
    assert link.state.received == stream[-11]
    # and nothing of what came before is left
    assert link.state.scanner.count == 0


@pytest.mark.parametrize("block", [1, 7, 200])
def test_rule_10_an_abort_behind_any_part_of_a_mission_is_taken_at_once(c: ctypes.CDLL, block: int) -> None:
    mission, abort = encode(MISSION_16, 1), encode(radio.Abort(), 2)
    for length in range(len(mission)):
        link = driver(c, "link")
        # when more comes right behind it, then that is taken as well
        assert list(link.receive(mission[:length] + abort + encode(radio.Heartbeat(7), 3), block)) == [
            ABORT,
            HEARTBEAT,
        ]
        # and the bytes before it are counted as skipped
        assert link.accounted == length
        assert link.state.scanner.frames == 2


def test_rule_10_bytes_of_a_mission_that_look_like_an_abort_stop_nobody(c: ctypes.CDLL) -> None:
    # given a mission whose positions have the bytes of an ABORT without its tag
    looks = with_crc(bytes.fromhex("04 00 00000009") + bytes(8))
    mission = raw_mission(0, HERE[:4] + looks + b"\0\0" + HERE)
    # when it comes whole, then it is a mission
    assert list(driver(c, "link").receive(mission)) == [MISSION]
    # when a block ends behind those bytes, then they are forged, and the mission is lost
    end = mission.index(looks) + len(looks)
    link = driver(c, "link")
    assert list(link.receive_block(mission[:end])) == []
    assert list(link.receive_block(mission[end:])) == []
    assert link.state.forged == 1


def inside(looks: bytes) -> bytes | None:
    """Home and waypoints that hold these bytes, if all of them are on earth."""
    payload = HERE[:4] + looks + b"\0\0" + HERE
    positions = struct.unpack(f">{len(payload) // 4}i", payload)
    on_earth = max(map(abs, positions[::2])) <= 9e8 and max(map(abs, positions[1::2])) <= 18e8
    return payload if on_earth else None


@pytest.mark.parametrize(
    "looks",
    [
        pytest.param(lambda abort: b"\xa4" + abort[1:], id="first byte"),
        pytest.param(lambda abort: abort[:1] + b"\x5b" + abort[2:], id="second byte"),
        pytest.param(lambda abort: with_crc(b"\5" + abort[3:-2]), id="another message"),
        pytest.param(lambda abort: with_crc(abort[2:3] + b"\1" + abort[4:-2]), id="with a payload"),
        pytest.param(lambda abort: abort[:-1] + bytes([abort[-1] ^ 1]), id="wrong CRC"),
    ],
)
def test_rule_10_a_frame_that_waits_is_not_disturbed_by_what_is_no_abort(
    c: ctypes.CDLL, looks: Callable[[bytes], bytes]
) -> None:
    # given bytes inside a mission that differ from an ABORT in one place
    tried = (inside(looks(encode(radio.Abort(), counter))) for counter in range(78, 250))
    payload = next(filter(None, tried))
    mission = raw_mission(0, payload)
    # when it comes byte by byte
    link = driver(c, "link")
    # then it is taken as it is
    assert list(link.receive(mission, 1)) == [MISSION]
    assert link.state.scanner.skipped == 0


# --- rule 11: only the handler ---

STRANGER = radio.Seal(Key(bytes(range(1, 17))), SESSION)
OTHER_SESSION = radio.Seal(SIMULATION_KEY, SESSION + 1)


def judged(link: Driver) -> tuple[int, ...]:
    """Frames with a wrong CRC, with a wrong tag, and those that came before or too late."""
    state = link.state
    return state.scanner.errors, state.forged, state.replayed


def unchanged(link: Driver) -> tuple[Any, ...]:
    """What a message can change."""
    state = link.state
    return bytes(state.mission), state.asked, state.override, state.nonce, state.received


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
@pytest.mark.parametrize("seal", [STRANGER, OTHER_SESSION], ids=["stranger's", "other session's"])
def test_rule_11_a_frame_of_another_key_or_session_is_forged(
    c: ctypes.CDLL, message: radio.Message, seal: radio.Seal
) -> None:
    link = driver(c, "link")
    before = unchanged(link)
    assert list(link.receive(encode(message, 9, seal))) == []
    assert (unchanged(link), judged(link)) == (before, (0, 1, 0))
    # and the handler's own is taken
    assert len(list(link.receive(encode(message, 9)))) == 1


@pytest.mark.parametrize("message", MESSAGES, ids=lambda m: type(m).__name__)
def test_rule_11_a_frame_with_any_bit_changed_and_its_crc_made_right_is_forged(
    c: ctypes.CDLL, message: radio.Message
) -> None:
    frame = encode(message, 9)
    for bit in range(8 * 2, 8 * (len(frame) - 2)):
        body = bytearray(frame)
        body[bit // 8] ^= 1 << bit % 8
        link = driver(c, "link")
        before = unchanged(link)
        assert list(link.receive(with_crc(bytes(body[2:-2])))) == []
        assert unchanged(link) == before
        if bit // 8 != 3:  # the length: another frame, or none
            assert judged(link) == (0, 1, 0)


def test_rule_11_a_frame_with_a_part_of_its_tag_is_none(c: ctypes.CDLL) -> None:
    body = encode(radio.Abort(), 9)[2:-2]
    for length in range(8):
        link = driver(c, "link")
        assert list(link.receive(with_crc(body[: 6 + length]) + bytes(SIZE))) == []
        assert link.state.received == 0


def test_rule_11_a_frame_that_came_before_is_replayed(c: ctypes.CDLL) -> None:
    # given frames that were taken, in their order
    link = driver(c, "link")
    first, second = encode(radio.Override(Command.LEFT), 20), encode(radio.Override(Command.NONE), 21)
    assert list(link.receive(first + second)) == [OVERRIDE, OVERRIDE]
    # when they come again, in any order, or one that was held back
    for again in (first, second, encode(radio.Start(MISSION_16.id), 19)):
        assert list(link.receive(again)) == []
    # then none acts
    assert (link.state.override, link.state.received, judged(link)) == (0, 21, (0, 0, 3))


@pytest.mark.parametrize("told", [16, 1000, 2**24 - 2])
def test_rule_11_a_frame_that_was_held_back_is_too_old_but_an_abort_is_not(c: ctypes.CDLL, told: int) -> None:
    def answer(telemetry: int, message: radio.Message) -> bytes:
        return encode(message, (telemetry << 8) + 3)

    link = driver(c, "link")
    link.state.told = told
    # a frame answers one of the last sixteen telemetries
    assert list(link.receive(answer(told - 16, radio.Start(1)))) == []
    assert list(link.receive(answer(told + 1, radio.Start(1)))) == []
    assert judged(link) == (0, 0, 2)
    assert list(link.receive(answer(told - 15, radio.Start(1)))) == [START]
    assert list(link.receive(answer(told, radio.Start(1)))) == [START]
    # an ABORT may be older, but cannot come from the future, which would block all after it
    link.state.received = 0
    assert list(link.receive(answer(told - 16, radio.Abort()))) == [ABORT]
    assert list(link.receive(answer(told + 1, radio.Abort()))) == []
    assert judged(link) == (0, 0, 3)


def test_rule_11_counts_of_forged_and_replayed_frames_stop_at_their_greatest_value(c: ctypes.CDLL) -> None:
    link = driver(c, "link")
    link.state.forged = link.state.replayed = U32 - 1
    for _ in range(3):
        list(link.receive(encode(radio.Abort(), 9, STRANGER) + encode(radio.Abort(), 9)))
    assert (link.state.forged, link.state.replayed) == (U32, U32)


def test_rule_11_a_program_without_a_key_takes_any_tag_but_no_frame_twice(tmp_path: Path) -> None:
    link = Driver(library(tmp_path, None), "link", SESSION)
    frame = encode(radio.Heartbeat(7), 9, STRANGER)
    assert list(link.receive(frame)) == [HEARTBEAT]
    assert list(link.receive(frame)) == []
    assert judged(link) == (0, 0, 1)
    # and its telemetry has a tag of zeros, whatever its memory held
    written = ctypes.create_string_buffer(b"\xaa" * radio.Decoder.SIZE, radio.Decoder.SIZE)
    link.c.link_write_telemetry(ctypes.byref(link.state), written, ctypes.byref(STRUCTS["telemetry"]()))
    assert written.raw[-10:-2] == bytes(8)


# --- SipHash-2-4 ---


def siphash_of(c: ctypes.CDLL, key: bytes, *parts: bytes) -> bytes:
    """The tag of a message in parts, from memory that held something; no byte behind the tag is written."""
    state, tag = ctypes.create_string_buffer(b"\xaa" * 64, 64), ctypes.create_string_buffer(b"\xaa" * 16, 16)
    c.siphash_begin(state, key)
    for part in parts:
        c.siphash_take(state, part, len(part))
    c.siphash_end(state, tag)
    assert tag.raw[8:] == b"\xaa" * 8
    return tag.raw[:8]


def test_siphash_gives_the_papers_vectors(machine: ctypes.CDLL) -> None:
    # given the key 00 to 0f and the messages 00, 01, ... of 0 to 63 bytes
    key = bytes(range(16))
    assert len(VECTORS) == 64
    for length, expected in enumerate(VECTORS):
        # then, in one piece and in two, it is what the authors' program gives
        message = bytes(range(length))
        assert siphash_of(machine, key, message) == expected
        assert siphash_of(machine, key, message[: length // 3], message[length // 3 :]) == expected


@settings(max_examples=300, deadline=None)
@given(key=st.binary(min_size=16, max_size=16), message=st.binary(max_size=255))
def test_siphash_of_any_bytes_is_the_laptops(c: ctypes.CDLL, key: bytes, message: bytes) -> None:
    assert siphash_of(c, key, message) == siphash(key, message).to_bytes(8, "little")


def c_telemetry(telemetry: Telemetry) -> Any:
    """The struct of telemetry.h; in the place of `flags` it has a bool for each."""
    flags = Flag(telemetry.flags)
    bools = {str(flag.name).lower(): flag in flags for flag in Flag}
    return STRUCTS["telemetry"](**{n: v for n, v in vars(telemetry).items() if n != "flags"} | bools)


def limits(kind: str) -> tuple[int, int]:
    """The least and the greatest value of an integer of C, `uint16_t` say."""
    bits = int(re.sub(r"\D", "", kind))
    return (0, 2**bits - 1) if kind.startswith("u") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)


telemetries = st.fixed_dictionaries(
    {name: st.integers(*limits(field.type)) for name, field in FIELDS.items()}
    | {"flags": st.integers(0, sum(Flag))}
).map(lambda values: Telemetry(**values))


@settings(max_examples=200, deadline=None)
@given(telemetry=telemetries, counter=st.integers(1, U32))
def test_telemetry_of_the_vest_is_what_the_laptop_reads(
    machine: ctypes.CDLL, telemetry: Telemetry, counter: int
) -> None:
    link = Driver(machine, "link", telemetry.session)
    link.state.told = counter - 1
    frame = ctypes.create_string_buffer(radio.Decoder.SIZE)
    write = machine.link_write_telemetry
    write.restype = ctypes.c_uint8
    size = write(ctypes.byref(link.state), frame, ctypes.byref(c_telemetry(telemetry)))
    assert (size, link.state.told) == (radio.Decoder.SIZE, counter)
    assert radio.Decoder(SIMULATION_KEY).receive(frame.raw) == [(counter, telemetry)]
    assert frame.raw == encode(telemetry, counter, radio.Seal(SIMULATION_KEY, telemetry.session))
