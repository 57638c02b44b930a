"""The drivers' bounds, headers and states, one by one: each has a mutant that only its test notices."""

from __future__ import annotations

import ctypes
import struct
from pathlib import Path

import pytest
from pyubx2 import calc_checksum

from harness.onboard import radio
from tests.codegen.firmware.onboard_drivers import (
    FRAME,
    GOOD,
    HEARTBEAT,
    MISSION,
    POSLLH,
    Driver,
    as_dict,
    library,
    mt_frame,
    posllh,
    pvt,
    sol,
    velned,
)
from tests.harness.onboard.frames import SESSION, encode, raw_frame, with_crc

U32 = 2**32 - 1


@pytest.fixture(scope="session")
def c(tmp_path_factory: pytest.TempPathFactory) -> ctypes.CDLL:
    """The drivers as a library."""
    return library(Path(tmp_path_factory.mktemp("bounds")))


@pytest.mark.parametrize(("name", "argument"), [("ubx", []), ("mt", [False]), ("link", [SESSION])])
def test_a_driver_begins_with_nothing_whatever_its_memory_held(
    c: ctypes.CDLL, name: str, argument: list[int]
) -> None:
    driver = Driver(c, name, *argument)
    states = []
    for byte in (0xFF, 0x00):
        ctypes.memset(ctypes.byref(driver.state), byte, ctypes.sizeof(driver.state))
        driver._call("init", *argument)
        states.append(bytes(driver.state))
    assert states[0] == states[1]


# scanner


@pytest.mark.parametrize(("held", "after"), [(0, (9, 0, 5)), (1, (10, 0, 6)), (7, (10, 6, 6))])
def test_to_abandon_a_frame_gives_up_one_byte_of_those_held(
    c: ctypes.CDLL, held: int, after: tuple[int, int, int]
) -> None:
    scanner = Driver(c, "ubx").state.scanner
    scanner.start, scanner.count, scanner.skipped = 9, held, 5
    c.scanner_abandon(ctypes.byref(scanner))
    assert (scanner.start, scanner.count, scanner.skipped) == after


# ubx


@pytest.mark.parametrize(
    ("cm_s", "mm_s"),
    [(390_451_573, 3_904_515_730), (429_496_729, 4_294_967_290), (429_496_730, U32)],  # 2^32 - 1 = 4294967295
)
def test_centimetres_become_millimetres_up_to_the_greatest_that_fits(
    c: ctypes.CDLL, cm_s: int, mm_s: int
) -> None:
    ubx = Driver(c, "ubx")
    assert list(ubx.receive(velned(1, speed=cm_s, s_acc=cm_s))) == [FRAME]
    epoch = as_dict(ubx.state.epoch)
    assert (epoch["speed"], epoch["s_acc"]) == (mm_s, mm_s)


def test_a_length_whose_high_byte_is_not_0_begins_no_frame(c: ctypes.CDLL) -> None:
    # given a POSLLH that says 28 + 256 bytes, and has 28
    body = bytes([1, POSLLH]) + struct.pack("<H", 28 + 256) + posllh(1)[6:-2]
    ubx = Driver(c, "ubx")
    # then it is none
    assert list(ubx.receive(b"\xb5\x62" + body + bytes(calc_checksum(body)))) == []
    assert ubx.state.scanner.frames == 0


def test_an_epoch_that_is_refused_is_refused_once(c: ctypes.CDLL) -> None:
    # given an epoch whose latitude is not on earth
    ubx = Driver(c, "ubx")
    assert list(ubx.receive(posllh(1, latitude=900_000_001) + velned(1) + sol(1))) == [FRAME] * 3
    assert ubx.state.refused == 1
    # when messages of it come again
    list(ubx.receive(velned(1) + sol(1)))
    # then it is no new one
    assert ubx.state.refused == 1


# mt


def damaged(place: int, value: int) -> bytes:
    """A sample with one byte of its header changed, and a checksum for it."""
    frame = bytearray(mt_frame(range(12), 7))
    frame[place] = value
    frame[-1] = -sum(frame[1:-1]) % 256
    return bytes(frame)


@pytest.mark.parametrize(("place", "value"), [(1, 0xFE), (2, 0x33), (3, 49), (3, 51)])
def test_another_address_message_or_length_is_no_sample(c: ctypes.CDLL, place: int, value: int) -> None:
    mt = Driver(c, "mt", False)
    assert list(mt.receive(damaged(place, value))) == []
    assert (mt.state.scanner.frames, mt.state.scanner.errors) == (0, 0)


def test_z_up_axes_change_the_signs_of_left_and_up(c: ctypes.CDLL) -> None:
    """Forward, left, up become forward, right, down; pitch is nose down, yaw counter-clockwise."""
    mt = Driver(c, "mt", True)
    assert list(mt.receive(mt_frame([1.0, 2.0, 3.0] * 4, 7))) == [True]
    sample = mt.sample
    for name in ("accel", "gyro", "mag"):
        assert sample[name] == [1.0, -2.0, -3.0]
    assert sample["roll"] > 0 > max(sample["pitch"], sample["heading"])


