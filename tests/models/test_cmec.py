"""The controller: equations 4.1-4.4, every row of Figure 4.2 and Table 4.3, both readings, the safety rules.

Safety rules, which the tests name by number:
1. What beats what: a lost link (STOP), the operator's override, bad input (STOP), an invalid estimate (STOP),
   the table.
2. An input that is NaN, infinite or out of its declared range never reaches a command; a running trial
   reports it.
3. Outputs are always finite and within their declared ranges; a command is one of the enumeration.
4. After an interruption the controller begins again from a stop that is held.
5. Withdrawing start stops the trial.
6. The operator's command is passed through unchanged.
7. No trial counts more than MAXTURN directional commands.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from models.cmec import MAX_WAYPOINTS, Cmec
from models.commands import Command, Status
from models.kit.block import Block
from models.kit.declaration import Type
from models.kit.model import Model
from models.kit.tracing import GROUPS, Update
from models.modes import LEADING, Anomaly, Mode
from models.readings import READINGS
from models.system import CONTROLLERS
from tests.models.leading import DEG, Trial

ROUTE = {
    "waypoint_count": 2,
    "waypoint_north[1]": 100.0,
    "waypoint_north[2]": 100.0,
    "waypoint_east[2]": 100.0,
}
LITERAL = {name.partition(".")[2]: value for name, value in READINGS["literal"].items()}
CALIBRATED = {name.partition(".")[2]: value for name, value in READINGS["calibrated"].items()}


def turning(h: float, **parameters: Any) -> Trial:
    """A trial in which a directional command has just been issued, the animal standing at h [deg]."""
    trial = Trial(**parameters)
    trial.tick(h=h, speed=0)
    trial.until(Command.RIGHT if h > 0 else Command.LEFT)
    return trial


def fail_turns(trial: Trial, count: int) -> None:
    """Let the animal not respond to so many issues of the command that is on, up to the next."""
    for _ in range(count):
        trial.tick(74)
        assert trial.tick(25) == Command.NONE
        trial.tick()


# Equations


@pytest.mark.parametrize(
    ("position", "heading", "distance", "deviation"),
    [
        ((0, 0), 0.1, 50.0, math.atan2(40, 30) - 0.1),  # the waypoint of the route below: 30 north, 40 east
        ((60, 80), 0.5, 50.0, math.atan2(-40, -30) - 0.5),  # -2.2143 - 0.5
        ((40, 41), 3.0, math.hypot(10, 1), math.atan2(-1, -10) - 3.0 + 2 * math.pi),  # wraps over south
        ((40, 39), -3.0, math.hypot(10, 1), math.atan2(1, -10) + 3.0 - 2 * math.pi),
        ((30, 0), 0.0, 40.0, math.pi / 2),
        ((40, 40), 0.0, 10.0, math.pi),  # straight behind: pi, not -pi
        ((40, 40), 6.9, 10.0, math.pi - 6.9 + 2 * math.pi),  # a heading beyond a turn: 2.5248
    ],
)
def test_distance_and_deviation_are_those_computed_by_hand(
    position: tuple[float, float], heading: float, distance: float, deviation: float
) -> None:
    """Eq. 4.1-4.4."""
    trial = Trial(route={"waypoint_north[1]": 30.0, "waypoint_east[1]": 40.0})
    trial.tick(north=position[0], east=position[1], heading=heading)
    assert trial.model["distance"] == pytest.approx(distance, rel=1e-15)
    assert trial.model["deviation"] == pytest.approx(deviation, abs=2e-15)
    assert -math.pi < trial.model["deviation"] <= math.pi + 4e-16


# Figure 4.2


def test_the_controller_is_idle_until_started() -> None:
    trial = Trial()
    trial.tick(10, start=0)
    assert (trial.mode, trial.status, trial.commands) == (Mode.IDLE, Status.IDLE, [Command.NONE] * 10)
    assert trial.tick(start=1) == Command.FORWARD
    assert trial.status == Status.RUNNING


def test_the_command_is_forward_until_the_waypoint_is_within_its_radius() -> None:
    # given an animal that runs north at 0.2 m a tick towards a waypoint 20 m away (d' = 7 m)
    trial = Trial(route={"waypoint_north[1]": 20.0})
    for k in range(100):
        if trial.tick(north=0.2 * k) != Command.FORWARD:
            break
    # then the stop comes on the first tick with d <= 7: 13 m on, at tick 65
    assert k == 65
    assert trial.mode == Mode.STOP_AT_WAYPOINT


@pytest.mark.parametrize("h", [49.001, -49.001, 120, -179])
def test_a_deviation_of_the_threshold_or_more_stops(h: float) -> None:
    trial = Trial()
    trial.tick(20, h=0)
    assert trial.tick(h=h) == Command.STOP
    assert trial.mode == Mode.STOP_TO_TURN


def test_a_deviation_below_the_threshold_does_not_stop() -> None:
    assert Trial().tick(20, h=48.999) == Command.FORWARD


def test_a_deviation_of_exactly_the_threshold_stops() -> None:
    # given h' = 0.5 rad, whose negative is a heading exactly
    trial = Trial(moving_deviation=0.5)
    trial.tick(heading=math.nextafter(-0.5, 0))
    below = trial.mode
    trial.tick(heading=-0.5)
    assert trial.model["deviation"] == 0.5  # atan2(0, north) is 0, and wrapping adds nothing
    assert (below, trial.mode) == (Mode.FORWARD, Mode.STOP_TO_TURN)


def test_a_stop_is_held_for_38_ticks_though_the_animal_stands() -> None:
    """DELAYTHRESH = 1.5 s: 37.5 ticks, so 38."""
    trial = Trial()
    trial.tick(h=60, speed=0)
    trial.until(Command.RIGHT)
    assert trial.phases() == [("STOP", 38), ("RIGHT", 1)]


@pytest.mark.parametrize(
    ("hold", "ticks"), [(1.49, 38), (1.48, 37), (1.0, 25), (1.01, 26), (0.0, 1), (100.0, 2500)]
)
def test_a_stop_is_held_for_no_less_than_the_parameter(hold: float, ticks: int) -> None:
    trial = Trial(stop_hold=hold)
    trial.tick(h=60, speed=0)
    trial.until(Command.RIGHT, 3000)
    assert trial.phases()[0] == ("STOP", ticks)


def test_a_stop_lasts_until_the_animal_is_slower_than_v() -> None:
    """V' = 0.3 m/s."""
    trial = Trial()
    trial.tick(200, h=60, speed=0.3)
    assert trial.phases() == [("STOP", 200)]
    assert trial.tick(speed=0.299) == Command.RIGHT


