"""What a station's log holds, also when it was cut, and what the other commands make of it."""

from __future__ import annotations

import errno
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from codegen.firmware.telemetry import FIELDS, Flag, Telemetry
from harness.log.log import Log, LogError, read_log
from harness.log.recover import recover
from harness.onboard.radio import Mission, Position
from harness.station.events import Event, Level
from harness.station.playback import Playback
from harness.station.recorded import read_recorded
from harness.station.sink import Clock, MovedLogError, Sink
from harness.trial.events import events
from harness.trial.summary import in_a_sentence, summarize, words
from models.commands import Command, Status
from models.modes import Anomaly

HOME = Position(32.6, -85.4)
MISSION = Mission(HOME, (Position(32.6009, -85.4),), ())
NOTHING = Telemetry(*[0] * len(FIELDS))
STATION = {
    "run": {"station": "a test"},
    "parameters": {"controller.capture_radius": "7.0", "controller.guarded": "1.0"},
}
FIXED = int(Flag.FIXED | Flag.VALID | Flag.LINK_OK)


@pytest.fixture
def sink(tmp_path: Path) -> Sink:
    return Sink(tmp_path, STATION)


def closed(sink: Sink) -> Log:
    sink.close()
    return read_log(sink.path)


def telemetry(seconds: float, **fields: int) -> Telemetry:
    told = {"session": 5, "latitude": 326000000, "longitude": -854000000, "flags": FIXED, "last_anomaly": 0}
    return replace(NOTHING, time_ms=round(1000 * seconds), **told | fields)


def tell(sink: Sink, first: float, last: float, **fields: int) -> None:
    """Telemetry each 0.2 s, by a vest that began 100 s before the station."""
    for k in range(round(5 * first), round(5 * last)):
        sink.tell(0.2 * k, telemetry(100 + 0.2 * k, **fields), Command.NONE)
        sink.step(0.2 * k)


# time -----------------------------------------------------------------------------------------------------


def test_time_follows_the_vest_while_it_is_heard_and_this_machine_while_it_is_not() -> None:
    clock = Clock()
    assert clock.at(3.0) == 3.0
    assert clock.follow(3.0, telemetry(100.0)) == 3.0
    assert clock.follow(3.5, telemetry(100.2)) == pytest.approx(3.2), "it came late by radio"
    assert clock.at(4.0) == pytest.approx(3.7)
    assert clock.follow(9.0, telemetry(0.0, session=6)) == pytest.approx(8.7), "a vest that began anew"


@pytest.mark.parametrize("jump", [-99.0, 3600.0, 4294867.0])
def test_a_clock_of_the_vest_that_jumps_moves_no_row(sink: Sink, jump: float) -> None:
    tell(sink, 0.4, 1.0)
    for k in range(5, 10):
        sink.tell(0.2 * k, telemetry(100 + jump + 0.2 * k), Command.NONE)
        assert sink.clock.jump == pytest.approx(jump if k == 5 else 0.0, abs=0.01)
    log = closed(sink)
    assert not log.broken
    assert log.time[-1] == pytest.approx(1.8)
    assert len(log.time) < 15


def test_a_simulated_vest_at_20_times_the_clock_has_its_own_time() -> None:
    clock = Clock(20.0)
    clock.follow(1.0, telemetry(100.0))
    assert clock.at(1.5) == pytest.approx(30.0)


def test_what_was_told_of_the_time_does_not_go_back_when_ours_ran_ahead() -> None:
    # given a vest at 20 times real time that is heard once, and ours 0.4 s of the trial later
    clock = Clock(20.0)
    begin = clock.follow(1.0, telemetry(100.0))
    told = clock.at(1.02)
    assert told == pytest.approx(begin + 0.4)
    # when the next telemetry says 0.2 s, then its row is there, and what happens next is no earlier than told
    assert clock.follow(1.02, telemetry(100.2)) == pytest.approx(begin + 0.2)
    assert [clock.at(now) for now in (1.02, 1.03)] == [told, pytest.approx(told)]
    assert clock.at(1.05) == pytest.approx(begin + 0.8)


# rows -----------------------------------------------------------------------------------------------------


