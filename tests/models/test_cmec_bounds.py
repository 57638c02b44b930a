"""The controller's bounds, counters and latches, one by one: each has a mutant that only its test notices."""

from __future__ import annotations

import math
from typing import Any

import pytest

from models.cmec import MAX_WAYPOINTS, Cmec
from models.commands import Command
from models.modes import Anomaly, Mode
from tests.models.leading import Trial

HOLD, TURN, DEAD = 38, 75, 25  # ticks of 1.5, 3 and 1 s
BOUND = 0.5  # rad, exact in binary, as is its negative
BELOW = math.nextafter(BOUND, 0)


def halted(**parameters: Any) -> Trial:
    """A trial in which the animal stands, and was told to stop."""
    trial = Trial(**parameters)
    trial.tick(heading=-1.5, speed=0)
    assert trial.mode == Mode.STOP_TO_TURN
    return trial


def turning(heading: float, **parameters: Any) -> Trial:
    """A trial in which a direction has just been told; the deviation is the heading's negative."""
    trial = halted(**parameters)
    trial.tick(heading=heading)
    trial.until(Command.RIGHT if heading < 0 else Command.LEFT)
    return trial


def test_a_mission_has_16_waypoints_and_maxturn_is_1000_at_most() -> None:
    assert MAX_WAYPOINTS == Cmec.variables()["route_north"].width == 16
    assert Cmec.variables()["max_turns"].max == 1000


# ties


@pytest.mark.parametrize(("h", "mode"), [(BOUND, Mode.RIGHT), (BELOW, Mode.FORWARD)])
def test_a_stopped_animal_at_exactly_the_stop_deviation_is_turned(h: float, mode: Mode) -> None:
    trial = halted(stop_deviation=BOUND)
    trial.tick(HOLD, heading=-h)
    assert trial.mode == mode


@pytest.mark.parametrize(("h", "mode"), [(0.25, Mode.RIGHT), (math.nextafter(0.25, 0), Mode.FORWARD)])
def test_a_turn_does_not_end_at_exactly_its_end_deviation(h: float, mode: Mode) -> None:
    trial = turning(-1.5, turn_end_deviation=0.25)
    trial.tick(heading=-h)
    assert trial.mode == mode


@pytest.mark.parametrize("side", [1, -1])
@pytest.mark.parametrize(("h", "switched"), [(BOUND, True), (BELOW, False)])
def test_a_turn_beyond_the_target_by_exactly_the_stop_deviation_is_a_switch(
    side: int, h: float, switched: bool
) -> None:
    trial = turning(-1.5 * side, stop_deviation=BOUND, turn_end_deviation=0.1)
    trial.tick(heading=side * h)
    assert (trial.mode == Mode.DEAD) == switched
    assert ((len(trial.commands) - 1, Anomaly.DIRECTION_SWITCH) in trial.anomalies) == switched


@pytest.mark.parametrize("side", [1, -1])
def test_a_turn_beyond_the_target_as_its_time_is_over_is_a_switch(side: int) -> None:
    # given a turn on whose last tick the animal is beyond the target
    trial = turning(-1.5 * side)
    trial.tick(TURN - 1)
    assert trial.anomalies == []
    trial.tick(heading=1.5 * side)
    # then it has turned too far, and has not failed to turn
    assert [anomaly for _, anomaly in trial.anomalies] == [Anomaly.DIRECTION_SWITCH]


@pytest.mark.parametrize(("h", "mode"), [(BOUND, Mode.STOP_TO_TURN), (BELOW, Mode.FORWARD)])
def test_behind_a_forward_failure_exactly_the_moving_deviation_stops(h: float, mode: Mode) -> None:
    trial = Trial(moving_deviation=BOUND)
    trial.tick(heading=0.0, speed=0)
    trial.until(Command.NONE)
    trial.tick(DEAD, heading=-h)
    assert trial.mode == mode


