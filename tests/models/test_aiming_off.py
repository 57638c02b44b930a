"""Aiming off: the offset, the drift and response time that are learnt, lead and braking point, by hand."""

from __future__ import annotations

import math
from typing import Any

import pytest

from models.commands import Command
from models.kit.timing import TICK
from models.modes import Anomaly, Mode
from tests.models.leading import DEG, Trial

DRIFT = {"drift": 4 * DEG, "cruise_speed": 5.0, "starting_time": 1.0}  # b = 2 deg/s * (d / 5 m/s + 1 s)
NEAR = {"waypoint_north[1]": 20.0}  # b = 10 deg


def stopped(h: float, **parameters: Any) -> Trial:
    """A trial whose animal was stopped at h [deg], stands, and is told to turn."""
    trial = Trial(**({"route": NEAR} | parameters))
    trial.tick(h=h, speed=0)
    for _ in range(60):
        if trial.tick() in (Command.LEFT, Command.RIGHT):
            return trial
    raise AssertionError(f"no turn, but {trial.phases()}")


@pytest.mark.parametrize(
    ("parameters", "offset"),
    [
        ({}, 0),
        (DRIFT, 10),
        (DRIFT | {"drift": -4 * DEG}, -10),
        (DRIFT | {"cruise_speed": 2.0, "starting_time": 0.0}, 20),
        (DRIFT | {"route": {"waypoint_north[1]": 300.0}}, 44),  # 122 deg: h' = 49 deg less 5 deg
        (DRIFT | {"route": {"waypoint_north[1]": 300.0}, "moving_deviation": 60 * DEG}, 45),
        (DRIFT | {"route": {"waypoint_north[1]": 300.0}, "moving_deviation": 3 * DEG}, 0),
        (DRIFT | {"most_aim_off": 6 * DEG}, 6),
    ],
)
def test_a_turn_ends_where_the_drift_will_bring_the_animal_back(
    parameters: dict[str, Any], offset: float
) -> None:
    # given an animal 20 m from its waypoint that was stopped with it far to the right
    trial = stopped(80, **parameters)
    assert trial.model["offset"] / DEG == pytest.approx(offset)
    # then its turn ends within 5 deg of b, and not before
    assert trial.tick(h=offset + 5.01) == Command.RIGHT
    assert trial.tick(h=offset + 4.99) == Command.FORWARD


def test_the_side_of_a_turn_is_that_of_the_heading_that_is_aimed_at() -> None:
    # given a drift for which the waypoint should be 40 deg to the right, where it is 10 deg to the right
    trial = Trial(**DRIFT, route={"waypoint_north[1]": 95.0})
    trial.tick(h=60, speed=0)
    trial.tick(20, h=10)
    # then the animal is turned to the left, though the waypoint is to the right
    assert trial.until(Command.LEFT) > 0
    assert trial.model["offset"] / DEG == pytest.approx(40)
    # and a turn beyond 40 deg by h'' = 20 deg is a turn to the wrong side
    assert trial.tick(h=59.9) == Command.LEFT
    assert trial.tick(h=60.1) == Command.NONE
    assert trial.anomalies[-1][1] == Anomaly.DIRECTION_SWITCH


def test_behind_a_stop_the_animal_goes_on_only_if_forward_would_not_stop_it() -> None:
    # given h 16 deg off b = 40 deg, within h'' = 20 deg but beyond h' = 49 deg
    trial = Trial(**DRIFT, route={"waypoint_north[1]": 95.0})
    trial.tick(h=56, speed=0)
    # then it is turned; and not where h is less than h'
    assert trial.until(Command.RIGHT) == 38
    other = Trial(**DRIFT, route={"waypoint_north[1]": 95.0})
    other.tick(h=56, speed=0)
    assert other.until(Command.FORWARD, 400, h=48) == 38


def test_after_no_command_the_side_counts_from_the_heading_that_is_aimed_at() -> None:
    # given a turn to the left that failed, h 5 deg short of b = 10 deg by then but beyond h''
    trial = stopped(-60, **DRIFT)
    assert trial.commands[-1] == Command.LEFT
    trial.until(Command.NONE)
    # then it is told again, and not counted, though h has another sign
    trial.tick(h=-12)
    assert trial.until(Command.LEFT) > 0
    assert trial.model["turns"] == 1


