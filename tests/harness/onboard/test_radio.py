"""The laptop's side of the radio: frames by hand, messages that it refuses, telemetry from a damaged stream.

Vest and laptop read what the other sends: tests/codegen/firmware/test_onboard_drivers.py.
"""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from codegen.firmware.telemetry import PAYLOAD, Flag, Ready, Refusal, Telemetry
from harness.onboard.radio import (
    Abort,
    Decoder,
    Heartbeat,
    Mission,
    Override,
    Position,
    RadioError,
    Start,
    crc16,
    encode,
)
from models.commands import Command

HOME = Position(32.6, -85.49)
TOLD = Telemetry(
    time_ms=61_200, latitude=326_000_000, longitude=-854_900_000, speed=-35, heading=-31_415, position_sd=210,
    speed_sd=40, distance=253, deviation=1571, directional_commands=7, command=4, mode=3, status=1,
    waypoint=2, anomaly=0, last_anomaly=9, issues_left=65_535, vibration_left=240, tone_left=0,
    flags=Flag.VALID | Flag.STARTED,
    ready=Ready.LINK | Ready.FIRST_LEG, refusal=Refusal.OUT_OF_REACH, mission_id=0xBEEF, received=9,
    gps_frames=700, gps_errors=1, imu_frames=1530, imu_errors=0, link_errors=65_535,
)  # fmt: skip
BITS = {"B": (0, 255), "H": (0, 2**16 - 1), "I": (0, 2**32 - 1), "h": (-(2**15), 2**15 - 1)} | {
    "i": (-(2**31), 2**31 - 1)
}
telemetries = st.builds(
    lambda values: Telemetry(*values), st.tuples(*(st.integers(*BITS[code]) for code in PAYLOAD.format[1:]))
)


def test_crc16_of_the_check_string_is_the_catalogues() -> None:
    # CRC-16/CCITT-FALSE (also IBM-3740) of "123456789" is 0x29B1
    assert crc16(b"123456789") == 0x29B1


@pytest.mark.parametrize(
    ("message", "body"),
    [
        (Heartbeat(), "05 07 00"),
        (Abort(), "04 07 00"),
        (Override(Command.RECALL), "03 07 01 03"),
        (Start(0xBEEF), "02 07 02 be ef"),
        # the id is the CRC of what follows it;
        # 32.6 deg is 326000000 = 0x136e5d80, -85.49 deg is -854900000 = 0xcd0b42e0 in units of 1e-7 deg
        (Mission(HOME, (Position(0, 1e-7),)), "01 07 12 9183 136e5d80 cd0b42e0 00000000 00000001"),
    ],
)
def test_a_message_becomes_the_frame_of_the_layout(message: Heartbeat, body: str) -> None:
    frame = encode(message, 7)
    assert frame[:2] == b"\xa5\x5a"
    assert frame[2:-2] == bytes.fromhex(body)
    # a CRC behind its bytes leaves no remainder
    assert crc16(frame[2:]) == 0


def test_telemetry_frame_is_that_of_the_layout() -> None:
    frame = encode(TOLD, 300)  # number 44 modulo 256
    assert len(frame) == 64
    assert frame[:5] == bytes.fromhex("a55a 10 2c 39")
    assert frame[5:-2] == bytes.fromhex(
        "0000ef10 136e5d80 cd0b42e0 ffdd 8549 00d2 0028 00fd 0623 0007 04 03 01 02 00 09 ffff 00f0 0000 21"
        "00000101 08 beef 09 02bc 0001 05fa 0000 ffff"
    )


def test_greatest_mission_is_145_bytes_and_its_id_tells_it_from_others() -> None:
    mission = Mission(HOME, tuple(Position(32.6, -85.49 + k / 1e4) for k in range(16)))
    assert len(encode(mission, 0)) == 145
    assert encode(mission, 0)[5:7] == mission.id.to_bytes(2, "big")
    assert mission.id == crc16(encode(mission, 0)[7:-2])
    assert mission.id != replace(mission, waypoints=mission.waypoints[::-1]).id


@pytest.mark.parametrize("count", [0, 17])
def test_a_mission_without_or_with_too_many_waypoints_is_not_sent(count: int) -> None:
    with pytest.raises(RadioError, match=f"1 to 16 waypoints, got {count}"):
        encode(Mission(HOME, (HOME,) * count), 0)


@pytest.mark.parametrize(
    ("position", "message"),
    [
        (Position(90.1, 0), "latitude is 90.1, expected -90 to 90 deg"),
        (Position(0, -180.1), "longitude is -180.1, expected -180 to 180 deg"),
        (Position(math.nan, 0), "latitude is nan"),
    ],
)
def test_a_position_out_of_range_is_not_sent(position: Position, message: str) -> None:
    with pytest.raises(RadioError, match=message):
        encode(Mission(HOME, (position,)), 0)


@given(st.lists(st.one_of(telemetries, st.binary(max_size=60)), max_size=8), st.integers(1, 70))
def test_telemetry_is_found_among_other_bytes_in_any_blocks(
    pieces: list[Telemetry | bytes], block: int
) -> None:
    # given telemetry among bytes that may look like its beginning, ended by enough bytes to decide
    stream = b"".join(p if isinstance(p, bytes) else encode(p, 0) for p in pieces) + bytes(Decoder.SIZE)
    decoder = Decoder()
    # when it comes in blocks
    decoded = [t for i in range(0, len(stream), block) for t in decoder.receive(stream[i : i + block])]
    # then it is all there in order
    assert decoded == [p for p in pieces if isinstance(p, Telemetry)]
    assert decoder.frames == len(decoded)


def test_no_telemetry_with_one_bit_changed_is_taken_and_the_next_is_found() -> None:
    good = encode(TOLD, 1)
    for bit in range(8 * len(good)):
        damaged = bytearray(good)
        damaged[bit // 8] ^= 1 << bit % 8
        assert Decoder().receive(bytes(damaged) + good) == [TOLD]


def test_telemetry_cut_off_swallows_none_behind_it() -> None:
    good = encode(TOLD, 1)
    for length in range(len(good)):
        decoder = Decoder()
        assert decoder.receive(good[:length] + good + bytes(Decoder.SIZE)) == [TOLD]
        # 5 bytes show that a frame has begun; the bytes that fill it up make its CRC wrong
        assert decoder.errors == (length >= 5)


def test_telemetry_that_the_sequence_numbers_skip_is_counted_as_lost() -> None:
    decoder = Decoder()
    for sequence in (254, 255, 0, 3):
        decoder.receive(encode(TOLD, sequence))
    assert (decoder.frames, decoder.lost) == (4, 2)


def test_the_decoder_skips_frames_of_other_types() -> None:
    decoder = Decoder()
    assert decoder.receive(encode(Start(1), 0) + encode(Heartbeat(), 1) + encode(TOLD, 2)) == [TOLD]
    assert decoder.errors == 0


def test_the_decoder_holds_no_more_than_a_frame() -> None:
    decoder = Decoder()
    for _ in range(100):
        decoder.receive(b"\xa5\x5a\x10" * 100)
    assert len(decoder._held) < Decoder.SIZE