@pytest.mark.parametrize("turn", [Command.RIGHT, Command.LEFT])
def test_a_turn_at_a_deviation_of_exactly_0_goes_on_until_its_time_is_over(turn: Command) -> None:
    # given deviations that end a turn, and that call for one, of 0
    trial = turning(-1.5 if turn is Command.RIGHT else 1.5, stop_deviation=0, turn_end_deviation=0)
    # when the animal looks at the target
    trial.tick(TURN - 1, heading=0.0)
    # then it is no switch
    assert trial.commands[-1] == turn
    trial.tick()
    assert trial.anomalies == [(len(trial.commands) - 1, Anomaly.TURN_FAILURE)]


def test_a_deviation_of_exactly_0_is_turned_to_the_right_and_again_without_counting() -> None:
    # given one turn that may count
    trial = halted(stop_deviation=0, turn_end_deviation=0, max_turns=1)
    # when it is at 0
    trial.tick(HOLD, heading=0.0)
    assert trial.mode == Mode.RIGHT
    # then behind its failure it is told again
    trial.tick(TURN + DEAD)
    assert trial.mode == Mode.RIGHT


@pytest.mark.parametrize("side", [1, -1])
def test_a_turn_of_less_than_a_radian_is_told_again_without_counting(side: int) -> None:
    trial = turning(-0.7 * side, max_turns=1)
    trial.tick(TURN + DEAD)
    assert trial.mode == (Mode.RIGHT if side > 0 else Mode.LEFT)


@pytest.mark.parametrize(("moved", "failure"), [(1.75, True), (2.0, False), (2.25, False)])
def test_the_animal_must_move_the_forward_distance(moved: float, failure: bool) -> None:
    # given a distance of 2 m, whose square is not itself
    trial = Trial(forward_distance=2)
    trial.tick(heading=0.0)
    trial.tick(TURN + 2, north=moved)
    assert (Anomaly.FORWARD_FAILURE in [anomaly for _, anomaly in trial.anomalies]) == failure


# what is latched, and counted from when


def test_a_trial_begins_where_the_animal_is() -> None:
    # given an animal that begins far from the origin, and stays there
    trial = Trial()
    trial.tick(heading=0.0, north=-30.0, east=40.0)
    trial.tick(TURN + 1)
    # then it has not moved
    assert [anomaly for _, anomaly in trial.anomalies] == [Anomaly.FORWARD_FAILURE]


@pytest.mark.parametrize("axis", ["north", "east"])
def test_forward_is_judged_from_where_it_was_told_last(axis: str) -> None:
    # given an animal that went along one axis, was stopped, and is told to go on
    trial = Trial(route={"waypoint_north[1]": 1e4, "waypoint_east[1]": 0.0})
    trial.tick(50, heading=0.0)
    trial.tick(heading=-1.5, speed=0, **{axis: 60.0})
    trial.tick(heading=0.0)
    trial.until(Command.FORWARD)
    # when it stays
    trial.tick(TURN + 1)
    # then it has not moved
    assert trial.anomalies[-1][1] == Anomaly.FORWARD_FAILURE


def test_a_new_trial_counts_its_anomalies_from_0() -> None:
    # given a trial with anomalies that has ended
    trial = Trial()
    trial.tick(TURN + 10, heading=0.0, speed=0)
    assert trial.model[f"anomalies[{Anomaly.FORWARD_FAILURE}]"] == 1
    trial.tick(HOLD + 2, start=0)
    assert trial.mode == Mode.IDLE
    # when another begins
    trial.tick(start=1)
    assert [trial.model[f"anomalies[{a}]"] for a in Anomaly if a] == [0] * (len(Anomaly) - 1)


def test_after_a_failure_the_animal_is_recalled_to_the_home_that_was_latched() -> None:
    # given a home beside both axes, which changes behind the start
    trial = halted(max_turns=0, route={"waypoint_north[1]": 1000.0, "home_north": 30.0, "home_east": -40.0})
    trial.model["home_north"], trial.model["home_east"] = 500.0, 500.0
    # when the trial fails
    trial.until(Command.RECALL)
    # then the distance is that from the origin to the home at the start
    assert trial.mode == Mode.FAILURE_RECALL
    trial.tick()
    assert trial.model["distance"] == 50.0


