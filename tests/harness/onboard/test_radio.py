"""The laptop's side of the radio: frames by hand, messages that it refuses, telemetry from a damaged stream.

Vest and laptop read what the other sends: tests/codegen/firmware/test_onboard_drivers.py.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import count

import pytest
from hypothesis import given
from hypothesis import strategies as st
from siphashc import siphash

from codegen.firmware.key import SIMULATION_KEY, Key
from codegen.firmware.telemetry import PAYLOAD, Flag, Ready, Refusal, Telemetry
from harness.onboard import radio
from harness.onboard.radio import (
    Abort,
    Decoder,
    Heartbeat,
    Link,
    Mission,
    Override,
    Position,
    RadioError,
    Seal,
    Start,
    crc16,
    draw_nonce,
)
from models.commands import Command
from tests.harness.onboard.frames import with_crc

KEY = SIMULATION_KEY

HOME = Position(32.6, -85.49)
TOLD = Telemetry(
    time_ms=61_200, latitude=326_000_000, longitude=-854_900_000, speed=-35, heading=-31_415, position_sd=210,
    speed_sd=40, distance=253, deviation=1571, directional_commands=7, command=4, mode=3, status=1,
    waypoint=2, anomaly=0, last_anomaly=9, issues_left=65_535, vibration_left=240, tone_left=0,
    flags=Flag.VALID | Flag.STARTED,
    ready=Ready.LINK | Ready.FIRST_LEG, refusal=Refusal.OUT_OF_REACH, mission_id=0xBEEF,
    session=0xC0FFEE01, received=0x00012A07, nonce=0x1234567,
    gps_frames=700, gps_errors=1, imu_frames=1530, imu_errors=0, link_errors=65_535,
    link_forged=2, link_replayed=515,
    rejected_fixes=300, jumps=4, recoveries=255, battery=3712, temperature=-57,
)  # fmt: skip
BITS = {"B": (0, 255), "H": (0, 2**16 - 1), "I": (0, 2**32 - 1), "h": (-(2**15), 2**15 - 1)} | {
    "i": (-(2**31), 2**31 - 1)
}
telemetries = st.builds(
    lambda values: Telemetry(*values), st.tuples(*(st.integers(*BITS[code]) for code in PAYLOAD.format[1:]))
)


def encode(message: radio.Message | Telemetry, counter: int, seal: Seal | None = None) -> bytes:
    """The message as a frame, telemetry in the session that it tells."""
    return radio.encode(message, counter, seal or Seal(KEY, getattr(message, "session", 1)))


def test_crc16_of_the_check_string_is_the_catalogues() -> None:
    # CRC-16/CCITT-FALSE (also IBM-3740) of "123456789" is 0x29B1
    assert crc16(b"123456789") == 0x29B1


@pytest.mark.parametrize(
    ("message", "signed"),
    [
        (Heartbeat(0xC0FFEE), "05 04 00000107 00c0ffee"),
        (Abort(), "04 00 00000107"),
        (Override(Command.RECALL), "03 01 00000107 03"),
        (Start(0xBEEF), "02 02 00000107 be ef"),
        # the id is the CRC of what follows it;
        # 32.6 deg is 326000000 = 0x136e5d80, -85.49 deg is -854900000 = 0xcd0b42e0 in units of 1e-7 deg
        (
            Mission(HOME, (Position(0, 1e-7),)),
            "01 13 00000107 3c65 00 136e5d80 cd0b42e0 00000000 00000001",
        ),
    ],
)
def test_a_message_becomes_the_frame_of_the_layout(message: Heartbeat, signed: str) -> None:
    frame = encode(message, 0x107, Seal(KEY, 0x51))
    assert frame[:2] == b"\xa5\x5a"
    assert frame[2:-10] == bytes.fromhex(signed)
    # the tag is over what stands before it, and the session
    tag = siphash(KEY.data, bytes.fromhex(signed + "00000051"))
    assert frame[-10:-2] == tag.to_bytes(8, "little")
    # a CRC behind its bytes leaves no remainder
    assert crc16(frame[2:]) == 0


def test_telemetry_frame_is_that_of_the_layout() -> None:
    frame = encode(TOLD, 300)
    assert len(frame) == 98
    assert frame[:8] == bytes.fromhex("a55a 10 50 0000012c")
    assert frame[8:-10] == bytes.fromhex(
        "0000ef10 136e5d80 cd0b42e0 ffdd 8549 00d2 0028 00fd 0623 0007 04 03 01 02 00 09 ffff 00f0 0000 21"
        "00000101 08 beef c0ffee01 00012a07 01234567 02bc 0001 05fa 0000 ffff 0002 0203 012c 04 ff 0e80 ffc7"
    )


FENCE = (Position(32.5, -85.5), Position(32.7, -85.5), Position(32.7, -85.3), Position(32.5, -85.3))


def test_greatest_mission_is_213_bytes_and_its_id_tells_it_from_others() -> None:
    seven = (*FENCE[:3], *(Position(32.6 - k / 1e3, -85.3 - k / 1e4) for k in range(4)))
    mission = Mission(HOME, tuple(Position(32.6, -85.49 + k / 1e4) for k in range(16)), seven)
    frame = encode(mission, 0)
    assert len(frame) == 213
    assert frame[8:10] == mission.id.to_bytes(2, "big")
    assert mission.id == crc16(frame[10:-10])
    assert mission.id != replace(mission, waypoints=mission.waypoints[::-1]).id
    # a corner is not a waypoint
    assert len({replace(mission, fence=()).id, mission.id, replace(mission, fence=seven[:6]).id}) == 3


def test_a_fence_is_sent_before_home_and_waypoints() -> None:
    frame = encode(Mission(HOME, (Position(32.6, -85.4),), FENCE), 0)
    assert frame[3] == 3 + 8 * 6
    assert frame[10] == 4
    positions = [frame[i : i + 8] for i in range(11, 11 + 48, 8)]
    assert positions == [place.payload() for place in (*FENCE, HOME, Position(32.6, -85.4))]


@pytest.mark.parametrize(
    ("fence", "fault"),
    [
        (FENCE[:2], "it has 2 corners, expected 3 to 7"),
        (FENCE * 2, "it has 8 corners, expected 3 to 7"),
        ((FENCE[0], FENCE[2], FENCE[1], FENCE[3]),
         "its edges from corner 1 and from corner 3 cross or touch"),
        # as sent two corners are one
        ((*FENCE, Position(32.5, -85.30000001)), "its edges from corner 3 and from corner 4 cross or touch"),
        ((HOME, HOME, HOME), "its corners lie on one line, so its area is 0"),
    ],
)  # fmt: skip
def test_rule_7_a_fence_that_is_no_polygon_is_not_sent(fence: tuple[Position, ...], fault: str) -> None:
    with pytest.raises(RadioError, match=f"the fence of a mission is no polygon: {fault}"):
        encode(Mission(HOME, (Position(32.6, -85.4),), fence), 0)


def test_rule_7_a_fence_across_the_date_line_is_a_polygon() -> None:
    corners = [(0.1, 179.9), (0.1, -179.9), (-0.1, -179.9), (-0.1, 179.9)]
    across = tuple(Position(*corner) for corner in corners)
    assert encode(Mission(Position(0, 180), (Position(0, 179.95),), across), 0)
    crossed = Mission(Position(0, 180), (Position(0, 179.95),), (across[0], across[2], *across[1::2]))
    with pytest.raises(RadioError, match="cross or touch"):
        encode(crossed, 0)


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
    decoder = Decoder(KEY)
    # when it comes in blocks
    decoded = [t for i in range(0, len(stream), block) for _, t in decoder.receive(stream[i : i + block])]
    # then it is all there in order
    assert decoded == [p for p in pieces if isinstance(p, Telemetry)]
    assert decoder.frames == len(decoded)


def test_no_telemetry_with_one_bit_changed_is_taken_and_the_next_is_found() -> None:
    good = encode(TOLD, 1)
    for bit in range(8 * len(good)):
        damaged = bytearray(good)
        damaged[bit // 8] ^= 1 << bit % 8
        decoder = Decoder(KEY)
        assert decoder.receive(bytes(damaged) + good) == [(1, TOLD)]
        assert decoder.forged == 0


def test_telemetry_cut_off_swallows_none_behind_it() -> None:
    good = encode(TOLD, 1)
    for length in range(len(good)):
        decoder = Decoder(KEY)
        assert decoder.receive(good[:length] + good + bytes(Decoder.SIZE)) == [(1, TOLD)]
        # 4 bytes show that a frame has begun; the bytes that fill it up make its CRC wrong
        assert decoder.errors == (length >= 4)


def test_the_decoder_skips_frames_of_other_types() -> None:
    decoder = Decoder(KEY)
    assert decoder.receive(encode(Start(1), 0) + encode(Heartbeat(1), 1) + encode(TOLD, 2)) == [(2, TOLD)]
    assert (decoder.errors, decoder.forged) == (0, 0)


def test_the_decoder_holds_no_more_than_a_frame() -> None:
    decoder = Decoder(KEY)
    for _ in range(100):
        decoder.receive(b"\xa5\x5a\x10" * 100)
    assert len(decoder._held) < Decoder.SIZE


# --- rule 11: only the handler, and only its vest ---


def test_rule_11_telemetry_of_another_key_or_with_any_bit_changed_is_forged() -> None:
    # given a frame of a stranger's, and the vest's with a bit changed and its CRC made right
    strangers = radio.encode(TOLD, 1, Seal(Key(b"a stranger's key"), TOLD.session))
    body = encode(TOLD, 1)[2:-2]
    changed = [
        with_crc(bytes(x ^ (1 << bit % 8) * (i == bit // 8) for i, x in enumerate(body)))
        for bit in range(16, 8 * len(body))  # behind type and length
    ]
    for frame in (strangers, *changed):
        decoder = Decoder(KEY)
        assert decoder.receive(frame) == []
        assert (decoder.frames, decoder.errors, decoder.forged) == (0, 0, 1)


def test_rule_11_a_laptop_without_a_key_takes_any_tag() -> None:
    assert Decoder(None).receive(encode(TOLD, 1)) == [(1, TOLD)]
    assert Seal(None, 1).tag(b"any") == bytes(8)


def told(counter: int, session: int = 1, nonce: int = 1, **values: int) -> bytes:
    """Telemetry as a frame."""
    told = replace(TOLD, session=session, nonce=nonce, **values)
    return radio.encode(told, counter, Seal(KEY, session))


def new_link() -> Link:
    """A laptop's end, whose nonces are 1, 2 and so on."""
    return Link(KEY, count(1).__next__)