@pytest.mark.parametrize(
    ("h", "command"),
    [(60, Command.RIGHT), (20.001, Command.RIGHT), (19.999, Command.FORWARD), (0, Command.FORWARD),
     (-19.999, Command.FORWARD), (-20.001, Command.LEFT), (-60, Command.LEFT), (180, Command.RIGHT)],
)  # fmt: skip
def test_after_the_stop_the_command_is_a_turn_to_the_side_of_h_or_forward(h: float, command: Command) -> None:
    """h'' = 20 deg, checked again once the animal stands (4.1.4.1)."""
    trial = Trial()
    trial.tick(h=60, speed=0)
    trial.tick(38, h=h)
    assert trial.commands[-1] == command
    assert trial.model["directional_commands"] == (command in (Command.LEFT, Command.RIGHT))


@pytest.mark.parametrize(
    ("parameters", "end"), [(CALIBRATED, 5), (LITERAL, 20), ({"turn_end_deviation": 0.2}, 0.2 / DEG)]
)
@pytest.mark.parametrize("side", [1, -1])
def test_a_turn_ends_below_its_end_deviation(parameters: dict[str, Any], end: float, side: int) -> None:
    trial = turning(side * 60, **parameters)
    turn = trial.commands[-1]
    assert trial.tick(20, h=side * (end + 0.001)) == turn
    assert trial.tick(h=side * (end - 0.001)) == Command.FORWARD


@pytest.mark.parametrize(("limited", "command"), [(1, Command.RIGHT), (0, Command.FORWARD)])
def test_a_stop_threshold_above_the_moving_one_may_be_limited_to_it(limited: int, command: Command) -> None:
    """CHOICES.md: h'' in force is min(h'', h') in the calibrated reading; literally it livelocks."""
    trial = Trial(moving_deviation=15 * DEG, limit_stop_deviation=limited)
    trial.tick(39, h=17, speed=0)
    assert trial.commands[-1] == command
    if not limited:
        trial.tick(39 * 4)
        assert trial.phases()[:4] == [("STOP", 38), ("FORWARD", 1), ("STOP", 38), ("FORWARD", 1)]


