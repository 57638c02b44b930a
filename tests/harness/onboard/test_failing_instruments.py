"""Instruments that fail, through their bytes: rules 5 and 6 of SAFETY.md on the program as it ships."""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from codegen.firmware.telemetry import Flag, Ready, Refusal
from harness.onboard.radio import Mission, Start
from models.commands import Command
from models.modes import Anomaly
from tests.harness.onboard.vest import HERE, Vest, place

A = Mission(place(0, 0), (place(100, 0),))


@pytest.fixture
def vest() -> Iterator[Vest]:
    vest = Vest()
    yield vest
    vest.processor.close()


def walk(vest: Vest, seconds: float, *, error: float = 0.0, speed: float = 1.5, start: float = 0.0) -> float:
    """Walk to the north for so long, with a heading that is wrong by so much; where it comes to."""
    north = start
    for _ in range(round(seconds * 25)):
        north += speed / 25
        messages = (HERE,) if vest.k % 5 == 0 else ()
        vest.tick(*messages, gps_north=north, gps_speed=speed, heading_meas=error)
    return north


def begun(vest: Vest) -> None:
    """A trial that is under way."""
    vest.ticks(12)
    vest.begin(A)
    vest.ticks(5)
    assert vest.telemetry.refusal == Refusal.NONE


@pytest.mark.parametrize("error", [60, 180, -90])
def test_rule_6_an_animal_whose_heading_courses_contradict_is_stopped_and_that_is_told(
    vest: Vest, error: float
) -> None:
    # given a trial, with a unit that is mounted wrongly: home is behind it, the waypoint before it
    begun(vest)
    assert vest.played[-1] == Command.FORWARD
    # when the animal walks on for longer than 3 s
    walk(vest, 4.0, error=math.radians(error))
    # then
    assert set(vest.played[-10:]) == {Command.STOP}
    assert vest.telemetry.anomaly == Anomaly.INVALID_ESTIMATE
    assert Flag.VALID not in Flag(vest.telemetry.flags)
    assert {Ready.ESTIMATE, Ready.HEADING} <= set(Ready(vest.telemetry.ready).missing)


def test_rule_6_no_trial_begins_with_a_heading_that_courses_contradicted_until_they_agree(vest: Vest) -> None:
    vest.ticks(12)
    north = walk(vest, 4.0, error=math.pi)
    vest.tick(A)
    vest.ticks(12, gps_north=north)
    vest.ticks(10, Start(A.id), gps_north=north)
    assert vest.telemetry.refusal == Refusal.NO_ESTIMATE
    assert Ready.HEADING in Ready(vest.telemetry.ready).missing
    # when it stands, that stays; when it has walked with the right heading for 3 s, it is ready
    vest.ticks(100, gps_north=north)
    assert Ready.HEADING in Ready(vest.telemetry.ready).missing
    north = walk(vest, 4.0, start=north)
    vest.ticks(12, gps_north=north)
    assert Ready(vest.telemetry.ready).missing == ()
    vest.ticks(10, Start(A.id), gps_north=north)
    assert vest.telemetry.refusal == Refusal.NONE


def test_rule_6_an_inertial_unit_that_repeats_its_sample_is_a_silent_one(vest: Vest) -> None:
    begun(vest)
    # when the unit's counter goes on, and its values do not
    frozen = vest.k
    while Flag.IMU_OK in Flag(vest.telemetry.flags):
        vest.ticks(5, pitch_meas=0.0)
        assert vest.k - frozen < 50
    # then it is silent after 0.4 s and the time without samples, 0.2 s; the animal stands
    assert 15 <= vest.k - frozen <= 25
    assert vest.played[-1] == Command.STOP
    assert Command.STOP not in vest.played[frozen - 5 : frozen + 9]
    # and as soon as it lives it is heard
    vest.ticks(10)
    assert Flag.IMU_OK in Flag(vest.telemetry.flags)


def test_rule_6_a_receiver_that_repeats_its_epoch_is_a_silent_one(vest: Vest) -> None:
    # given a trial, and a receiver that says again and again what it said last
    begun(vest)
    last, vest.frozen = vest.k, True
    memory = vest.ticks(400)
    # then its fixes are no fixes: the estimate is as old as the last, and the animal is stopped
    assert memory["estimator.state.age"] > 395
    assert vest.telemetry.anomaly == Anomaly.INVALID_ESTIMATE
    assert Command.STOP in vest.played[last:]
    assert vest.played[-1] == Command.NONE  # the stop has lasted long enough


def test_rule_5_fixes_rejected_and_a_filter_that_begins_anew_are_told(vest: Vest) -> None:
    vest.ticks(30)
    assert (vest.telemetry.rejected_fixes, vest.telemetry.jumps, vest.telemetry.recoveries) == (0, 0, 0)
    # when the receiver is suddenly 300 m off
    vest.ticks(12, gps_north=300.0)
    first = vest.telemetry
    vest.ticks(150, gps_north=300.0)
    # then
    assert first.rejected_fixes in (1, 2)  # of two, of which the last may have come behind the report
    assert first.recoveries == 0
    assert vest.telemetry.rejected_fixes >= 12  # for 3 s
    assert vest.telemetry.recoveries == 1