def test_rule_11_the_laptop_believes_telemetry_that_returns_its_nonce_and_is_new() -> None:
    link = new_link()
    # given telemetry that does not answer
    assert link.receive(told(5, nonce=77)) == []
    assert (link.open, link.nonce, link.unanswered) == (True, 1, 1)
    # when it does, then it is believed, once; lost ones are counted
    frame = told(8)
    assert [t.nonce for t in link.receive(frame)] == [1]
    assert link.receive(frame + told(7)) == []
    assert (link.replayed, link.lost, link.sessions) == (2, 2, 1)
    # and all frames are signed for that session, with counters that answer
    first, second = link.encode(Abort()), link.encode(Abort())
    assert first == radio.encode(Abort(), 8 << 8, Seal(KEY, 1))
    assert second == radio.encode(Abort(), (8 << 8) + 1, Seal(KEY, 1))


def test_rule_11_recorded_telemetry_is_not_believed_and_is_told() -> None:
    # given a session that a stranger has recorded, and the vest's present one
    recorded = [told(k, session=1) for k in range(1, 20)]
    link = new_link()
    link.receive(recorded[0])
    assert link.receive(recorded[1])
    link.receive(told(1, session=2, nonce=0))
    assert link.nonce == 2
    assert link.receive(told(2, session=2, nonce=2))
    # when the recording is played, or a session of an earlier laptop, whose nonce was another
    for frames in (recorded[2:], [told(k, session=9, nonce=4_000_000) for k in range(1, 20)]):
        # then nothing is believed, and it shows
        sessions, unanswered = link.sessions, link.unanswered
        assert [link.receive(frame) for frame in frames] == [[]] * len(frames)
        assert (link.sessions, link.unanswered) == (sessions + 1, unanswered + len(frames))
    # and the frames that the laptop answers with are for that session, in which no vest is
    assert link.encode(Abort()) == radio.encode(Abort(), 19 << 8, Seal(KEY, 9))
    # and the vest is found again
    link.receive(told(3, session=2, nonce=2))
    assert link.receive(told(4, session=2, nonce=link.nonce))


def test_rule_11_nothing_can_be_signed_before_a_session_is_heard() -> None:
    with pytest.raises(RadioError, match="no telemetry was heard"):
        new_link().encode(Abort())


def test_rule_11_a_vest_that_has_no_counter_left_is_to_be_restarted() -> None:
    link = new_link()
    link.receive(told(2**24 - 1))
    link.encode(Abort())
    link.receive(told(2**24))
    with pytest.raises(RadioError, match="restart"):
        link.encode(Abort())


def test_rule_11_nonces_are_drawn_anew_and_never_0() -> None:
    nonces = {draw_nonce() for _ in range(100)}
    assert len(nonces) > 95
    assert 0 < min(nonces) <= max(nonces) < 2**32
