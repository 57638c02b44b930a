"""What is wrong, in words, and how urgent it is."""

from __future__ import annotations

from harness.onboard.processors import Received
from harness.station.alarms import Alarm, Alarms
from harness.station.draft import as_json
from harness.station.events import Level
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