def learnt(seconds: float, turned: float, **parameters: Any) -> Trial:
    """A trial whose animal ran for so long, turned by so much [deg], and was stopped then."""
    trial = Trial(**({"drift": 2 * DEG, "drift_sd": 1 * DEG, "heading_sd": 2 * DEG} | parameters))
    ticks = round(seconds / TICK)
    trial.tick(1, h=0)
    for k in range(ticks):
        trial.tick(h=-turned * k / ticks, north=5 * TICK * k)
    trial.tick(h=60 if turned < 0 else -60)
    trial.tick(h=-turned)
    return trial


def test_the_drift_is_learnt_by_a_scalar_kalman_filter() -> None:
    # given a drift of 2 +- 1 deg/s and headings good to 2 deg, over a run of 10 s that turned by 50 deg
    trial = learnt(10, 50, moving_deviation=55 * DEG)
    # then the change is good to 2 sqrt(2) deg / 10 s, and weighs 1 / (1 + 0.08)
    time = 10.04
    noise = 2 * 2**2 / time**2
    gain = 1 / (1 + noise)
    assert trial.model["learnt_drift"] / DEG == pytest.approx(2 + gain * (50 / time - 2), rel=1e-3)
    assert trial.model["drift_variance"] / DEG**2 == pytest.approx(1 - gain, rel=1e-3)


@pytest.mark.parametrize("persistence", [0.6, 0.0])
def test_a_drift_that_does_not_persist_goes_back_to_its_mean(persistence: float) -> None:
    # given a run as above, and a drift of which so much is left in the next run
    stays = learnt(10, 50, moving_deviation=55 * DEG)
    trial = learnt(10, 50, moving_deviation=55 * DEG, drift_persistence=persistence)
    # then so much of what was learnt is expected of that, and the rest of its variance is new
    more = persistence * (stays.model["learnt_drift"] / DEG - 2)
    assert trial.model["learnt_drift"] / DEG == pytest.approx(2 + more)
    left = persistence**2 * stays.model["drift_variance"] / DEG**2
    assert trial.model["drift_variance"] / DEG**2 == pytest.approx(left + 1 - persistence**2)


def test_a_mean_drift_is_not_learnt() -> None:
    trial = learnt(10, 50, drift_sd=0.0, moving_deviation=55 * DEG)
    assert (trial.model["learnt_drift"], trial.model["drift_variance"]) == (2 * DEG, 0)
    assert trial.model["offset"] == 0  # no turn was due yet


@pytest.mark.parametrize(
    "blocked", [{"valid": 0}, {"heading": math.nan}, {"override": Command.STOP}, {"link_ok": 0}], ids=str
)
def test_nothing_is_learnt_from_a_run_whose_end_is_not_seen(blocked: dict[str, float]) -> None:
    # given a run that ends in a stop, and an estimate that fails on the tick behind it
    trial = Trial(drift=2 * DEG, drift_sd=1 * DEG)
    for k in range(100):
        trial.tick(h=-0.2 * k, north=5 * TICK * k)
    trial.tick(h=-60)
    trial.tick(**blocked)
    trial.tick(heading=0, valid=1, override=Command.NONE, link_ok=1)
    assert (trial.model["learnt_drift"], trial.model["drift_variance"]) == (2 * DEG, (1 * DEG) ** 2)


def test_a_run_is_measured_from_when_the_animal_obeys() -> None:
    # given an animal that turns by 30 deg more before it obeys FORWARD after 0.4 s
    trial = Trial(drift=0.0, drift_sd=5 * DEG, response_time=0.4, moving_deviation=80 * DEG)
    for k in range(11):
        trial.tick(h=30 - 3 * k)
    for k in range(100):
        trial.tick(h=-0.1 * k, north=5 * TICK * k)
    trial.tick(h=-85)
    trial.tick(h=-10)
    # then only the 10 deg of its run count: 2.5 deg/s over 4 s
    assert trial.model["learnt_drift"] / DEG == pytest.approx(2.3, abs=0.1)


def test_a_new_trial_begins_with_what_is_known_of_all_animals() -> None:
    trial = learnt(10, 50, moving_deviation=55 * DEG)
    trial.tick(38, start=0)
    trial.tick(3, h=0)
    assert trial.mode == Mode.IDLE
    assert trial.tick(start=1) == Command.FORWARD
    assert (trial.model["learnt_drift"], trial.model["drift_variance"]) == (2 * DEG, (1 * DEG) ** 2)


def turned(rate: float, ticks: int, response: float = 0.4, **parameters: Any) -> Trial:
    """A trial whose animal stands at 90 deg, and turns to the right at a rate [deg/s] once it obeys."""
    trial = stopped(90, response_time=response, **parameters)
    for k in range(ticks):
        h = 90 - rate * max(0.0, TICK * (k + 1) - response)
        if trial.tick(h=h) != Command.RIGHT:
            break
    return trial


