"""What the instruments send, read back by pyubx2, by struct and by the program on board."""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from io import BytesIO
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyubx2 import ERR_RAISE, UBXReader

from harness.log.geodesy import TangentPlane
from harness.onboard.instruments import InertialUnit, Receiver
from harness.onboard.memory import Memory
from harness.onboard.processors import Processor, Received, open_processor

ORIGIN = TangentPlane(math.radians(32.6), math.radians(-85.49))
FIX = {
    "gps_fix": 1.0, "gps_north": 123.456, "gps_east": -78.9, "gps_speed": 4.321, "gps_course": -2.5,
    "gps_h_acc": 3.5, "gps_s_acc": 0.1,
}  # fmt: skip
SAMPLE = {
    "accel_x": 0.51, "accel_y": -0.32, "accel_z": -9.79, "gyro_x": 0.011, "gyro_y": -0.022, "gyro_z": 0.33,
    "mag_x": 2.4e-5, "mag_y": -1.1e-6, "mag_z": 4.3e-5,
    "roll_meas": 0.05, "pitch_meas": -0.07, "heading_meas": 3.1,
}  # fmt: skip

signals = st.fixed_dictionaries(
    {
        "gps_fix": st.just(1.0),
        "gps_north": st.floats(-1e4, 1e4),
        "gps_east": st.floats(-1e4, 1e4),
        "gps_speed": st.floats(0, 50),
        "gps_course": st.floats(-math.pi, math.pi),
        "gps_h_acc": st.floats(0.001, 100),
        "gps_s_acc": st.floats(0.01, 10),
    }
)
samples = st.fixed_dictionaries(
    {name: st.floats(-1, 1) for name in SAMPLE if not name.startswith("mag")}
    | {name: st.floats(-6e-5, 6e-5) for name in SAMPLE if name.startswith("mag")}
)


def read(data: bytes) -> dict[str, Any]:
    """The messages by name, checksums tested; nothing between them is left over."""
    messages, length = {}, 0
    for raw, parsed in UBXReader(BytesIO(data), quitonerror=ERR_RAISE):
        messages[parsed.identity] = parsed
        length += len(raw)
    assert length == len(data)
    return messages


def degrees_apart(a: float, b: float) -> float:
    return abs((a - b + 180) % 360 - 180)


@given(signals, st.booleans())
def test_fix_reads_back_within_a_unit(values: dict[str, float], pvt: bool) -> None:
    # when
    messages = read(Receiver(ORIGIN, pvt).fix(61.24, values))
    # then, within 1e-7 deg, 1 mm, 1e-5 deg; the speed in mm/s, or in cm/s in the three messages
    names = {"NAV-PVT"} if pvt else {"NAV-POSLLH", "NAV-SOL", "NAV-VELNED"}
    assert messages.keys() == names
    assert {m.iTOW for m in messages.values()} == {61_240}
    place = messages["NAV-PVT" if pvt else "NAV-POSLLH"]
    motion = messages["NAV-PVT" if pvt else "NAV-VELNED"]
    state = messages["NAV-PVT" if pvt else "NAV-SOL"]
    latitude, longitude = ORIGIN.from_plane(values["gps_north"], values["gps_east"])
    assert place.lat == pytest.approx(math.degrees(latitude), abs=1.01e-7)
    assert place.lon == pytest.approx(math.degrees(longitude), abs=1.01e-7)
    assert place.hAcc / 1e3 == pytest.approx(values["gps_h_acc"], abs=0.51e-3)
    unit = 1e-3 if pvt else 1e-2
    assert motion.gSpeed * unit == pytest.approx(values["gps_speed"], abs=0.51 * unit)
    assert motion.sAcc * unit == pytest.approx(values["gps_s_acc"], abs=0.51 * unit)
    course = motion.headMot if pvt else motion.heading
    assert degrees_apart(course, math.degrees(values["gps_course"])) <= 1.01e-5
    # the receiver calls it a three-dimensional fix, and good
    assert (state.fixType, state.gnssFixOk) == (3, 1) if pvt else (state.gpsFix, state.gpsfixOK) == (3, 1)


@pytest.mark.parametrize("pvt", [False, True])
def test_a_damaged_byte_is_found_by_the_checksum(pvt: bool) -> None:
    data = bytearray(Receiver(ORIGIN, pvt).fix(1.0, FIX))
    data[10] ^= 1
    with pytest.raises(Exception, match="checksum"):
        read(bytes(data))