def test_a_waypoint_is_won_while_turning() -> None:
    trial = turning(60)
    assert trial.tick(north=995) == Command.STOP
    assert trial.mode == Mode.STOP_AT_WAYPOINT


def test_a_waypoint_is_won_while_stopping_and_the_stop_is_not_begun_anew() -> None:
    trial = Trial(route=ROUTE)
    trial.tick(20, h=60, speed=0.5)
    trial.tick(north=93.5, speed=0)
    assert trial.mode == Mode.STOP_AT_WAYPOINT
    trial.until(Command.RIGHT, heading=0)  # the next waypoint lies east
    assert trial.phases() == [("STOP", 38), ("RIGHT", 1)]
    assert trial.model["waypoint"] == 1


def test_the_next_waypoint_follows_a_stop_and_recall_follows_the_last() -> None:
    # given a route north, then east, and an animal that looks straight at each waypoint
    trial = Trial(route=ROUTE)
    trial.tick(10, heading=0)
    trial.tick(north=94, speed=5)
    assert trial.mode == Mode.STOP_AT_WAYPOINT
    assert trial.model["waypoint"] == 0  # reached counts when it stands
    assert trial.model["distance"] == pytest.approx(6)
    trial.tick(37, speed=0)
    # when it has stood, then the next waypoint is aimed at
    assert trial.tick(heading=math.atan2(100, 6)) == Command.FORWARD
    assert trial.model["waypoint"] == 1
    assert trial.model["distance"] == pytest.approx(math.hypot(6, 100))
    assert trial.model["deviation"] == pytest.approx(0, abs=1e-15)
    # and after the last one the animal is recalled to its home
    trial.tick(east=99, north=99, speed=5)
    trial.tick(speed=0)
    assert trial.until(Command.RECALL) == 37
    assert trial.model["waypoint"] == 2
    assert trial.model["distance"] == pytest.approx(99 * math.sqrt(2))
    # until it is within 7 m of it: success
    assert trial.tick(north=7.01, east=0, speed=5) == Command.RECALL
    assert trial.tick(north=7.0) == Command.NONE
    assert (trial.mode, trial.status) == (Mode.SUCCESS, Status.SUCCESS)
    assert trial.tick(100, north=50) == Command.NONE
    assert trial.status == Status.SUCCESS
    assert trial.anomalies == []


def test_home_is_where_the_parameters_say() -> None:
    trial = Trial(route={"waypoint_north[1]": 5.0}, home_north=30.0, home_east=40.0)
    trial.until(Command.RECALL, speed=0)
    assert trial.model["distance"] == 50
    trial.tick(north=30, east=33)
    assert trial.status == Status.SUCCESS


@pytest.mark.parametrize("count", [1, 5, MAX_WAYPOINTS])
def test_all_waypoints_are_visited_in_their_order(count: int) -> None:
    # given waypoints on a diagonal, and an animal that is at each as soon as it is aimed at
    route = {f"waypoint_{axis}[{i}]": 20.0 * i for i in range(1, count + 1) for axis in ("north", "east")}
    trial = Trial(route=route | {"waypoint_count": count})
    for i in range(1, count + 1):
        trial.tick(north=20.0 * i, east=20.0 * i, heading=math.pi / 4)
        assert trial.model["distance"] == 0, f"waypoint {i}"
        assert trial.until(Command.RECALL if i == count else Command.FORWARD, speed=0) == 38
        assert trial.model["waypoint"] == i
    trial.tick(north=0, east=0)
    assert trial.status == Status.SUCCESS


# Anomalies of Table 4.3


def test_turn_failure_after_3_s_then_a_dead_second_then_again() -> None:
    trial = turning(60)
    fail_turns(trial, 1)
    assert trial.phases() == [("STOP", 38), ("RIGHT", 75), ("NONE", 25), ("RIGHT", 1)]
    assert trial.anomalies == [(38 + 75, Anomaly.TURN_FAILURE)]
    assert trial.model["directional_commands"] == 2


@pytest.mark.parametrize("side", [1, -1])
def test_direction_switch_when_it_has_turned_too_far(side: int) -> None:
    # given an animal that turns on command, passes the target and comes to 20 deg on the other side
    trial = turning(side * 60)
    trial.tick(5, h=side * 10)
    trial.tick(h=-side * 19.999)
    assert trial.anomalies == []
    trial.tick(h=-side * 20.001)
    assert trial.anomalies == [(38 + 1 + 6, Anomaly.DIRECTION_SWITCH)]
    # then after a dead second the opposite is issued
    other = Command.LEFT if side > 0 else Command.RIGHT
    assert trial.tick(24) == Command.NONE
    assert trial.tick() == other
    assert trial.anomalies[1:] == []