def counted_since_entry(trial: Trial, mode: Mode) -> None:
    """The ticks of a mode just entered count from 0."""
    assert trial.mode == mode
    assert trial.model["ticks"] == 0
    trial.tick(3)
    assert trial.model["ticks"] == 3


def test_the_ticks_of_recall_and_success_count_from_their_beginning() -> None:
    trial = Trial(route={"waypoint_north[1]": 0.0, "home_north": 100.0})
    trial.tick(heading=0.0, speed=0)
    trial.until(Command.RECALL)
    counted_since_entry(trial, Mode.RECALL)
    trial.tick(north=100.0)
    counted_since_entry(trial, Mode.SUCCESS)


def test_the_ticks_of_a_failed_recall_and_of_failure_count_from_their_beginning() -> None:
    trial = halted(max_turns=0, route={"waypoint_north[1]": 1000.0, "home_north": 100.0})
    trial.until(Command.RECALL)
    counted_since_entry(trial, Mode.FAILURE_RECALL)
    trial.tick(north=100.0)
    counted_since_entry(trial, Mode.FAILED)


def test_a_stop_behind_the_dead_period_is_held_from_its_beginning() -> None:
    # given an animal that ignored FORWARD and looks away
    trial = Trial()
    trial.tick(heading=0.0, speed=0)
    trial.until(Command.NONE)
    trial.tick(heading=-1.5)
    trial.until(Command.STOP)
    # then the stop lasts as long as any
    assert trial.until(Command.RIGHT) == HOLD
    assert trial.phases()[-2:] == [("STOP", HOLD), ("RIGHT", 1)]


def test_an_interrupted_trial_goes_on_behind_a_stop_that_is_held_from_its_release() -> None:
    trial = Trial()
    trial.tick(heading=-1.5, speed=0)
    trial.tick(10, override=Command.FORWARD)
    # the first tick without the operator is the first of the stop, and no tick of his counts
    assert trial.until(Command.RIGHT, 400, override=Command.NONE) == HOLD


# blocked


@pytest.mark.parametrize("cause", [{"link_ok": 0}, {"override": Command.FORWARD}, {"valid": 0}])
def test_a_recall_is_not_won_while_others_lead_or_nobody(cause: dict[str, float]) -> None:
    # given a recall
    trial = Trial(route={"waypoint_north[1]": 0.0, "home_north": 100.0})
    trial.tick(heading=0.0, speed=0)
    trial.until(Command.RECALL)
    # when the animal comes home while the controller is blocked
    trial.tick(5, north=100.0, **cause)
    assert trial.model["mode"] == Mode.RECALL
    # then that counts behind it
    trial.tick(link_ok=1, override=Command.NONE, valid=1)
    assert trial.mode == Mode.SUCCESS


def test_a_waypoint_is_not_won_nor_left_under_the_operator() -> None:
    # given a stop that need not be held
    trial = Trial(
        stop_hold=0, route={"waypoint_count": 2, "waypoint_north[1]": 50.0, "waypoint_north[2]": 200.0}
    )
    trial.tick(heading=-1.5, speed=0)
    assert trial.model["mode"] == Mode.STOP_TO_TURN
    # when the operator leads the animal to the waypoint
    trial.tick(3, north=50.0, heading=0.0, override=Command.FORWARD)
    assert trial.model["mode"] == Mode.STOP_TO_TURN
    # then it counts once he lets go
    trial.tick(override=Command.NONE)
    assert trial.model["mode"] == Mode.STOP_AT_WAYPOINT
    # and is not left while he leads again
    trial.tick(3, override=Command.FORWARD)
    assert trial.model["waypoint"] == 0
    trial.tick(override=Command.NONE)
    assert trial.model["waypoint"] == 1


@pytest.mark.parametrize("name", ["north", "east", "heading"])
def test_on_bad_input_distance_or_deviation_are_0(name: str) -> None:
    trial = Trial()
    trial.tick(5, heading=0.25, **({name: math.nan} if name != "heading" else {}))
    trial.tick(**{name: math.nan})
    assert (trial.model["distance"], trial.model["deviation"]) == (0, 0)