def test_a_turn_ends_as_much_earlier_as_the_animal_will_turn_on() -> None:
    # given 60 deg/s, and 0.4 s until FORWARD is obeyed: 24 deg
    trial = turned(60, 100)
    assert trial.mode == Mode.FORWARD
    # then FORWARD is told at 29 deg, where 5 deg will be left
    assert trial.model["deviation"] / DEG == pytest.approx(29, abs=60 * TICK)
    assert trial.model["deviation"] / DEG < 29
    # and without lead at 5 deg
    other = stopped(90)
    assert [other.tick(h=h) for h in (29, 10, 4.9)] == [Command.RIGHT, Command.RIGHT, Command.FORWARD]


def test_a_turn_that_will_go_past_ends_at_once() -> None:
    # given 200 deg/s, known 0.12 s after the turn was obeyed, when 80 deg more will come
    trial = turned(200, 100)
    assert trial.mode == Mode.FORWARD
    assert trial.model["deviation"] / DEG == pytest.approx(90 - 200 * 4 * TICK)
    # and an animal that is still turning is not stopped for its deviation
    assert trial.model["deviation"] > 49 * DEG
    assert trial.tick(9) == Command.FORWARD
    assert trial.tick(3) == Command.STOP


def test_an_animal_that_turns_the_wrong_way_is_not_taken_for_one_that_goes_past() -> None:
    trial = turned(-150, 100)
    assert trial.mode == Mode.DEAD
    assert trial.anomalies[-1][1] == Anomaly.DIRECTION_SWITCH


UNKNOWN = {"response_time": 0.1, "response_sd": 0.2, "heading_sd": 1.99 * DEG}


def turning(rate: float, response: float, ticks: int, **parameters: Any) -> Trial:
    """A trial whose animal stands at 90 deg, and turns at a rate [deg/s] so long after RIGHT, in ticks."""
    trial = stopped(90, **(UNKNOWN | parameters))
    turn_on(trial, rate, response, ticks)
    return trial


def turn_on(trial: Trial, rate: float, response: float, ticks: int) -> None:
    """Turn on from 90 deg for so many ticks, or until the turn ends."""
    for k in range(1, ticks + 1):
        if trial.tick(h=90 - rate * max(0.0, TICK * k - response)) != Command.RIGHT:
            break


@pytest.mark.parametrize("response", [0.0, 0.08, 0.32, 0.8])
def test_a_response_time_is_learnt_by_a_scalar_kalman_filter(response: float) -> None:
    # given 0.1 +- 0.2 s, headings good to just under 2 deg, and 50 deg/s: 8 deg in 4 ticks, 16 deg in 8
    late = round(response / TICK)
    before, trial = (turning(50, response, late + ticks) for ticks in (7, 8))
    assert before.model["learnt_response"] == 0.1
    # then it is timed at 16 deg, half a tick early, to sqrt(6) / 4 of the 4 ticks from 8 deg to there
    noise = 6 / 16 * (4 * TICK) ** 2
    gain = 0.2**2 / (0.2**2 + noise)
    assert trial.model["learnt_response"] == pytest.approx(
        0.1 + gain * (response - 0.5 * TICK - 0.1), abs=1e-6
    )
    assert trial.model["response_variance"] == pytest.approx((1 - gain) * 0.2**2)
    # and once a turn
    later = turning(50, response, late + 9)
    assert later.model["response_variance"] == trial.model["response_variance"]
    assert later.model["settling"] == 1 + math.floor(later.model["learnt_response"] / TICK + 0.1)


def test_an_animal_that_passes_both_headings_at_once_is_timed_a_tick_later() -> None:
    # given 2 deg a tick, where 0.8 deg tell that it turns, and 1.6 deg time it
    before, trial = (turning(50, 0.32, ticks, heading_sd=0.2 * DEG) for ticks in (9, 10))
    assert (before.model["noted_tick"], before.model["learnt_response"]) == (9, 0.1)
    # then that makes 9 - 1/2 - 1 ticks, to sqrt(6) / 4 of a tick
    gain = 0.2**2 / (0.2**2 + 6 / 16 * TICK**2)
    assert trial.model["learnt_response"] == pytest.approx(0.1 + gain * (7.5 * TICK - 0.1))