def test_direction_switch_when_it_turns_the_wrong_way_round() -> None:
    trial = turning(170)
    trial.tick(h=-170)
    assert trial.anomalies == [(39, Anomaly.DIRECTION_SWITCH)]
    assert trial.until(Command.LEFT) == 25


def test_forward_failure_when_it_has_not_moved_a_metre_in_3_s() -> None:
    # given an animal that has moved 0.99 m since FORWARD was issued
    trial = Trial()
    trial.tick()
    trial.until(Command.NONE, north=0.7, east=0.7, heading=0.0)
    assert trial.phases() == [("FORWARD", 75), ("NONE", 1)]
    assert trial.anomalies == [(75, Anomaly.FORWARD_FAILURE)]
    # then a dead second, and forward again
    assert trial.until(Command.FORWARD) == 25
    # and where it stands now counts as the start of the next metre
    assert trial.until(Command.NONE) == 75
    assert [a for _, a in trial.anomalies] == [Anomaly.FORWARD_FAILURE] * 2


def test_no_forward_failure_when_it_has_moved_a_metre() -> None:
    trial = Trial()
    trial.tick()
    trial.tick(200, north=0.71, east=0.71)
    assert trial.phases() == [("FORWARD", 201)]


def test_progress_is_judged_once_when_forward_has_lasted_its_time() -> None:
    # given an animal that has moved 1 m within 3 s, when it comes back later, then nothing is reported
    trial = Trial()
    trial.tick()
    trial.tick(75, north=1.1)
    trial.tick(20, north=0.0)
    assert trial.anomalies == []


def test_no_command_when_the_animal_has_turned_in_the_dead_second() -> None:
    trial = turning(60)
    trial.tick(80)
    assert trial.commands[-1] == Command.NONE
    assert trial.until(Command.FORWARD, h=10) == 20
    assert trial.anomalies[-1] == (38 + 100, Anomaly.NO_COMMAND)
    assert trial.model["directional_commands"] == 1


def test_no_command_when_the_opposite_turn_is_needed_after_the_dead_second() -> None:
    trial = turning(60)
    trial.tick(80)
    trial.until(Command.LEFT, h=-60)
    assert trial.anomalies[-1][1] == Anomaly.NO_COMMAND
    # a command that was not planned counts: it is not issued again
    assert trial.model["turns"] == 2


def test_no_command_when_the_waypoint_is_won_in_the_dead_second() -> None:
    trial = turning(60)
    trial.tick(80)
    assert trial.tick(north=1000) == Command.STOP
    assert (trial.mode, trial.anomalies[-1][1]) == (Mode.STOP_AT_WAYPOINT, Anomaly.NO_COMMAND)


def test_no_command_when_forward_is_planned_and_the_animal_has_turned_away() -> None:
    trial = Trial()
    trial.tick(80, speed=0)
    assert trial.mode == Mode.DEAD
    trial.until(Command.STOP, h=60)
    assert trial.anomalies[-1][1] == Anomaly.NO_COMMAND


def test_trial_failure_when_a_third_directional_command_is_due() -> None:
    # given an animal that has been commanded to turn twice
    trial = Trial()
    for turn in range(2):
        trial.until(Command.STOP, h=60, speed=0)
        trial.until(Command.RIGHT)
        trial.tick(h=0)
        assert trial.model["turns"] == turn + 1
        trial.tick(5, speed=5)
    # when a third is due, then the trial has failed and the animal is recalled
    trial.tick(h=60, speed=0)
    assert trial.until(Command.RECALL) == 38
    assert trial.anomalies == [(len(trial.commands) - 1, Anomaly.TRIAL_FAILURE)]
    assert (trial.mode, trial.status) == (Mode.FAILURE_RECALL, Status.FAILED)
    assert trial.model["directional_commands"] == 2
    # until it is home
    trial.tick(10, north=8)
    assert trial.commands[-1] == Command.RECALL
    assert trial.tick(north=6) == Command.NONE
    assert (trial.mode, trial.status) == (Mode.FAILED, Status.FAILED)


def test_with_max_turns_0_the_first_turn_fails_the_trial() -> None:
    trial = Trial(max_turns=0)
    trial.tick(39, h=60, speed=0)
    assert trial.status == Status.FAILED