@pytest.mark.parametrize("pvt", [False, True])
def test_a_receiver_never_sends_a_speed_below_0(pvt: bool) -> None:
    messages = read(Receiver(ORIGIN, pvt).fix(1.0, FIX | {"gps_speed": -0.5}))
    assert messages["NAV-PVT" if pvt else "NAV-VELNED"].gSpeed == 0


EXTREMES = [*(s * x for x in (0.0, 5e-324, 0.5, 1.9999e6, 2e6, 2.1e6, 1e9, 1e308) for s in (1, -1)), math.inf]


@given(
    st.dictionaries(st.sampled_from([*FIX, *SAMPLE]), st.sampled_from([*EXTREMES, -math.inf, math.nan])),
    st.booleans(),
    st.floats(-90, 90),
)
def test_whatever_a_fault_makes_of_the_signals_there_are_whole_messages_or_none(
    values: dict[str, float], pvt: bool, latitude: float
) -> None:
    place = TangentPlane(math.radians(latitude), math.radians(179.0))
    values = FIX | SAMPLE | values
    messages = read(Receiver(place, pvt).fix(1.0, values))
    assert len(messages) in (0, 1 if pvt else 3)
    assert len(InertialUnit(pvt).sample(7, values)) == 5 + 50


@pytest.mark.parametrize("pvt", [False, True])
def test_the_receiver_sends_nothing_without_a_fix(pvt: bool) -> None:
    assert Receiver(ORIGIN, pvt).fix(1.0, FIX | {"gps_fix": 0.0}) == b""


def test_the_receivers_time_of_week_begins_anew_after_a_week() -> None:
    # a week has 604 800 s
    times = [read(Receiver(ORIGIN).fix(t, FIX))["NAV-SOL"].iTOW for t in (604_799.96, 604_800.0, 604_800.25)]
    assert times == [604_799_960, 0, 250]


@pytest.mark.parametrize("longitude", [179.9999, -179.9999, 180.0, -180.0, 539.9999])
def test_fixes_beyond_the_date_line_have_longitudes_within_180_deg(longitude: float) -> None:
    # given an origin at it, on the equator, where 20 m are 1.797e-4 deg
    receiver = Receiver(TangentPlane(0.0, math.radians(longitude)))
    for east in (20.0, -20.0):
        # when
        east_of = read(receiver.fix(0.0, FIX | {"gps_north": 0.0, "gps_east": east}))["NAV-POSLLH"].lon
        # then
        assert -180 <= east_of <= 180
        assert degrees_apart(east_of, longitude + math.copysign(1.79663e-4, east)) < 2e-7


@given(samples, st.integers(0, 200_000), st.booleans())
def test_sample_reads_back_as_single_precision(values: dict[str, float], tick: int, z_up: bool) -> None:
    # when
    data = InertialUnit(z_up).sample(tick, values)
    # then the frame is MTData of 50 bytes whose bytes behind the preamble sum up to 0
    assert data[:4] == bytes.fromhex("fa ff 32 32")
    assert sum(data[1:]) % 256 == 0
    # and the payload: z up means forward, left, up, so that what belongs to y and z changes its sign; so do
    # pitch (nose down positive about left) and heading (counter-clockwise)
    *numbers, counter = struct.unpack(">12fH", data[4:-1])
    side = -1 if z_up else 1
    mag = 4.9e-5  # T, of the unit's field
    expected = [
        *(s * values[f"{n}_{a}"] / u for n, u in (("accel", 1), ("gyro", 1), ("mag", mag))
          for a, s in (("x", 1), ("y", side), ("z", side))),
        math.degrees(values["roll_meas"]), side * math.degrees(values["pitch_meas"]),
        side * math.degrees(values["heading_meas"]),
    ]  # fmt: skip
    assert numbers == pytest.approx(expected, rel=6e-8, abs=1e-38)  # 2^-24
    assert counter == tick % 65536


@pytest.fixture
def processor() -> Iterator[Processor]:
    started = open_processor("host")
    yield started
    started.close()


