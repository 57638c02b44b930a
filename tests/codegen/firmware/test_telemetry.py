"""The table of the telemetry, and its products: the struct, its bytes, the signals of the log."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import pytest

from codegen.firmware.bundle import headers, program
from codegen.firmware.telemetry import (
    FIELDS,
    NOT_READY,
    PAYLOAD,
    UNITS,
    Flag,
    Ready,
    Refusal,
    Telemetry,
    Wire,
)
from harness.onboard.stand_in import Onboard


def test_each_field_has_a_member_of_its_type_and_the_flags_have_a_bool_each() -> None:
    # given the struct as the header has it
    members = {member.name: member.type for member in headers().structs["telemetry"]}
    # then it has the fields in their order, and the seven conditions where the flags are
    names = list(FIELDS)
    at = names.index("flags")
    bools = ["valid", "imu_ok", "link_ok", "fixed", "loaded", "started", "insecure"]
    assert list(members) == [*names[:at], *bools, *names[at + 1 :]]
    assert {members[name] for name in bools} == {"bool"}
    assert all(members[name] == FIELDS[name].type for name in names if name != "flags")


def test_the_program_sets_every_member_of_the_telemetry_that_it_sends() -> None:
    members = {member.name for member in headers().structs["telemetry"]}
    assert set(re.findall(r"\bt\.(\w+) = ", program()["onboard.c"])) == members


def test_payload_is_80_bytes_as_the_header_states() -> None:
    # 4 + 4 + 4, seven of 2, six of 1, three of 2, 1, 4, 1, 2, three of 4, seven of 2, 2, two of 1, two of 2
    assert PAYLOAD.size == 12 + 14 + 6 + 6 + 1 + 4 + 1 + 2 + 12 + 14 + 4 + 4
    assert "#define TELEMETRY_SIZE 80U" in program()["telemetry.h"]


def test_payload_of_telemetry_is_read_back() -> None:
    telemetry = Telemetry(*range(len(FIELDS)))
    assert Telemetry.from_payload(telemetry.payload()) == telemetry


def test_flags_are_the_bits_of_one_byte_each_once() -> None:
    assert [flag.value for flag in Flag] == [1, 2, 4, 8, 16, 32, 64]
    assert all(flag.meaning for flag in Flag)
    assert Flag(0x21) == Flag.VALID | Flag.STARTED


def test_rule_8_each_bit_of_ready_has_a_macro_a_meaning_and_a_refusal_with_its_words() -> None:
    # given the bits, the lowest first
    assert [bit.value for bit in Ready] == [1 << k for k in range(len(Ready))]
    # then the refusals count them
    assert [refusal.value for refusal in Refusal] == list(range(NOT_READY + len(Ready)))
    assert dict(zip(Ready, list(Refusal)[NOT_READY:], strict=True)) == {
        Ready.LINK: Refusal.NO_LINK, Ready.IMU: Refusal.NO_IMU, Ready.FIX: Refusal.NO_FIX,
        Ready.ACCURACY: Refusal.NOT_ACCURATE, Ready.ESTIMATE: Refusal.NO_ESTIMATE,
        Ready.MISSION: Refusal.NO_MISSION, Ready.REACH: Refusal.OUT_OF_REACH, Ready.LEGS: Refusal.SHORT_LEG,
        Ready.FIRST_LEG: Refusal.SHORT_FIRST_LEG, Ready.RELEASED: Refusal.OVERRIDDEN,
        Ready.IDLE: Refusal.NOT_IDLE, Ready.PLANNED: Refusal.NOT_PLANNED,
        Ready.HEADING: Refusal.CONTRADICTED,
        Ready.FENCE: Refusal.OUTSIDE_FENCE, Ready.INSIDE: Refusal.ANIMAL_OUTSIDE,
        Ready.BUDGET: Refusal.WINDOW_SPENT,
        Ready.BATTERY: Refusal.LOW_BATTERY, Ready.TEMPERATURE: Refusal.BAD_TEMPERATURE,
        Ready.AGREEMENT: Refusal.FIX_REJECTED,
    }  # fmt: skip
    # and header and log name them in words
    header = program()["telemetry.h"]
    for bit in Ready:
        assert f"#define READY_{bit.name} ((uint32_t)0x{bit.value:05X}U) /* {bit.meaning} */" in header
        assert str(bit.name).lower() in FIELDS["ready"].meaning
    assert f"#define READY_ALL ((uint32_t)0x{sum(Ready):05X}U)" in header
    assert "#define REFUSAL_NOT_READY 2U" in header
    assert Refusal.NO_FIX.words == "there has been no fix"
    assert len({refusal.words for refusal in Refusal}) == len(Refusal)


def test_bits_that_are_off_are_listed_the_lowest_first() -> None:
    ready = Ready(sum(Ready)) & ~Ready.FIX & ~Ready.IDLE
    assert ready.missing == (Ready.FIX, Ready.IDLE)
    assert Ready(sum(Ready)).missing == ()


@pytest.mark.parametrize(
    ("unit", "value"),
    [
        ("ms", 0.001),
        ("1e-7 deg", 1.7453292519943295e-09),
        ("cm/s", 0.01),
        ("cm", 0.01),
        ("dm", 0.1),
        ("1e-4 rad", 1e-4),
        ("mV", 0.001),
        ("0.1 degC", 0.1),
    ],
)
def test_a_unit_by_radio_has_its_factor_to_si(unit: str, value: float) -> None:
    assert UNITS[unit][1] == pytest.approx(value, rel=1e-15)


def test_log_has_each_field_in_si_and_counts_as_whole_numbers() -> None:
    channel = Onboard.channel()
    # the time is in s there, and loses the unit in its name
    assert channel.names == ("time", *list(FIELDS)[1:])
    kinds = dict(zip(channel.names, zip(channel.units, channel.types, strict=True), strict=True))
    assert kinds["time"] == ("s", "Real")
    assert kinds["latitude"] == ("rad", "Real")
    assert kinds["distance"] == ("m", "Real")
    assert (kinds["battery"], kinds["temperature"]) == (("V", "Real"), ("degC", "Real"))
    assert (FIELDS["distance"].unit, FIELDS["position_sd"].unit) == ("dm", "cm")  # what `report` sends
    assert kinds["command"] == kinds["gps_frames"] == ("", "Integer")


def test_comment_of_a_telemetry_field_in_c_states_the_unit_by_radio() -> None:
    assert Wire("int16_t", "cm/s", "ground speed").comment == "cm/s: ground speed"
    assert Wire("uint8_t", "", "what the animal is told").comment == "what the animal is told"
    assert math.isclose(UNITS["1e-7 deg"][1] * 1e7, math.radians(1))


def test_the_number_of_a_refusal_that_is_none_of_ours_is_no_refusal() -> None:
    known = Telemetry(*[0] * len(FIELDS))
    assert replace(known, refusal=Refusal.LOW_BATTERY).refused is Refusal.LOW_BATTERY
    assert replace(known, refusal=255).refused is Refusal.NONE