# The two readings


def test_in_the_calibrated_reading_a_reissue_after_turn_failure_does_not_count() -> None:
    trial = turning(60, **CALIBRATED)
    fail_turns(trial, 5)
    assert trial.model["turns"] == 1
    assert trial.model["directional_commands"] == 6
    assert trial.status == Status.RUNNING


def test_in_the_literal_reading_every_directional_command_counts() -> None:
    trial = turning(60, **LITERAL)
    fail_turns(trial, 1)
    assert trial.model["turns"] == 2
    trial.tick(74)
    assert trial.until(Command.RECALL) == 26
    assert trial.status == Status.FAILED
    assert trial.model["directional_commands"] == 2


@pytest.mark.parametrize(("reading", "turns"), [(CALIBRATED, 2), (LITERAL, 1)])
def test_a_waypoint_resets_the_count_in_the_literal_reading_alone(
    reading: dict[str, Any], turns: int
) -> None:
    # given a turn on the way to the first waypoint
    trial = Trial(route=ROUTE, **reading)
    trial.tick(h=60, speed=0)
    trial.until(Command.RIGHT)
    trial.tick(north=95, h=0)
    # when another is issued at the waypoint, towards the next
    trial.until(Command.RIGHT)
    # then it is the second, or the first since the waypoint
    assert trial.model["turns"] == turns


def test_direction_switch_counts_in_both_readings() -> None:
    for reading in (CALIBRATED, LITERAL):
        trial = turning(60, **reading)
        trial.tick(h=-60)
        trial.until(Command.LEFT)
        assert trial.model["turns"] == 2


def test_direction_switch_after_a_reissue_counts() -> None:
    # given a RIGHT that was issued again after TURN FAILURE, which does not count
    trial = turning(60, **CALIBRATED)
    fail_turns(trial, 1)
    assert (trial.commands[-1], trial.model["turns"]) == (Command.RIGHT, 1)
    # when the animal turns too far, so that LEFT follows, then the LEFT counts
    trial.tick(h=-40)
    trial.until(Command.LEFT)
    assert trial.model["turns"] == 2


def test_a_second_trial_counts_its_directional_commands_anew() -> None:
    # given a trial with a directional command, ended by the operator
    trial = turning(60)
    assert trial.model["directional_commands"] == 1
    trial.tick(start=0)
    trial.tick(50)
    assert trial.mode is Mode.IDLE
    # when the next one begins
    trial.tick(start=1, h=0)
    assert (trial.mode, trial.model["directional_commands"]) == (Mode.FORWARD, 0)


def test_shipped_parameters_are_the_calibrated_reading() -> None:
    trial = Trial()
    assert {name: trial.model[name] for name in CALIBRATED} == CALIBRATED
    assert CALIBRATED.keys() == LITERAL.keys()


# Latching


def test_the_mission_is_latched_at_start() -> None:
    # given a running trial
    trial = Trial(route=ROUTE, home_north=1.0)
    trial.tick(north=50)
    # when every mission parameter is changed
    for name in ("waypoint_north", "waypoint_east"):
        for i in range(1, MAX_WAYPOINTS + 1):
            trial.model[f"{name}[{i}]"] = -500
    trial.model["waypoint_count"], trial.model["home_north"], trial.model["home_east"] = 7, -9, -9
    # then the trial goes on as it was begun
    trial.tick(north=50)
    assert trial.model["distance"] == 50
    trial.until(Command.FORWARD, north=100, heading=math.pi / 2, speed=0)
    assert trial.model["distance"] == 100
    trial.until(Command.RECALL, east=100)
    assert trial.model["distance"] == pytest.approx(math.hypot(99, 100))
    # and the next one takes the new mission
    trial.tick(2, north=1, east=0)
    trial.tick(2, start=0)
    trial.tick(start=1)
    assert trial.model["distance"] == pytest.approx(math.hypot(501, 500))
    assert (trial.model["waypoint"], trial.model["directional_commands"]) == (0, 0)


# Safety rules

LOST, OVERRIDE, BAD, INVALID = {"link_ok": 0}, {"override": Command.LEFT}, {"north": math.nan}, {"valid": 0}