@pytest.mark.parametrize("pvt", [False, True])
def test_program_on_board_reads_the_fix(processor: Processor, pvt: bool) -> None:
    # when
    memory = Memory(processor.tick(Received(gps=Receiver(ORIGIN, pvt).fix(61.24, FIX))).record)
    # then: in 1e-7 deg, mm, mm/s, 1e-5 deg; a metre is 90.2e-7 deg of latitude (TangentPlane)
    latitude, longitude = (math.degrees(x) * 1e7 for x in ORIGIN.from_plane(123.456, -78.9))
    speed = 10 if not pvt else 1  # mm/s: NAV-VELNED has cm/s
    for name, expected, unit in (
        ("time_ms", 61_240, 0), ("latitude", latitude, 1.01), ("longitude", longitude, 1.01),
        ("h_acc", 3500, 0), ("speed", 4321, 0.51 * speed), ("s_acc", 100, 0),
    ):  # fmt: skip
        assert memory[f"gps.fix.{name}"] == pytest.approx(expected, abs=unit, rel=0), name
    assert degrees_apart(memory["gps.fix.course"] / 1e5, math.degrees(-2.5)) <= 1.01e-5
    assert (memory["gps.frames"], memory["gps.errors"], memory["gps.skipped"]) == (1 if pvt else 3, 0, 0)
    # and the first fix is the origin, and the estimator's beginning
    assert memory["local_plane.state.settled"] == 1
    assert (memory["local_plane.output.north"], memory["local_plane.output.east"]) == (0, 0)
    assert memory["estimator.output.speed"] == pytest.approx(4.32, abs=2e-3)


def test_program_on_board_reads_the_sample(processor: Processor) -> None:
    # given the unit's factory axes, which the program is made for
    # when
    for tick in range(3):
        memory = Memory(processor.tick(Received(imu=InertialUnit().sample(tick, SAMPLE))).record)
    # then the signals are there again: forward, right, down, rad, and the field in the unit's
    for vector in ("accel", "gyro", "mag"):
        for axis in "xyz":
            unit = 4.9e-5 if vector == "mag" else 1
            expected = SAMPLE[f"{vector}_{axis}"] / unit
            assert memory[f"imu.{vector}_{axis}"] == pytest.approx(expected, rel=6e-8), (vector, axis)
    for angle in ("roll", "pitch", "heading"):  # to degrees and back: three roundings
        assert memory[f"imu.{angle}"] == pytest.approx(SAMPLE[f"{angle}_meas"], rel=2e-7), angle
    assert (memory["imu.counter"], memory["imu.lost"], memory["imu.frames"]) == (2, 0, 3)
    assert memory["imu.errors"] == memory["imu.skipped"] == 0


def test_a_z_down_unit_read_as_z_up_comes_mirrored_on_board(processor: Processor) -> None:
    # given a unit with its axes forward, right, down, which the program is not made for
    memory = Memory(processor.tick(Received(imu=InertialUnit(z_up=False).sample(0, SAMPLE))).record)
    # then: what makes the axes a setting and not a matter of taste
    assert memory["imu.accel_z"] == pytest.approx(9.79)
    assert memory["imu.heading"] == pytest.approx(-3.1)


def test_fixes_of_a_walk_across_the_date_line_stay_on_the_plane(processor: Processor) -> None:
    # given an origin 10 m west of the date line, on the equator
    receiver = Receiver(TangentPlane(0.0, math.pi - 10 / 6_378_137))
    # when the animal goes 20 m east, a fix each metre
    east = []
    for tick in range(21):
        data = receiver.fix(tick * 0.25, FIX | {"gps_north": 0.0, "gps_east": float(tick)})
        east.append(Memory(processor.tick(Received(gps=data)).record)["local_plane.output.east"])
    # then, to the resolution of 1e-7 deg, 1.1 cm, of fix and origin
    assert np.abs(np.subtract(east, range(21))).max() <= 2 * 0.0112


@pytest.mark.parametrize("pvt", [False, True])
@pytest.mark.parametrize(
    "beyond",
    [
        {"gps_north": math.nan},
        {"gps_north": math.inf},
        {"gps_north": 1e8},  # 900 deg
        {"gps_speed": 1e9},  # in units, more than 32 bits hold
        {"gps_h_acc": 1e300},
    ],
)
def test_a_position_that_the_messages_cannot_hold_gives_no_fix(beyond: dict[str, float], pvt: bool) -> None:
    # a plant made elsewhere may do so; the loop ends the trial of one that is not finite, and goes on else
    assert Receiver(ORIGIN, pvt).fix(0.0, FIX | beyond) == b""


@pytest.mark.parametrize("value", [math.nan, math.inf, 1e300, -1e300])
def test_a_value_beyond_float32_arrives_out_of_every_range(processor: Processor, value: float) -> None:
    # when
    data = InertialUnit().sample(0, SAMPLE | {"accel_x": value})
    memory = Memory(processor.tick(Received(imu=data)).record)
    # then the frame arrives, and the estimator skips the sample (its range is 200 m/s2)
    assert memory["imu.frames"] == 1
    assert abs(memory["imu.accel_x"]) > 200
    assert memory["estimator.state.bad_samples"] == 1
