"""What operators order reaches the program on board, and what does not."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import pytest

from codegen.firmware.key import Key
from codegen.firmware.telemetry import Flag, Ready
from harness.onboard.radio import HEADER, LAST, Abort, Link, Mission, Override, Start
from harness.station.alarms import Alarms
from harness.station.conduct import ORDERS, Conduct, LinkState
from harness.station.desk import OrderError
from harness.station.draft import Draft, as_json
from harness.station.events import Level
from models.commands import Command, Status
from models.kit.timing import TICK
from tests.harness.onboard.vest import place
from tests.harness.station.rig import HOME, MISSION, OTHER, Rig, connected, drawn, frames, ready, under_way


def bits(rig: Rig) -> set[str]:
    return {reason["bit"] for reason in rig.conduct.missing(rig.now)}


def overrides(rig: Rig, seconds: float) -> set[Command]:
    """The commands of the operator that are sent meanwhile."""
    sent = [
        frame for _ in range(round(seconds / TICK)) if rig.tick() is not None for frame in frames(rig.sent)
    ]
    return {Command(frame[HEADER.size]) for frame in sent if frame[2] == Override.type}


# from the first telemetry to a mission that is under way --------------------------------------------------


def test_a_vest_is_connected_loaded_ready_running() -> None:
    rig = Rig()
    assert rig.conduct.state(rig.now) is LinkState.DISCONNECTED
    rig.run(1)
    assert rig.conduct.state(rig.now) is LinkState.CONNECTED, "it is greeted though nobody commands"
    rig.load()
    assert rig.conduct.state(rig.now) is LinkState.LOADED
    assert bits(rig) == {"planned"}, "one place is projected on a tick"
    rig.until(lambda: rig.conduct.state(rig.now) is LinkState.READY)
    rig.order("start")
    rig.until(lambda: rig.conduct.state(rig.now) is LinkState.RUNNING, 0.5)
    assert rig.run(1)[-1] is Command.FORWARD


def test_each_bit_that_the_vest_lacks_is_named_in_words() -> None:
    rig = connected()
    named = {reason["bit"]: reason["words"] for reason in rig.conduct.missing(rig.now)}
    assert rig.conduct.telemetry is not None
    assert named == {"mission": "the vest holds no mission"}, "what judges a mission waits for one"
    rig.order("draft", mission=as_json(Draft(HOME, (place(2, 0), place(4, 0)))))
    rig.order("upload")
    rig.run(1.5)
    told = Ready(rig.conduct.telemetry.ready).missing
    named = {reason["bit"]: reason["words"] for reason in rig.conduct.missing(rig.now)}
    assert set(named) == {str(bit.name).lower() for bit in told} == {"legs", "first_leg"}
    assert named["legs"] == "two waypoints in a row are closer than the capture radius"


def test_a_mission_counts_as_on_board_once_telemetry_shows_its_id() -> None:
    rig = drawn()
    rig.downlink = False
    rig.order("upload")
    rig.run(1)
    assert rig.conduct.on_board is None, "nothing was heard"
    rig.downlink = True
    rig.run(0.5)
    assert rig.conduct.on_board is not None
    assert rig.conduct.on_board.id == rig.vest.telemetry.mission_id == rig.conduct.draft_id


def test_a_mission_that_is_lost_on_the_air_is_sent_again() -> None:
    rig = drawn()
    rig.uplink = False
    rig.order("upload")
    rig.run(0.6)
    rig.uplink = True
    rig.until(lambda: rig.conduct.on_board is not None, 1)


def test_a_mission_that_is_lost_while_other_frames_pass_is_not_on_board() -> None:
    rig = drawn()
    rig.lost = {Mission.type}
    rig.order("upload")
    rig.tick()
    rig.order("stop")
    rig.run(1)
    assert rig.conduct.telemetry is not None
    assert rig.conduct.telemetry.received > 0
    assert rig.conduct.on_board is None
    rig.lost = set()
    rig.until(lambda: rig.conduct.on_board is not None, 1)


def test_a_mission_that_the_vest_holds_already_counts_once_it_has_heard_it_again() -> None:
    rig = ready()
    rig.uplink = False
    rig.order("upload")
    rig.run(0.5)
    assert rig.conduct.on_board is None, "it is not of this upload"
    rig.uplink = True
    rig.until(lambda: rig.conduct.on_board is not None, 1)


def test_the_mission_before_is_not_taken_for_one_that_is_lost_on_the_air() -> None:
    rig = ready()
    rig.order("draft", mission=as_json(OTHER))
    rig.lost = {Mission.type}
    rig.order("upload")
    rig.tick()
    rig.order("stop")  # whose frames pass
    rig.run(1)
    assert rig.conduct.on_board is None
    assert rig.texts().count("is on board") == 1


def test_a_mission_is_on_board_once_the_vest_says_that_it_is_loaded() -> None:
    rig = drawn()
    rig.lost = {Mission.type}
    rig.order("upload")
    rig.tick()
    told = rig.conduct.telemetry
    assert told is not None
    assert rig.conduct.draft_id is not None
    later = replace(told, received=LAST, mission_id=rig.conduct.draft_id, flags=told.flags & ~Flag.LOADED)
    rig.conduct._hear(rig.now, later)
    assert rig.conduct.on_board is None
    rig.conduct._hear(rig.now, replace(later, flags=told.flags | Flag.LOADED))
    assert rig.conduct.on_board is not None


@pytest.mark.parametrize("end", ["abort", "a reset"])
def test_an_upload_that_waits_is_forgotten_with(end: str) -> None:
    rig = drawn()
    rig.lost = {Mission.type}
    rig.order("upload")
    rig.run(0.2)
    assert rig.conduct.pending()["uploading"]
    if end == "abort":
        rig.order("abort")
    else:
        rig.reset()
        rig.until(lambda: rig.conduct.link.sessions == 2, 1)
    assert not rig.conduct.pending()["uploading"]


def test_without_telemetry_nothing_is_uploaded_and_nothing_is_sent() -> None:
    rig = Rig()
    rig.take()
    rig.order("draft", mission=as_json(MISSION))
    with pytest.raises(OrderError, match="upload: the vest is not heard"):
        rig.order("upload")
    assert rig.conduct.step(rig.now) == b""
    assert {level for level, _ in rig.conduct.take_events()} == {Level.ADVISORY}


def test_an_upload_ends_with_its_commander() -> None:
    rig = drawn()
    rig.lost = {Mission.type}
    rig.order("upload")
    rig.alive.clear()
    rig.run(1.5)
    rig.lost = set()
    rig.run(2)
    assert rig.conduct.on_board is None


def test_a_vest_at_20_times_real_time_hears_as_many_frames_of_its_own_time() -> None:
    rig = connected()
    rig.pace = 20.0
    assert all(rig.run(1) and rig.conduct._has(Flag.LINK_OK) for _ in range(20))


@pytest.mark.parametrize("pace", [1.0, 20.0])
def test_frames_are_repeated_every_four_tenths_by_the_clock_that_is_faster(pace: float) -> None:
    rig = connected()
    rig.downlink = pace > 1  # else ours alone is there
    rig.pace = pace
    ticks = [tick for tick in range(100) if rig.tick() is not None and rig.sent]
    gaps = [later - before for before, later in pairwise(ticks)]
    assert 0.4 / TICK - 1 <= min(gaps) <= max(gaps) <= 0.4 / TICK + 1


def test_an_upload_that_nobody_acknowledges_is_given_up_and_told() -> None:
    rig = drawn()
    rig.uplink = False
    rig.order("upload")
    rig.run(5.2)
    assert not rig.conduct.pending()["uploading"]
    assert "not acknowledged within 5 s" in rig.texts()


def test_a_start_that_is_refused_is_told_and_not_repeated() -> None:
    rig = ready()
    rig.downlink = False
    rig.vest.inside.radio.mission.count = 0  # the vest loses what the last telemetry told
    rig.order("start")
    rig.run(0.4)
    rig.downlink = True
    rig.run(0.6)
    assert "START was refused: the vest holds no mission" in rig.texts()
    assert not rig.conduct.pending()["starting"]
    assert not rig.is_started


def test_a_start_that_is_not_answered_is_forgotten_after_3_s() -> None:
    rig = ready()
    rig.uplink = False
    rig.order("start")
    rig.run(3.2)
    rig.uplink = True
    rig.run(2)
    assert "START was not answered within 3 s" in rig.texts()
    assert not rig.is_started


def test_a_start_that_began_a_mission_is_answered() -> None:
    rig = under_way()
    rig.run(4)
    assert not rig.conduct.pending()["starting"]
    assert "not answered" not in rig.texts()


def test_a_start_that_waits_is_forgotten_with_a_vest_that_begins_anew() -> None:
    rig = ready()
    rig.lost = {Start.type}
    rig.order("start")
    rig.reset()
    rig.until(lambda: rig.conduct.link.sessions == 2, 1)
    assert not rig.conduct.pending()["starting"]


@pytest.mark.parametrize("name", ["stop", "abort", "hold"])
def test_a_start_that_waits_is_forgotten_with_an_order_against_it(name: str) -> None:
    rig = ready()
    rig.lost = {Start.type}
    rig.order("start")
    rig.run(0.2)
    assert rig.conduct.pending()["starting"]
    rig.order(name, command="LEFT")
    assert not rig.conduct.pending()["starting"]
    rig.lost = set()
    rig.run(1)
    assert not rig.is_started


def test_a_start_that_waits_is_forgotten_with_its_commander() -> None:
    rig = ready()
    rig.lost = {Start.type}
    rig.order("start")
    rig.alive.clear()
    rig.run(1.3)
    assert not rig.conduct.pending()["starting"], "before the 3 s in which it is to be answered"


def test_no_mission_is_started_that_this_station_did_not_give_whatever_the_vest_tells() -> None:
    # given a vest that says it is ready, and holds no mission
    rig = ready()
    told = rig.conduct.telemetry
    assert told is not None
    rig.conduct._given, rig.conduct.telemetry = None, replace(told, flags=told.flags & ~Flag.LOADED)
    assert not rig.conduct.missing(rig.now)
    with pytest.raises(OrderError, match="start: not ready"):
        rig.order("start")


def test_the_reason_of_an_earlier_refusal_does_not_end_a_start_that_is_lost_on_the_air() -> None:
    rig = ready()
    rig.vest.inside.refusal = 7
    rig.run(0.5)
    rig.lost = {Start.type}
    rig.order("start")
    rig.run(0.5)
    assert rig.conduct.pending()["starting"], "the vest told a refusal, but not of this START"
    rig.lost = set()
    rig.until(lambda: rig.is_started, 1)


@pytest.mark.parametrize(
    ("before", "says"),
    [
        (lambda rig: rig.order("stop"), "STOP is latched"),
        (lambda rig: rig.order("hold", command="LEFT"), "a command is held"),
        (lambda rig: rig.order("draft", mission=as_json(OTHER)), "not the one on board: upload"),
    ],
)
def test_a_start_is_refused_here_while_something_tells_against_it(before: object, says: str) -> None:
    rig = ready()
    before(rig)  # type: ignore[operator]
    with pytest.raises(OrderError, match=says):
        rig.order("start")


def test_a_start_needs_a_commander_who_lives() -> None:
    rig = ready()
    rig.alive.clear()
    rig.run(1.1)
    assert bits(rig) == {"commander"}


def test_a_draft_that_is_no_mission_yet_tells_against_nothing() -> None:
    rig = ready()
    rig.order("draft", mission={"home": None})
    assert bits(rig) == set()


def test_a_mission_that_another_station_gave_is_not_started() -> None:
    rig = ready()
    other = Rig(first=1000)
    other.processor, other.vest, other.now = rig.processor, rig.vest, rig.now
    other.take()
    other.run(1)
    assert other.conduct.state(other.now) is LinkState.CONNECTED
    assert bits(other) == {"upload"}
    with pytest.raises(OrderError, match="the mission on board is not from this station"):
        other.order("start")


def test_a_mission_that_takes_the_place_of_ours_is_told() -> None:
    rig = ready()
    rig.vest.inside.radio.mission.id ^= 1
    rig.run(0.5)
    assert (Level.WARNING, True) in [(level, "another station" in text) for level, text in rig.events]
    assert rig.conduct.on_board is None


def test_no_mission_is_uploaded_while_one_is_under_way() -> None:
    rig = under_way()
    rig.order("draft", mission=as_json(OTHER))
    with pytest.raises(OrderError, match="ABORT first"):
        rig.order("upload")
    assert rig.conduct.on_board is not None
    assert rig.conduct.on_board.id != rig.conduct.draft_id, "what is on screen differs from what is led"
    rig.run(1)
    assert rig.conduct.state(rig.now) is LinkState.RUNNING


# STOP -----------------------------------------------------------------------------------------------------


def test_stop_is_played_within_two_ticks_and_latches() -> None:
    rig = under_way()
    assert rig.run(1)[-1] is Command.FORWARD
    rig.order("stop")
    played = rig.run(5)
    assert Command.STOP in played[:2], "a tick with a fix makes the radio wait for one"
    assert set(played[2:]) == {Command.STOP}
    rig.order("clear_stop")
    assert rig.run(4)[-1] is Command.FORWARD, "the mission goes on"


def test_stop_lets_go_of_what_is_held() -> None:
    rig = under_way()
    rig.order("hold", command="LEFT")
    rig.order("stop")
    assert rig.conduct.holding is None
    assert Command.LEFT not in rig.run(0.2)


def test_a_stop_without_commander_and_mission_keeps_no_vest_awake() -> None:
    rig = connected()
    rig.order("stop")
    rig.alive.clear()
    rig.run(2.5)
    assert not any(rig.tick() is not None and rig.sent for _ in range(100))


def test_stop_that_is_lost_on_the_air_is_sent_again() -> None:
    rig = under_way()
    rig.uplink = False
    rig.order("stop")
    rig.run(0.2)
    rig.uplink = True
    assert Command.STOP in rig.run(0.5)


def test_who_watches_may_stop_and_may_do_nothing_else() -> None:
    rig = under_way()
    rig.conduct.desk.join(2)
    for name in set(ORDERS) - {"stop", "note", "alive", "take"}:
        with pytest.raises(OrderError, match="operator 1 commands, operator 2 watches"):
            rig.order(name, 2, command="LEFT", mission=as_json(OTHER))
    rig.order("stop", 2)
    assert set(rig.run(2)[2:]) == {Command.STOP}
    with pytest.raises(OrderError):
        rig.order("clear_stop", 2)


def test_a_hold_is_refused_while_stop_is_latched() -> None:
    rig = under_way()
    rig.order("stop")
    with pytest.raises(OrderError, match="STOP is latched, and beats LEFT"):
        rig.order("hold", command="LEFT")


def test_a_latched_stop_holds_over_a_vest_that_begins_anew() -> None:
    rig = under_way()
    rig.order("stop")
    rig.run(1)
    rig.reset()
    assert Command.STOP in rig.run(2)
    assert rig.conduct.latched
    assert Ready.RELEASED not in Ready(rig.vest.telemetry.ready), "an override is in force"


def test_a_cleared_stop_is_let_go_however_many_releases_get_lost() -> None:
    rig = under_way()
    rig.order("stop")
    rig.run(1)
    rig.lost = {Override.type}
    rig.order("clear_stop")
    assert set(rig.run(1.6)) == {Command.STOP}, "the vest holds it"
    rig.lost = set()
    rig.run(1)
    assert Ready.RELEASED in Ready(rig.vest.telemetry.ready)
    assert rig.is_started


def test_a_stop_that_the_vest_may_not_have_heard_yet_is_let_go_until_it_hears_that() -> None:
    rig = under_way()
    rig.lost = {Override.type}
    rig.order("stop")
    rig.run(0.2)
    rig.order("clear_stop")
    rig.run(1)
    assert Ready.RELEASED in Ready(rig.vest.telemetry.ready), "it never heard STOP, which may come late"
    assert overrides(rig, 0.5) == {Command.NONE}


def test_a_stop_is_let_go_until_the_vest_has_done_so_whatever_else_it_hears() -> None:
    rig = drawn()
    rig.order("stop")
    rig.run(1)
    rig.lost = {Override.type}
    rig.order("clear_stop")
    rig.tick()
    rig.order("upload")
    rig.until(lambda: rig.conduct.on_board is not None, 1)
    rig.lost = set()
    rig.run(1)
    assert Ready.RELEASED in Ready(rig.vest.telemetry.ready)


def test_a_stop_after_one_that_was_cleared_is_let_go_by_nothing() -> None:
    rig = connected()
    rig.conduct.desk.join(2)
    rig.order("stop")
    rig.run(0.5)
    rig.lost = {Override.type}
    rig.order("clear_stop")
    rig.tick()
    rig.order("stop", 2)
    rig.lost = set()
    rig.conduct.leave(rig.now, 1)
    rig.alive.clear()
    assert Command.NONE not in overrides(rig, 1)


def test_a_station_that_is_killed_leaves_a_latched_stop_with_the_vest() -> None:
    rig = under_way()
    rig.order("stop")
    rig.run(0.5)
    rig.uplink = False
    played = rig.run(5)
    assert set(played[:75]) == {Command.STOP}
    assert set(played[75:]) <= {Command.STOP, Command.NONE}
    assert rig.vest.telemetry.status == Status.STOPPED, "the lost link ended the mission"


def test_when_nobody_commands_a_mission_that_a_latched_stop_holds_is_aborted_and_never_goes_on() -> None:
    rig = under_way()
    rig.order("stop")
    rig.run(1)
    rig.alive.clear()
    played = rig.run(6)
    assert Command.FORWARD not in played
    assert not rig.is_started
    assert rig.texts().count("STOP is latched and nobody commands: the mission is aborted") == 1


# ABORT ----------------------------------------------------------------------------------------------------


def test_an_abort_ends_the_mission_and_what_is_held() -> None:
    rig = under_way()
    rig.order("hold", command="RECALL")
    rig.run(0.2)
    rig.order("abort")
    assert set(rig.run(1)[2:]) == {Command.STOP}
    assert not rig.is_started
    assert rig.conduct.holding is None
    assert not rig.conduct.pending()["aborting"], "the telemetry showed its effect"


def test_an_abort_is_sent_until_the_vest_has_heard_it() -> None:
    rig = under_way()
    rig.uplink = False
    rig.order("abort")
    rig.run(0.5)
    assert rig.conduct.pending()["aborting"]
    rig.uplink = True
    rig.run(1)
    assert not rig.is_started
    assert rig.vest.telemetry.status in (Status.STOPPED, Status.IDLE)


def test_an_abort_counts_as_heard_by_its_effect() -> None:
    rig = under_way()
    rig.lost = {Abort.type}
    rig.order("abort")
    rig.tick()
    rig.order("hold", command="RECALL")  # whose frames pass
    rig.run(0.5)
    assert rig.conduct.pending()["aborting"]


def test_an_abort_while_no_mission_is_under_way_waits_until_it_is_heard() -> None:
    rig = connected()
    rig.uplink = False
    rig.order("abort")
    rig.run(0.5)
    assert rig.conduct.pending()["aborting"], "a START may be on its way"
    rig.uplink = True
    rig.run(0.5)
    assert not rig.conduct.pending()["aborting"]


def test_a_station_that_ends_aborts_twice() -> None:
    assert [frame[2] for frame in under_way().conduct.farewell()] == [Abort.type] * 2


# what is held ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("command", ["FORWARD", "LEFT", "RIGHT", "RECALL"])
def test_a_command_is_played_while_it_is_held_and_let_go_by_a_release(command: str) -> None:
    rig = connected()
    played = []
    for _ in range(10):
        rig.order("hold", command=command)
        played += rig.run(0.12)
    assert set(played[2:]) == {Command[command]}
    rig.order("release")
    assert Command[command] not in rig.run(1)[2:]


def test_a_hold_that_is_not_renewed_for_three_tenths_is_let_go() -> None:
    rig = connected()
    rig.order("hold", command="LEFT")
    played = rig.run(1)
    held = sum(command is Command.LEFT for command in played) * TICK
    assert 0.24 <= held <= 0.3 + 3 * TICK
    assert "LEFT is let go" in rig.texts()


def test_a_hold_lasts_for_three_tenths() -> None:
    rig = connected()
    rig.order("hold", command="LEFT")
    rig.conduct.step(rig.now + 0.29)
    assert rig.conduct.holding is Command.LEFT
    rig.conduct.step(rig.now + 0.31)
    assert rig.conduct.holding is None


def test_a_vest_that_begins_anew_is_held_to_nothing() -> None:
    rig = connected()
    rig.reset()
    rig.order("hold", command="LEFT")
    rig.until(lambda: rig.conduct.link.sessions == 2, 0.28)
    assert rig.conduct.holding is None


def test_who_is_gone_lets_go_for_a_second_and_then_not_a_byte_is_sent() -> None:
    rig = connected()
    rig.order("hold", command="LEFT")
    rig.tick()
    rig.downlink = False  # nobody hears that the vest let go
    rig.conduct.leave(rig.now, 1)
    rig.alive.clear()
    sent = [bool(rig.tick() is not None and rig.sent) for _ in range(round(4 / TICK))]
    assert any(sent[: round(1 / TICK)])
    assert not any(sent[round(1.1 / TICK) :])


def test_what_a_commander_holds_is_let_go_when_it_leaves_hands_over_or_another_takes() -> None:
    for end in ("leave", "hand_over", "take"):
        rig = connected()
        rig.order("hold", command="LEFT")
        rig.tick()
        if end == "leave":
            rig.conduct.leave(rig.now, 1)
        elif end == "hand_over":
            rig.order("hand_over")
        else:
            rig.conduct.desk.offered = True
            rig.order("take", 2)
        assert rig.conduct.holding is None, end
        assert Command.LEFT not in rig.run(0.4)[3:], end


def test_stop_cannot_be_held_and_nonsense_is_refused_with_what_is_expected() -> None:
    rig = connected()
    with pytest.raises(OrderError, match="expected one of FORWARD, LEFT, RIGHT, RECALL"):
        rig.order("hold", command="STOP")
    with pytest.raises(OrderError, match="expected one of alive, take"):
        rig.order("sit")
    with pytest.raises(OrderError, match="expected one of alive, take"):
        rig.conduct.order(rig.now, 1, {"do": ["stop"]})
    with pytest.raises(OrderError, match="draft: waypoints"):
        rig.order("draft", mission={"home": None, "waypoints": [[91, 0]]})
    with pytest.raises(OrderError, match="the mission has no home"):
        rig.order("upload")


@pytest.mark.parametrize(
    ("key", "words"),
    [
        (
            Key(bytes(range(100, 116))),
            "frames come that another key signed, or none; is --key the vest's?",
        ),
        (None, "it is there, and does not answer this station; is its key this one?"),
    ],
)
def test_a_station_with_another_key_says_why_the_vest_is_not_heard(key: Key | None, words: str) -> None:
    rig = Rig()
    rig.conduct = Conduct(Link(key))
    rig.take()
    rig.run(3)
    said = [reason["words"] for reason in rig.conduct.missing(rig.now)]
    assert said == [f"the vest is not heard: {words}"]
    alarms = [alarm.text for alarm in Alarms().at(rig.now, rig.conduct, rig.now)]
    assert f"the vest is not heard: {words}" in alarms
    assert rig.vest.played[-1] in (Command.NONE, Command.STOP)


# who commands ---------------------------------------------------------------------------------------------


def test_a_dead_tab_is_not_kept_alive_the_vest_ends_its_mission_as_with_a_lost_link() -> None:
    rig = under_way()
    rig.alive.clear()
    rig.run(1.1)
    assert "is silent: the heartbeat to the vest ends" in rig.texts()
    quiet = [rig.tick() is not None and rig.sent for _ in range(round(3 / TICK))]
    assert not any(quiet[1:]), "not a byte is sent"
    assert rig.vest.telemetry.status in (Status.STOPPED, Status.IDLE)
    assert "the radio link was lost (rule 9)" in rig.texts()


def test_a_socket_that_is_gone_ends_the_heartbeat_at_once() -> None:
    rig = under_way()
    rig.conduct.leave(rig.now, 1)
    rig.alive.clear()
    rig.tick()
    assert not any(rig.tick() is not None and rig.sent for _ in range(25))
    assert "operator 1, who commanded, is gone" in rig.texts()
    assert "is silent" not in rig.texts()


def test_a_second_commander_is_refused_while_the_first_one_lives() -> None:
    rig = under_way()
    with pytest.raises(OrderError, match="take: operator 1 commands; expected that it hands over"):
        rig.order("take", 2)
    assert rig.conduct.desk.commander == 1


def test_another_may_take_the_command_of_a_dead_tab() -> None:
    rig = under_way()
    rig.alive.clear()
    rig.run(1.2)
    rig.take(2)
    rig.run(2)
    assert rig.conduct.desk.commander == 2
    assert rig.conduct.state(rig.now) is LinkState.RUNNING, "it took it before the vest lost its link"


def test_a_hand_over_keeps_the_vest_going_until_the_other_takes() -> None:
    rig = under_way()
    rig.order("hand_over")
    rig.run(3)
    assert rig.conduct.desk.commander == 1
    rig.take(2)
    rig.alive = {2}
    rig.run(3)
    assert rig.conduct.desk.commander == 2
    assert not rig.conduct.desk.offered
    assert rig.conduct.state(rig.now) is LinkState.RUNNING
    with pytest.raises(OrderError, match="operator 2 commands"):
        rig.order("abort", 1)


def test_who_commands_already_takes_nothing() -> None:
    rig = connected()
    rig.order("hold", command="LEFT")
    rig.order("take")
    rig.tick()
    assert rig.conduct.holding is Command.LEFT
    assert rig.texts().count("operator 1 commands") == 1


def test_who_hands_over_may_think_better_of_it() -> None:
    rig = Rig()
    rig.take()
    rig.order("hand_over")
    rig.order("take")
    with pytest.raises(OrderError):
        rig.order("take", 2)


def test_without_a_commander_greetings_are_too_rare_to_keep_a_mission_going() -> None:
    rig = under_way()
    rig.conduct.leave(rig.now, 1)
    rig.alive.clear()
    times = []
    for k in range(round(9 / TICK)):
        if k % 10 == 0:  # somebody plays a recording: the session flips
            rig.conduct.telemetry = None
        rig.tick()
        if rig.sent:
            times.append(rig.now)
    gaps = [later - before for before, later in pairwise(times)]
    assert times
    assert min(gaps) > 2 + TICK, "longer than watchdog.link_timeout"


def test_a_vest_that_begins_anew_again_and_again_is_greeted_no_more_often() -> None:
    rig, times = Rig(), []
    for k in range(round(7 / TICK)):
        if k % 20 == 10:
            rig.reset()
        rig.tick()
        if rig.sent:
            times.append(rig.now)
    assert len(times) > 1
    assert min(later - before for before, later in pairwise(times)) > 2 + TICK


# the vest -------------------------------------------------------------------------------------------------


def test_a_vest_that_begins_anew_needs_mission_and_start_again() -> None:
    rig = under_way()
    rig.reset()
    rig.run(3)
    assert "the vest has begun anew: the mission under way is over; upload again" in rig.texts()
    assert rig.conduct.state(rig.now) is LinkState.CONNECTED
    assert rig.conduct.on_board is None
    assert "another station" not in rig.texts()
    assert not rig.is_started
    rig.order("upload")
    rig.until(lambda: rig.conduct.state(rig.now) is LinkState.READY)
    rig.order("start")
    rig.until(lambda: rig.is_started)


def test_a_vest_that_is_silent_for_2_s_is_disconnected_and_told() -> None:
    rig = under_way()
    rig.downlink = False
    rig.run(1.7)
    assert rig.conduct.state(rig.now) is LinkState.RUNNING
    rig.run(0.6)
    assert rig.conduct.state(rig.now) is LinkState.DISCONNECTED
    assert "the vest has not been heard for 2 s" in rig.texts()
    with pytest.raises(OrderError, match="the vest is not heard"):
        rig.order("hold", command="LEFT")
    rig.downlink = True
    rig.run(0.5)
    assert rig.texts().count("the vest is heard") == 2


def test_a_mission_that_the_vest_ended_is_not_under_way() -> None:
    rig = under_way()
    rig.uplink = False
    rig.run(3)
    assert rig.is_started, "until an ABORT makes room for another"
    assert not rig.conduct.is_under_way
    assert rig.conduct.state(rig.now) is LinkState.LOADED


def test_a_vest_that_was_heard_and_is_silent_is_not_said_to_have_another_key() -> None:
    rig = connected()
    rig.conduct.link.decoder.forged = rig.conduct.link.unanswered = 100
    rig.downlink = False
    rig.run(2.5)
    assert [reason["words"] for reason in rig.conduct.missing(rig.now)] == ["the vest is not heard"]


def test_a_reset_is_no_silence() -> None:
    rig = connected()
    rig.reset()
    rig.run(1)
    assert "has not been heard" not in rig.texts()


def test_an_abort_is_not_forgotten_when_somebody_plays_another_session() -> None:
    rig = under_way()
    rig.uplink = False
    rig.order("abort")
    rig.tick()
    session = rig.vest.inside.radio.session
    rig.vest.inside.radio.session = session + 7
    rig.run(0.4)
    rig.vest.inside.radio.session = session
    rig.uplink = True
    rig.run(1.5)
    assert not rig.is_started


def test_an_abort_is_heard_by_the_counters_of_the_session_in_which_it_was_sent() -> None:
    rig = under_way()
    rig.uplink = False
    rig.order("abort")
    rig.run(0.5)
    rig.reset()
    rig.uplink = True
    rig.run(1)
    assert not rig.conduct.pending()["aborting"]


def test_a_session_without_counters_is_told_as_often_as_frames_would_be_sent() -> None:
    rig = drawn()
    rig.conduct.link.counter = LAST
    rig.order("upload")
    rig.run(2)
    assert not rig.conduct.pending()["uploading"]
    assert 2 <= rig.texts().count("has no counter left: restart it") <= 10


def test_a_note_is_an_event_and_an_empty_one_is_refused() -> None:
    rig = Rig()
    rig.conduct.desk.join(3)
    rig.order("note", 3, text="the dog \x1b[31m limps ")
    rig.tick()
    assert "note of operator 3: the dog \\x1b[31m limps" in rig.texts()
    rig.order("note", 3, text="x" * 500)
    for text in (" ", "x" * 501):
        with pytest.raises(OrderError, match="1 to 500 characters"):
            rig.order("note", 3, text=text)


def test_a_mission_needs_waypoints_and_a_fence_that_is_a_polygon() -> None:
    rig = connected()
    rig.order("draft", mission={"home": [HOME.latitude, HOME.longitude], "waypoints": []})
    with pytest.raises(OrderError, match="the mission has no waypoints"):
        rig.order("upload")
    flat = [[32.6, -85.49], [32.601, -85.49], [32.602, -85.49]]
    rig.order("draft", mission=as_json(MISSION) | {"fence": flat})
    assert rig.conduct.draft_id is None
    with pytest.raises(OrderError, match="no polygon"):
        rig.order("upload")