def test_each_telemetry_is_a_row_at_its_own_time_in_si(sink: Sink) -> None:
    tell(sink, 0.4, 2.0, speed=250, heading=-15708, position_sd=120, command=2, mode=3)
    log = closed(sink)
    assert not log.broken
    assert log["estimator.speed"][-1] == 2.5
    assert log["estimator.heading"][-1] == pytest.approx(-math.pi / 2, abs=1e-4)
    assert log["estimator.north_sd"][-1] == log["estimator.east_sd"][-1] == pytest.approx(1.2)
    assert log["controller.command"][-1] == Command.STOP
    assert log["telemetry.latitude"][-1] == pytest.approx(math.radians(32.6))
    assert np.diff(log.time).max() <= 0.29


def test_a_telemetry_that_is_lost_leaves_the_row_before_in_its_place(sink: Sink) -> None:
    tell(sink, 0.4, 2.0, speed=100)
    tell(sink, 5.0, 6.0, speed=200)
    log = closed(sink)
    assert not log.broken, "a hole of 3 s would read as damage"
    assert set(log["telemetry.speed"][(log.time > 2) & (log.time < 4.9)]) == {1.0}


def test_a_vest_that_is_silent_still_gives_rows(sink: Sink) -> None:
    for k in range(100):
        sink.step(0.1 * k)
    log = closed(sink)
    assert log.time[-1] == pytest.approx(9.9, abs=0.5)
    assert not log["telemetry.session"].any()
    assert np.isnan(log["estimator.north"]).all(), "no position is known"


def test_positions_are_about_the_first_fix_where_no_origin_is_known(sink: Sink) -> None:
    tell(sink, 0.4, 1.0, flags=0, latitude=0, longitude=0)
    tell(sink, 1.0, 2.0)
    tell(sink, 2.0, 3.0, latitude=326000000 + 9018)  # 0.0009018 deg: 100 m
    log = closed(sink)
    assert log.origin == pytest.approx((32.6, -85.4))
    assert np.isnan(log["estimator.north"][log.time < 0.95]).all()
    assert log["estimator.north"][-1] == pytest.approx(100, abs=0.1)
    assert log["estimator.north"][np.searchsorted(log.time, 1.5)] == 0


def test_the_mission_becomes_the_route_once_it_is_on_board_the_last_one_holds(sink: Sink) -> None:
    tell(sink, 0.4, 1.0)
    sink.take_mission(replace(MISSION, waypoints=(HOME, HOME)))
    sink.take_mission(MISSION)
    tell(sink, 1.0, 2.0)
    route = closed(sink).route
    assert route is not None
    (_, north, east), (_, *home) = route.places
    assert [north, east] == pytest.approx([99.8, 0], abs=0.2)
    assert home == pytest.approx([0, 0], abs=1e-6)
    assert route.radius == 7.0


def test_the_route_is_that_of_the_mission_which_was_led_until_another_is_begun(sink: Sink) -> None:
    # given a mission that was led, and another that was uploaded thereafter
    nowhere = replace(MISSION, waypoints=(HOME,))
    started = int(FIXED | Flag.STARTED)
    tell(sink, 0.4, 1.0)
    sink.take_mission(MISSION)
    tell(sink, 1.0, 2.0, flags=started, status=Status.RUNNING, mission_id=MISSION.id)
    tell(sink, 2.0, 3.0, status=Status.SUCCESS, mission_id=MISSION.id)
    sink.take_mission(nowhere)
    tell(sink, 3.0, 4.0)
    sink.flush()

    def north() -> float:
        route = read_log(sink.path).route
        assert route is not None
        return route.places[0][1]

    # then the route is that of the first
    assert north() == pytest.approx(99.8, abs=0.2)
    # and so it is if another station's is begun, which is told once
    unknown = []
    for k in range(20, 23):
        sink.tell(0.2 * k, telemetry(100 + 0.2 * k, flags=started, mission_id=nowhere.id ^ 1), Command.NONE)
        unknown.append(sink.unknown)
    sink.flush()
    assert unknown == [nowhere.id ^ 1, None, None]
    assert north() == pytest.approx(99.8, abs=0.2)
    # when the other one is begun, it is that
    tell(sink, 4.6, 5.0, flags=started, status=Status.RUNNING, mission_id=nowhere.id)
    sink.flush()
    assert sink.unknown is None
    assert north() == pytest.approx(0, abs=0.2)