# link


@pytest.mark.parametrize(
    "last", [(90.0000001, 0.0), (-90.0000001, 0.0), (0.0, 180.0000001), (0.0, -180.0000001)]
)
@pytest.mark.parametrize("count", [1, 16])
def test_a_mission_whose_last_waypoint_is_not_on_earth_is_refused(
    c: ctypes.CDLL, last: tuple[float, float], count: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    # given a laptop that sends it
    monkeypatch.setattr(radio, "MAX_LATITUDE", 91.0)
    monkeypatch.setattr(radio, "MAX_LONGITUDE", 181.0)
    places = (*[radio.Position(32.0, -85.0)] * (count - 1), radio.Position(*last))
    link = Driver(c, "link", SESSION)
    assert list(link.receive(encode(radio.Mission(radio.Position(32.0, -85.0), places), 1))) == []
    assert (link.state.refused, link.state.mission.count) == (1, 0)


def test_a_mission_at_all_ends_of_the_earth_is_taken(c: ctypes.CDLL) -> None:
    ends = tuple(radio.Position(a, b) for a in (90.0, -90.0) for b in (180.0, -180.0))
    link = Driver(c, "link", SESSION)
    assert list(link.receive(encode(radio.Mission(ends[0], ends), 1))) == [MISSION]
    assert link.state.mission.count == 4


@pytest.mark.parametrize(("corners", "count"), [(0, 1), (0, 16), (3, 1), (3, 16), (7, 1), (7, 16)])
def test_a_mission_of_the_fewest_and_of_the_most_places_is_taken(
    c: ctypes.CDLL, corners: int, count: int
) -> None:
    # given corners at 1, 2, ... east, home at 10, and waypoints at 11, 12, ... [1e-7 deg]
    places = [*range(1, 1 + corners), 10, *range(11, 11 + count)]
    payload = struct.pack(">HB", 0xBEEF, corners) + b"".join(struct.pack(">ii", -5, east) for east in places)
    link = Driver(c, "link", SESSION)
    assert list(link.receive(raw_frame(MISSION, payload))) == [MISSION]
    # then each is where it belongs
    held = link.state.mission
    assert (held.id, held.corners, held.count) == (0xBEEF, corners, count)
    positions = [*held.fence[:corners], held.home, *held.waypoints[:count]]
    assert [(p.latitude, p.longitude) for p in positions] == [(-5, east) for east in places]


@pytest.mark.parametrize("length", range(244, 256))
def test_a_header_that_claims_more_than_the_longest_mission_begins_no_frame(
    c: ctypes.CDLL, length: int
) -> None:
    # given the bytes that such a frame would have modulo 256, 6 to 17, with a right CRC
    size = (8 + length + 10) % 256
    link = Driver(c, "link", SESSION)
    # when they come, then they are no frame, not even a damaged one
    assert list(link.receive(with_crc(bytes([4, length]) + bytes(size - 6)) + bytes(20))) == []
    scanner = link.state.scanner
    assert (scanner.frames, scanner.errors, scanner.skipped) == (0, 0, size + 20)


def test_a_silence_gives_up_a_frame_that_lost_its_end_and_finds_the_one_behind_it(c: ctypes.CDLL) -> None:
    # given the header of a MISSION of 138 bytes, and a HEARTBEAT that seems to be in it
    link = Driver(c, "link", SESSION)
    assert list(link.receive(b"\xa5\x5a\x01\x8a" + encode(radio.Heartbeat(7), 1))) == []
    # when the radio has been silent
    c.link_idle(ctypes.byref(link.state))
    # then the HEARTBEAT is found, and the header skipped
    assert list(link.receive_block(b"")) == [HEARTBEAT]
    assert (link.state.nonce, link.state.scanner.skipped, link.state.scanner.count) == (7, 4, 0)


def test_frames_of_all_drivers_are_taken(c: ctypes.CDLL) -> None:
    """What the tests above change is taken as it is."""
    assert list(Driver(c, "mt", False).receive(damaged(3, 50))) == [True]
    assert list(Driver(c, "ubx").receive(GOOD["ubx"][1] + pvt(2))) != []


# siphash


@pytest.mark.parametrize("key", [bytes(16), bytes(range(16)), b"\xff" * 16])
def test_siphash_begins_with_the_papers_words_and_with_no_byte_of_a_message(
    c: ctypes.CDLL, key: bytes
) -> None:
    state = ctypes.create_string_buffer(b"\xaa" * 64, 64)
    c.siphash_begin(state, key)
    # v0 to v3 of the paper's 2.1
    k0, k1 = struct.unpack("<2Q", key)
    constants = 0x736F6D6570736575, 0x646F72616E646F6D, 0x6C7967656E657261, 0x7465646279746573
    words = struct.pack("<4Q", *(a ^ k for a, k in zip(constants, (k0, k1, k0, k1), strict=True)))
    # then the bytes of the word to be filled and their number are 0; what follows the state is as before
    assert state.raw == words + bytes(16) + b"\xaa" * 16