@pytest.mark.parametrize(
    ("inputs", "command", "anomaly"),
    [
        (LOST, Command.STOP, Anomaly.LOST_LINK),
        (LOST | OVERRIDE, Command.STOP, Anomaly.LOST_LINK),
        (LOST | BAD, Command.STOP, Anomaly.LOST_LINK),
        (LOST | INVALID, Command.STOP, Anomaly.LOST_LINK),
        (LOST | OVERRIDE | BAD | INVALID, Command.STOP, Anomaly.LOST_LINK),
        (OVERRIDE, Command.LEFT, Anomaly.NONE),
        (OVERRIDE | BAD, Command.LEFT, Anomaly.NONE),
        (OVERRIDE | INVALID, Command.LEFT, Anomaly.NONE),
        (OVERRIDE | BAD | INVALID, Command.LEFT, Anomaly.NONE),
        (BAD, Command.STOP, Anomaly.BAD_INPUT),
        (BAD | INVALID, Command.STOP, Anomaly.BAD_INPUT),
        (INVALID, Command.STOP, Anomaly.INVALID_ESTIMATE),
        ({}, Command.FORWARD, Anomaly.NONE),
    ],
    ids=str,
)
def test_safety_1_order_of_precedence(inputs: dict[str, float], command: Command, anomaly: Anomaly) -> None:
    # given a running trial, when any of the four happens, then the first decides, and is reported once
    trial = Trial()
    trial.tick(10)
    trial.tick(5, **inputs)
    assert trial.commands[10:] == [command] * 5
    assert trial.anomalies == ([(10, anomaly)] if anomaly else [])
    assert sum(trial.model[f"anomalies[{a}]"] for a in range(1, len(Anomaly))) == bool(anomaly)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        (name, value)
        for name, limit in (("north", 1e5), ("east", 1e5), ("speed", 50), ("heading", 7))
        for value in (math.nan, math.inf, -math.inf, limit * 1.000001, -limit * 1.000001)
    ]
    + [("override", 6), ("override", -1), ("override", 2**31 - 1), ("override", math.nan)],
)
@pytest.mark.parametrize("mode", ["FORWARD", "STOP_TO_TURN", "RIGHT", "DEAD", "STOP_AT_WAYPOINT", "RECALL"])
def test_safety_2_bad_input_never_reaches_a_command(name: str, value: float, mode: str) -> None:
    # given a trial in each mode
    trial = Trial()
    trial.tick(5)
    if mode in ("STOP_TO_TURN", "RIGHT", "DEAD"):
        trial.tick(h=60, speed=0)
        trial.tick({"STOP_TO_TURN": 0, "RIGHT": 38, "DEAD": 38 + 75}[mode])
    if mode in ("STOP_AT_WAYPOINT", "RECALL"):
        trial.tick({"STOP_AT_WAYPOINT": 1, "RECALL": 40}[mode], north=1000, speed=0)
    assert trial.mode == Mode[mode]
    reported = len(trial.anomalies)
    # when an input is NaN, infinite or out of its range, then the command is STOP, with one report
    trial.tick(4, **{name: value})
    assert trial.commands[-4:] == [Command.STOP] * 4
    assert [a for _, a in trial.anomalies[reported:]] == [Anomaly.BAD_INPUT]
    assert math.isfinite(trial.model["distance"])
    assert math.isfinite(trial.model["deviation"])


@pytest.mark.parametrize("what", [LOST, {"override": Command.FORWARD}, BAD, INVALID], ids=str)
@pytest.mark.parametrize("at", [Mode.FORWARD, Mode.RIGHT, Mode.STOP_AT_WAYPOINT])
def test_safety_4_after_an_interruption_the_controller_begins_again_from_a_held_stop(
    what: dict[str, float], at: Mode
) -> None:
    # given a trial that is interrupted for 10 s
    trial = Trial(route=ROUTE)
    trial.tick(5)
    if at is Mode.RIGHT:
        trial.tick(h=60, speed=0)
        trial.until(Command.RIGHT)
    elif at is Mode.STOP_AT_WAYPOINT:
        trial.tick(3, north=100)
    assert trial.mode == at
    after = {name: trial.model[name] for name in what}
    if at is not Mode.STOP_AT_WAYPOINT:
        after["north"] = 0
    trial.tick(250, **what)
    # when that is over, the animal standing
    begun = len(trial.commands)
    trial.until(Command.RIGHT, **{**after, "h": 60, "speed": 0})
    # then a stop is held in full before the next command
    assert len(trial.commands) - begun >= 38
    assert set(trial.commands[begun:-1]) == {Command.STOP}


