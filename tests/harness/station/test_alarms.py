"""What is wrong, in words, and how urgent it is."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from codegen.firmware.telemetry import FIELDS, Flag, Ready, Telemetry
from harness.log.events import ANOMALIES, cause_of_stop
from harness.onboard.processors import Received
from harness.station.alarms import Alarm, Alarms
from harness.station.draft import as_json
from harness.station.events import Level
from models.commands import Command, Status
from models.modes import Anomaly
from tests.harness.station.rig import MISSION, Rig, connected, under_way


def alarms(rig: Rig, watch: Alarms | None = None) -> dict[str, Alarm]:
    return {alarm.key: alarm for alarm in (watch or Alarms()).at(rig.now, rig.conduct, rig.now)}


def test_nothing_is_wrong_while_a_mission_is_led() -> None:
    rig = under_way()
    rig.run(1)
    assert alarms(rig) == {}


def test_a_silent_vest_is_a_caution_at_rest_and_a_warning_under_way() -> None:
    rig = Rig()
    rig.load()
    rig.downlink = False
    rig.run(3)
    assert alarms(rig)["link"].level is Level.CAUTION
    rig = under_way()
    rig.downlink = False
    rig.run(1)
    assert alarms(rig)["late"].level is Level.CAUTION
    rig.run(2)
    assert alarms(rig)["link"].level is Level.WARNING


def test_a_vest_that_does_not_hear_us_is_a_warning_before_the_mission_ends() -> None:
    rig = under_way()
    rig.uplink = False
    seen = set()
    for _ in range(80):
        rig.tick()
        seen |= {(alarm.key, alarm.level) for alarm in alarms(rig).values()}
    assert ("ended", Level.WARNING) in seen
    assert "the radio link was lost (rule 9)" in alarms(rig)["ended"].text


def test_a_dead_tab_is_a_warning_while_a_mission_is_under_way() -> None:
    rig = under_way()
    rig.alive.clear()
    rig.run(1.2)
    assert alarms(rig)["commander"] == Alarm(
        "commander", Level.WARNING, "nobody commands: the vest stops the animal", rig.now
    )


def test_an_alarm_knows_since_when_and_the_most_urgent_comes_first() -> None:
    rig, watch = under_way(), Alarms()
    rig.order("stop")
    rig.run(0.2)
    begun = alarms(rig, watch)["stop"].since
    rig.downlink = False
    rig.run(3)
    shown = alarms(rig, watch)
    assert shown["stop"].since == begun
    levels = [alarm.level for alarm in shown.values()]
    assert levels == sorted(levels, key=[Level.WARNING, Level.CAUTION, Level.ADVISORY].index)
    assert levels[0] is Level.WARNING


def test_sensors_that_fail_are_named() -> None:
    rig = Rig()
    rig.take()
    rig.order("draft", mission=as_json(MISSION))
    rig.run(0.5)
    for _ in range(100):
        rig.now += 0.04
        rig.processor.tick(Received(b"", b"", b""))
        rig.conduct.receive(rig.now, rig.processor.sent)
    assert alarms(rig)["imu"].text == "the inertial unit is silent"


def test_forged_frames_are_a_caution_for_half_a_minute() -> None:
    rig, watch = connected(), Alarms()
    rig.conduct.link.decoder.forged += 1
    rig.run(0.2)
    assert alarms(rig, watch)["forged"].level is Level.CAUTION
    rig.run(31)
    assert "forged" not in alarms(rig, watch)


def test_link_quality_counts_what_is_lost_late_and_how_long_an_answer_takes() -> None:
    rig = Rig()
    rig.take()
    rig.run(2)
    quality = rig.conduct.quality.at(rig.now)
    assert (quality.lost, quality.late, quality.errors) == (0, 0, 0)
    assert quality.round_trip_s is not None
    assert 0 < quality.round_trip_s <= 0.3
    rig.downlink = False
    rig.run(1)
    rig.downlink = True
    rig.run(0.5)
    quality = rig.conduct.quality.at(rig.now)
    assert quality.lost == 5
    assert quality.age_s is not None
    assert quality.age_s < 0.3
    rig.now += 0.5  # the bytes wait in a buffer
    rig.run(0.5)
    assert rig.conduct.quality.at(rig.now).late == 1


def test_a_vest_that_begins_anew_is_not_late() -> None:
    rig = Rig()
    rig.take()
    rig.run(5)
    rig.reset()
    rig.run(2)
    assert rig.conduct.quality.at(rig.now).late == 0


# each alarm by itself --------------------------------------------------------------------------------------

WELL = replace(
    Telemetry(*[0] * len(FIELDS)),
    flags=Flag.VALID | Flag.IMU_OK | Flag.LINK_OK | Flag.FIXED,
    ready=sum(Ready),
    issues_left=3,
    vibration_left=61,
    tone_left=201,
)
FULL = {"age": 0.6, "round_trip": 1.0, "forged": 0}  # of what is allowed


def at_work(*, running: bool = False, lives: bool = True, **changes: Any) -> Any:
    """A conduct of which alarms look at what is given here alone; nothing is wrong by itself."""
    numbers = FULL | {name: changes.pop(name) for name in FULL.keys() & changes.keys()}
    own = {"latched": False, "holding": None, "offered": False}
    own |= {name: changes.pop(name) for name in own.keys() & changes.keys()}
    quality = SimpleNamespace(round_trip_s=numbers["round_trip"], forged=numbers["forged"])
    return SimpleNamespace(
        telemetry=replace(WELL, **changes),
        is_under_way=running,
        is_heard=lambda now: numbers["age"] <= 2,
        unheard="the vest is not heard",
        desk=SimpleNamespace(lives=lambda now: lives, offered=own["offered"], commander=1),
        quality=SimpleNamespace(age=lambda now: numbers["age"], at=lambda now: quality),
        latched=own["latched"],
        holding=own["holding"],
    )


def told(conduct: Any) -> list[str]:
    """The alarms as `key level: text`."""
    return [f"{alarm.key} {alarm.level}: {alarm.text}" for alarm in Alarms().at(1.0, conduct, 1.0)]


LESS = WELL.flags & ~Flag.VALID


@pytest.mark.parametrize(
    ("conduct", "alarms"),
    [
        (at_work(), []),
        (at_work(running=True), []),
        (at_work(age=0.61), ["late caution: no telemetry for 0.6 s"]),
        (at_work(age=2.1), ["link caution: the vest is not heard"]),
        (at_work(running=True, age=2.1), ["link warning: the vest is not heard"]),
        (at_work(round_trip=1.01), ["slow caution: answers take 1.0 s"]),
        (
            at_work(flags=WELL.flags & ~Flag.LINK_OK),
            ["uplink caution: the vest does not hear this station: it stops the animal"],
        ),
        (
            at_work(running=True, lives=False, flags=WELL.flags & ~Flag.LINK_OK),
            [
                "uplink warning: the vest does not hear this station: it stops the animal",
                "commander warning: nobody commands: the vest stops the animal",
            ],
        ),
        (at_work(lives=False, flags=WELL.flags & ~Flag.LINK_OK), []),
        (at_work(latched=True), ["stop caution: STOP is latched"]),
        (at_work(holding=Command.LEFT), ["hold advisory: LEFT is held"]),
        (at_work(offered=True), ["offered advisory: operator 1 hands over the command"]),
        (
            at_work(holding=Command.LEFT, latched=True, status=Status.STOPPED),
            [
                f"ended warning: the mission was stopped: {cause_of_stop(Anomaly.NONE)}",
                "stop caution: STOP is latched",
                "hold advisory: LEFT is held",
            ],
        ),
        (
            at_work(status=Status.FAILED),
            [f"ended caution: the mission has failed: {ANOMALIES[Anomaly.TRIAL_FAILURE]}"],
        ),
        (at_work(flags=Flag.LINK_OK), ["imu caution: the inertial unit is silent"]),
        (at_work(running=True, flags=Flag.LINK_OK), ["imu warning: the inertial unit is silent"]),
        (at_work(flags=Flag.LINK_OK | Flag.IMU_OK), ["fix caution: there has been no fix"]),
        (at_work(flags=LESS), ["estimate caution: the estimate cannot be trusted"]),
        (
            at_work(running=True, flags=LESS),
            ["estimate warning: the estimate cannot be trusted: the animal is stopped"],
        ),
        (
            at_work(ready=WELL.ready & ~Ready.HEADING),
            ["heading caution: courses contradict the heading"],
        ),
        (
            at_work(ready=WELL.ready & ~Ready.AGREEMENT),
            ["agreement caution: the last fix contradicts the estimate"],
        ),
        (
            at_work(ready=WELL.ready & ~Ready.ACCURACY),
            ["accuracy caution: the last fix is less accurate than the capture radius"],
        ),
        (
            at_work(ready=WELL.ready & ~Ready.ACCURACY, flags=WELL.flags & ~Flag.FIXED),
            ["fix caution: there has been no fix"],
        ),
        (at_work(ready=WELL.ready & ~Ready.INSIDE), []),
        (
            at_work(running=True, ready=WELL.ready & ~Ready.INSIDE),
            ["fence warning: the animal is outside the fence"],
        ),
        (
            at_work(ready=WELL.ready & ~Ready.BATTERY, battery=6543),
            ["battery caution: the battery is low: 6.54 V"],
        ),
        (
            at_work(ready=WELL.ready & ~Ready.TEMPERATURE, temperature=-123),
            ["temperature caution: the pack is at -12 degC"],
        ),
        (at_work(issues_left=2, vibration_left=60, tone_left=200), []),
        (
            at_work(running=True, issues_left=2, vibration_left=60, tone_left=200),
            [
                "issues caution: 2 LEFT or RIGHT are left",
                "vibration caution: 6.0 s of vibration are left",
                "tone caution: 20.0 s of tones are left",
            ],
        ),
        (
            at_work(flags=WELL.flags | Flag.INSECURE),
            ["insecure advisory: the vest was built without a key: whoever has a radio commands it"],
        ),
    ],
)
def test_each_thing_that_is_wrong_is_told_the_most_urgent_first(conduct: Any, alarms: list[str]) -> None:
    assert told(conduct) == alarms


def test_an_alarm_tells_since_when_it_is_on() -> None:
    watch = Alarms()
    assert [alarm.since for alarm in watch.at(1.0, at_work(latched=True), 1.0)] == [1.0]
    assert [alarm.since for alarm in watch.at(2.0, at_work(latched=True, age=0.7), 2.0)] == [2.0, 1.0]
    assert watch.at(3.0, at_work(), 3.0) == []
    assert [alarm.since for alarm in watch.at(4.0, at_work(latched=True), 4.0)] == [4.0]


def test_forged_frames_are_told_for_half_a_minute_from_the_last_one() -> None:
    watch = Alarms()

    def is_told(now: float, forged: int) -> bool:
        return [alarm.key for alarm in watch.at(now, at_work(forged=forged), now)] == ["forged"]

    assert not is_told(1.0, 0)
    assert is_told(2.0, 1)
    assert is_told(31.5, 1)
    assert not is_told(32.5, 1)
    assert is_told(40.0, 2)
    assert is_told(69.5, 2)