def test_a_turn_to_the_wrong_side_is_timed_too_and_one_that_is_not_obeyed_is_not() -> None:
    wrong, deaf = turning(-50, 0.32, 16), turning(0, 0.32, 60)
    assert wrong.model["learnt_response"] == turning(50, 0.32, 16).model["learnt_response"]
    assert (deaf.model["learnt_response"], deaf.model["response_variance"]) == (0.1, 0.2**2)


def test_the_next_turn_is_timed_anew_and_a_new_trial_begins_with_what_is_known_of_all_animals() -> None:
    trial = turning(50, 0.32, 100)
    once = trial.model["response_variance"]
    assert trial.mode == Mode.FORWARD
    trial.tick(20, h=0, speed=5)
    trial.tick(h=90, speed=0)
    trial.until(Command.RIGHT)
    assert trial.model["response_variance"] == once
    turn_on(trial, 50, 0.32, 20)
    # then errors that are independent have a variance as one of two measurements
    noise = 6 / 16 * (4 * TICK) ** 2
    assert trial.model["response_variance"] == pytest.approx(1 / (1 / 0.2**2 + 2 / noise))
    trial.tick(start=0)
    trial.tick(60)
    trial.tick(start=1)
    assert (trial.model["learnt_response"], trial.model["response_variance"]) == (0.1, 0.2**2)


def test_a_turn_whose_response_is_learnt_ends_as_much_earlier_as_the_animal_will_turn_on() -> None:
    # given nothing but 0.3 +- 5 s, an animal that takes 0.4 s, and a turn of 60 deg/s
    trial = turning(60, 0.4, 60, response_time=0.3, response_sd=5.0)
    assert trial.model["learnt_response"] == pytest.approx(0.4, abs=TICK)
    # then FORWARD is told where about 5 deg will be left
    told = next(k for k, c in enumerate(trial.commands) if c == Command.FORWARD and k > 10)
    asked = next(k for k, c in enumerate(trial.commands) if c == Command.RIGHT)
    h = 90 - 60 * (TICK * (told - asked) - 0.4)
    assert h - 60 * 0.4 == pytest.approx(5, abs=60 * TICK)


def test_a_lead_that_was_thought_right_is_dropped_once_an_animal_is_known_to_obey_at_once() -> None:
    # given 0.1 +- 5 s, by which a turn of 50 deg/s would end 5 deg earlier
    before, trial = (turning(50, 0.0, ticks, response_sd=5.0) for ticks in (7, 100))
    assert before.model["lead"] / DEG == pytest.approx(5)
    # then it ends where it does without
    assert trial.mode == Mode.FORWARD
    assert trial.model["learnt_response"] == 0
    assert 3 <= trial.model["deviation"] / DEG < 5


@pytest.mark.parametrize(("speed", "way"), [(5, 5.0), (3, 1.8), (-5, 5.0)])
def test_stop_is_told_a_braking_way_before_the_waypoint(speed: float, way: float) -> None:
    # given 2.5 m/s2, so v^2 / 5 m
    trial = Trial(braking=2.5, route=NEAR)
    trial.tick(20, speed=speed)
    assert trial.tick(north=20 - way - 0.01) == Command.FORWARD
    assert trial.tick(north=20 - way + 0.01) == Command.STOP
    assert trial.mode == Mode.STOP_AT_WAYPOINT


def test_the_braking_way_has_the_response_time_in_it_and_lies_within_the_capture_radius() -> None:
    trial = Trial(braking=2.5, response_time=0.2, route=NEAR)
    trial.tick(20, speed=5)
    assert trial.tick(north=13.99) == Command.FORWARD
    assert trial.tick(north=14.01) == Command.STOP  # 5 m and 1 m
    fast = Trial(braking=1.0, route=NEAR)
    fast.tick(20, speed=5)
    assert fast.tick(north=12.9) == Command.FORWARD
    assert fast.tick(north=13.1) == Command.STOP  # at d' = 7 m, though 12.5 m are needed


def test_an_animal_that_looks_away_within_the_capture_radius_has_come_to_its_waypoint() -> None:
    trial = Trial(braking=2.5, route=NEAR)
    trial.tick(20, speed=1)
    assert trial.tick(north=18) == Command.FORWARD
    assert trial.tick(h=50) == Command.STOP
    assert trial.mode == Mode.STOP_AT_WAYPOINT


def test_off_by_default_nothing_is_learnt_or_led() -> None:
    trial = stopped(80)
    trial.tick(h=3)
    trial.tick(50, h=0, speed=5)
    learnt = ("learnt_drift", "drift_variance", "learnt_response", "response_variance")
    states = (*learnt, "settling", "offset", "lead", "early")
    assert [trial.model[name] for name in states] == [0] * len(states)