@pytest.mark.parametrize("mode", [Mode.RECALL, Mode.FAILURE_RECALL])
def test_an_interrupted_recall_goes_on(mode: Mode) -> None:
    trial = Trial(max_turns=0 if mode is Mode.FAILURE_RECALL else 2)
    trial.until(Command.RECALL, north=100 if mode is Mode.FAILURE_RECALL else 1000, h=60, speed=0)
    assert trial.mode == mode
    assert trial.tick(10, link_ok=0) == Command.STOP
    assert trial.tick(link_ok=1) == Command.RECALL


@pytest.mark.parametrize("inputs", [{}, LOST, BAD, INVALID], ids=str)
def test_safety_5_withdrawing_start_stops_the_trial(inputs: dict[str, float]) -> None:
    trial = Trial()
    trial.tick(10)
    # when start is withdrawn, then a stop is held as every stop is
    trial.tick(38, start=0, **inputs)
    assert (trial.commands[10:], trial.status) == ([Command.STOP] * 38, Status.STOPPED)
    # and then the controller is ready for the next trial
    trial.tick()
    assert (trial.mode, trial.status) == (Mode.IDLE, Status.IDLE)


def test_safety_5_a_stopped_trial_does_not_go_on_when_start_comes_back() -> None:
    trial = Trial()
    trial.tick(10)
    trial.tick(start=0)
    assert trial.tick(500, start=1) == Command.STOP
    assert trial.status == Status.STOPPED


@pytest.mark.parametrize("command", [c for c in Command if c is not Command.NONE])
@pytest.mark.parametrize("running", [True, False])
def test_safety_6_the_operators_command_is_passed_through(command: Command, running: bool) -> None:
    trial = Trial()
    trial.tick(5, start=running)
    assert trial.tick(override=command) == command
    assert trial.tick(50) == command
    assert trial.anomalies == []


def test_a_trial_does_not_begin_while_the_controller_is_blocked() -> None:
    trial = Trial()
    assert trial.tick(20, valid=0) == Command.STOP
    assert trial.mode == Mode.IDLE
    assert trial.tick(valid=1) == Command.FORWARD


def random_columns(
    block: type[Block], kind: str, count: int, generator: np.random.Generator
) -> np.ndarray[Any, Any]:
    """Values of all variables of a kind, one column for each of `count` draws."""
    rows = []
    for variable in (v for v in block.group(kind) for _ in range(v.width)):
        if variable.type is Type.REAL:
            rows.append(generator.uniform(variable.min or 0, 10, count))
        else:
            values = list(variable.choices) if variable.choices else [0, 1]
            rows.append(generator.choice([*values, 1000] if variable.name == "ticks" else values, count))
    return np.array(rows, dtype=float)


@pytest.mark.parametrize(
    ("block", "update"),
    [
        pytest.param(block, phase, id=f"{name}-{phase.name}")
        for name, block in CONTROLLERS.items()
        for phase in block.program().tick
        if isinstance(phase, Update) and "now" in phase.writes
    ],
)
def test_an_update_that_moves_the_mode_names_exactly_the_transitions_that_it_makes(
    block: type[Block], update: Update
) -> None:
    # given 3,000 random states, inputs and parameters in each mode
    generator = np.random.default_rng(1)
    states = block.flat_names("state")
    made = set()
    for mode in Mode:
        arguments = [random_columns(block, kind, 3000, generator) for kind in GROUPS]
        arguments[0][states.index("now")] = mode
        if "led" in states:
            arguments[0][states.index("led")] = mode in LEADING  # as `attend` leaves it
        # when the update runs where its guard holds
        holds = np.array(update.guard(*arguments)).ravel().astype(bool)
        results = np.array(update.function(*arguments))[update.writes.index("now"), holds]
        made |= {(mode, Mode(int(result))) for result in results}
    # then
    assert made == set(update.edges)


def test_only_these_updates_move_the_mode_beside_the_table() -> None:
    movers = [phase.name for phase in Cmec.program().tick if isinstance(phase, Update) and phase.edges]
    assert movers == ["begin", "end", "interrupt", "halt", "recall"]