def test_an_anomaly_is_reported_on_one_row_and_ends_a_trial_in_words(sink: Sink) -> None:
    started = FIXED | Flag.STARTED
    tell(sink, 0.4, 2.0, flags=started, status=Status.RUNNING)
    tell(sink, 2.0, 3.0, flags=started, status=Status.RUNNING, last_anomaly=Anomaly.TURN_FAILURE)
    tell(sink, 3.0, 3.2, flags=started, status=Status.RUNNING, last_anomaly=Anomaly.DIRECTION_SWITCH)
    tell(sink, 3.8, 4.0, flags=started, status=Status.STOPPED, last_anomaly=Anomaly.NO_PROGRESS)
    tell(sink, 4.0, 6.0, last_anomaly=Anomaly.NO_PROGRESS)
    summary = summarize(closed(sink))
    assert summary["anomalies"] == {"TURN_FAILURE": 1, "DIRECTION_SWITCH": 1, "NO_PROGRESS": 1}
    assert summary["outcome"] == "stopped"
    assert summary["stopped_by"] == "the animal did not move on (rule 4)"


def test_a_mission_that_abort_ended_was_stopped_by_the_operator_whatever_ended_the_one_before(
    sink: Sink,
) -> None:
    # given a log of two missions, of which a rule stopped the first, and ABORT the second
    started = int(FIXED | Flag.STARTED)
    running = {"flags": started, "status": int(Status.RUNNING)}
    fence = {"last_anomaly": int(Anomaly.OUTSIDE_FENCE)}
    tell(sink, 0.4, 2.0, **running)
    tell(sink, 2.0, 4.0, flags=started, status=Status.STOPPED, **fence)
    tell(sink, 4.0, 6.0, **fence)
    tell(sink, 6.0, 8.0, **running)
    tell(sink, 8.0, 9.4, status=Status.STOPPED)  # the stop is held for 1.5 s
    tell(sink, 9.4, 12.0)
    log = closed(sink)
    # then the summary is about the second, and each event has its own reason
    summary = summarize(log)
    assert (summary["outcome"], summary["stopped_by"]) == ("stopped", "the operator")
    assert (summary["started_s"], summary["time_s"]) == pytest.approx((6.0, 8.0))
    assert words(summary)["time"] == "8.00 s, 2.00 s after its begin"
    assert in_a_sentence(summary).startswith("Stopped after 2 s by the operator.")
    assert summary["anomalies"] == {}, "those of the first are not its own"
    assert [event.text for event in events(log) if event.text.startswith("the trial was stopped")] == [
        "the trial was stopped: the animal was outside the fence (rule 7)",
        "the trial was stopped by the operator",
    ]


def test_a_mission_whose_end_was_not_heard_or_that_was_not_begun_is_no_timeout(sink: Sink) -> None:
    tell(sink, 0.4, 2.0)
    sink.flush()
    idle = summarize(replace(read_log(sink.path), broken=""))
    assert (idle["outcome"], idle["stopped_by"]) == ("stopped", "no mission was begun")
    tell(sink, 2.0, 4.0, flags=FIXED | Flag.STARTED, status=Status.RUNNING)
    cut = summarize(closed(sink))
    assert (cut["outcome"], cut["stopped_by"]) == ("stopped", "it was under way when the vest was last heard")


# a log that was cut ---------------------------------------------------------------------------------------


def test_all_but_the_last_second_of_a_killed_station_is_on_disk_and_is_recovered(sink: Sink) -> None:
    tell(sink, 0.4, 10.0)
    sink.take_mission(MISSION)
    sink.event(Event(9.0, Level.WARNING, "the vest has begun anew"))
    tell(sink, 10.0, 20.0)
    cut = sink.path.with_name("cut.mcap")
    cut.write_bytes((sink.path).read_bytes())  # nothing was closed
    log = read_log(cut)
    assert log.broken
    assert log.time[-1] >= 18.5
    recovered = recover(cut).out
    assert recovered is not None
    again = read_log(recovered)
    assert again.time[-1] == log.time[-1]
    assert again.route is not None
    shown = Playback(recovered)
    assert b"the vest has begun anew" in shown.join(1)[1]
    sink.close()