def any_input() -> st.SearchStrategy[dict[str, float]]:
    """All inputs at once: mostly such that the table moves on, and anything else."""
    wild = st.floats() | st.sampled_from([math.nan, math.inf, -math.inf, 1e5, -1e5, 1.0000001e5])
    return st.fixed_dictionaries(
        {
            "north": st.sampled_from([0.0, 30.0, 94.0, 99.0]) | st.floats(-200, 200) | wild,
            "east": st.sampled_from([0.0, 94.0, 99.0]) | st.floats(-200, 200) | wild,
            "speed": st.sampled_from([0.0, 0.1, 0.5, 5.0]) | wild,
            "heading": st.floats(-math.pi, math.pi) | wild,
            "valid": st.sampled_from([1.0, 1.0, 1.0, 0.0]),
            "start": st.sampled_from([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]),
            "link_ok": st.sampled_from([1.0, 1.0, 1.0, 1.0, 0.0]),
            "override": st.sampled_from([0.0] * 6)
            | st.integers(0, 5).map(float)
            | st.integers(-(2**31), 2**31 - 1).map(float),
        }
    )


def plain_input() -> st.SearchStrategy[dict[str, float]]:
    """A trial without faults."""
    return st.fixed_dictionaries(
        {
            "north": st.sampled_from([0.0, 50.0, 99.0]),
            "east": st.sampled_from([0.0, 50.0, 99.0]),
            "speed": st.sampled_from([0.0, 5.0]),
            "heading": st.sampled_from([k * math.pi / 4 for k in range(-3, 5)]),
        }
    )


def good(inputs: dict[str, float]) -> bool:
    """Are all inputs numbers in their declared ranges?"""
    declared = Cmec.variables()
    return all(
        math.isfinite(v) and declared[n].min <= v <= declared[n].max  # type: ignore[operator]
        for n, v in inputs.items()
        if declared[n].type is not Type.BOOLEAN
    )


def check_rules(model: Model, inputs: dict[str, float], was_running: bool) -> None:
    """Rules 1 to 3 and 7, on the answer to these inputs."""
    # 3: finite, in range, of the enumeration
    for variable in Cmec.group("output"):
        variable.check(model[variable.name], variable.name)
    command, status = Command(int(model["command"])), Status(int(model["status"]))
    Mode(int(model["mode"]))
    Anomaly(int(model["anomaly"]))
    # 1 and 2: the order of precedence
    override = inputs["override"] if 1 <= inputs["override"] <= 5 else 0
    if not inputs["link_ok"]:
        assert command is Command.STOP
    elif override:
        assert command == override
    elif not good(inputs) or not inputs["valid"]:
        assert command is Command.STOP
    elif not inputs["start"]:
        assert command in (Command.STOP, Command.NONE)
    # 7: never more than MAXTURN counted
    assert model["turns"] <= model["max_turns"]
    if not was_running and not inputs["start"]:
        assert status in (Status.IDLE, Status.STOPPED)


@settings(max_examples=150, deadline=None)
@given(
    steps=st.lists(st.tuples(any_input(), st.sampled_from([1, 1, 2, 25, 40, 80])), min_size=1, max_size=12),
    reading=st.sampled_from([CALIBRATED, LITERAL]),
)
def test_safety_1_2_3_7_hold_for_any_inputs(steps: Iterable[Any], reading: dict[str, Any]) -> None:
    model = Model(Cmec, ROUTE | reading)
    model.initialize()
    for inputs, ticks in steps:
        for name, value in inputs.items():
            model[name] = value
        for _ in range(ticks):
            was_running = Status(int(model["status"])) is Status.RUNNING
            model.step()
            check_rules(model, inputs, was_running)


@settings(max_examples=150, deadline=None)
@example(steps=[({"north": 0.0, "east": 0.0, "speed": 0.0, "heading": math.pi}, 80)] * 4, reading=LITERAL)
@given(
    steps=st.lists(st.tuples(plain_input(), st.sampled_from([1, 2, 25, 40, 80])), min_size=5, max_size=30),
    reading=st.sampled_from([CALIBRATED, LITERAL]),
)
def test_safety_7_no_more_than_max_turns_are_counted(steps: Iterable[Any], reading: dict[str, Any]) -> None:
    # given a trial without faults
    trial = Trial(route=ROUTE, **reading)
    issued, past = 0, Command.NONE
    for inputs, ticks in steps:
        for _ in range(ticks):
            command = trial.tick(**inputs)
            # then every directional command issued is counted as issued ..
            issued += command in (Command.LEFT, Command.RIGHT) and command != past
            past = command
            assert trial.model["directional_commands"] == issued
            # .. and in the literal reading, at most two for each of the two waypoints
            assert trial.model["turns"] <= 2
            assert reading is CALIBRATED or issued <= 2 * 2
            assert trial.model["waypoint"] <= 2