def test_what_was_flushed_is_on_disk(sink: Sink) -> None:
    tell(sink, 0.4, 1.0)
    sink.event(Event(0.9, Level.WARNING, "the vest has begun anew"))
    sink.flush()
    assert [event.text for event in read_recorded(sink.path).events] == ["the vest has begun anew"]
    sink.close()


def test_a_late_record_may_be_the_last_thing_before_a_cut(sink: Sink) -> None:
    tell(sink, 0.4, 3.0)
    sink.flush()
    before = (sink.path).stat().st_size
    sink.take_mission(MISSION)
    sink.flush()
    data = (sink.path).read_bytes()
    cut = sink.path.with_name("cut.mcap")
    for size in range(before, len(data) + 1, 7):
        cut.write_bytes(data[:size])
        assert read_log(cut).time[-1] > 2, f"cut at {size}"
    sink.close()


def test_a_disk_that_is_full_is_told(sink: Sink) -> None:
    with open("/dev/full", "wb", buffering=0) as full:
        sink._writer._container._file = full
        with pytest.raises(LogError, match="No space left"):
            tell(sink, 0.4, 30.0)


# what passed beside the rows ------------------------------------------------------------------------------


def test_bytes_orders_and_events_are_kept_with_their_times(sink: Sink) -> None:
    from mcap.reader import make_reader  # noqa: PLC0415 - an independent reader

    tell(sink, 0.4, 1.0)
    sink.receive(1.0, b"\xa5\x5a")
    sink.send(1.1, b"\x00\xff")
    sink.order(1.2, 3, {"do": "note", "text": "wet"})
    sink.event(Event(1.25, Level.CAUTION, "STOP by operator 3"))
    sink.close()
    with (sink.path).open("rb") as file:
        found = {
            channel.topic: (message.log_time, json.loads(message.data))
            for _, channel, message in make_reader(file).iter_messages()
            if channel.topic.startswith(("/radio", "/station"))
        }
    assert found["/radio/received"][1] == {"bytes": "a55a"}
    assert found["/radio/sent"][1] == {"bytes": "00ff"}
    assert found["/station/orders"][1] == {"operator": 3, "do": "note", "text": "wet"}
    assert found["/station/events"] == (
        1_250_000_000,
        {
            "timestamp": {"sec": 1, "nsec": 250_000_000},
            "level": 3,
            "message": "STOP by operator 3",
            "name": "station",
            "file": "",
            "line": 0,
        },
    )


@pytest.mark.parametrize("instead", [None, b"another log"])
def test_a_log_that_is_taken_away_is_told_once_and_written_to_its_end(
    sink: Sink, instead: bytes | None
) -> None:
    tell(sink, 0.4, 2.0)
    sink.flush()
    moved = sink.path.rename(sink.path.with_name("moved.mcap"))
    if instead is not None:
        sink.path.write_bytes(instead)
    with pytest.raises(MovedLogError, match=r"trial.mcap: was moved, .* when the mission has ended"):
        sink.flush()
    tell(sink, 2.0, 4.0)
    sink.close()
    log = read_log(moved)
    assert not log.broken
    assert log.time[-1] == pytest.approx(3.8)


def test_a_log_that_is_taken_away_just_before_its_end_has_an_end(sink: Sink) -> None:
    tell(sink, 0.4, 2.0)
    moved = sink.path.rename(sink.path.with_name("moved.mcap"))
    with pytest.raises(MovedLogError):
        sink.close()
    assert not read_log(moved).broken


def test_a_share_that_does_not_answer_has_taken_no_log_away(
    sink: Sink, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stat(path: Path) -> None:
        raise OSError(errno.EIO, "Input/output error")

    monkeypatch.setattr(sink.path.__class__, "stat", stat)
    sink.flush()
