"""The controllers beside the CMEC: what beats their table, the mission, what they give on any input."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.cmec import Cmec
from models.commands import Command, Status
from models.kit.block import Block
from models.kit.model import Model
from models.modes import Anomaly, Mode
from models.proportional import Proportional
from models.quarter_turn import QuarterTurn
from tests.models.leading import Trial

LEADERS: list[type[Block]] = [QuarterTurn, Proportional]
each = pytest.mark.parametrize("block", LEADERS, ids=lambda block: block.title())


@each
def test_it_has_the_variables_of_the_role(block: type[Block]) -> None:
    for kind in ("input", "output"):
        assert block.flat_names(kind) == Cmec.flat_names(kind)


@each
def test_a_trial_begins_with_its_start_signal_once_nothing_beats_the_table(block: type[Block]) -> None:
    trial = Trial(block)
    assert trial.tick(5, h=0, start=0) == Command.NONE
    for name, off, on, command in (
        ("valid", 0, 1, Command.STOP),
        ("link_ok", 0, 1, Command.STOP),
        ("override", Command.LEFT, 0, Command.LEFT),
    ):
        assert trial.tick(5, start=1, **{name: off}) == command
        assert trial.mode == Mode.IDLE
        trial.tick(start=0, **{name: on})
    assert trial.tick(start=1) == Command.FORWARD


@each
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("north", math.nan),
        ("north", 1.001e5),
        ("east", -math.inf),
        ("speed", math.nan),
        ("speed", 50.1),
        ("heading", math.nan),
        ("heading", -7.1),
        ("override", 6),
        ("override", -1),
    ],
)
def test_a_bad_input_stops_the_animal_and_is_reported(block: type[Block], name: str, value: float) -> None:
    # given an animal that goes
    trial = Trial(block)
    assert trial.tick(3, h=0) == Command.FORWARD
    # when an input is no number, or out of its range
    assert trial.tick(2, **{name: value}) == Command.STOP
    # then it is stopped, the anomaly is reported once, and h is 0
    assert trial.anomalies == [(3, Anomaly.BAD_INPUT)]
    assert trial.model["deviation"] == 0


@each
def test_a_lost_link_beats_the_operator_who_beats_an_estimate_that_is_invalid(block: type[Block]) -> None:
    trial = Trial(block)
    trial.tick(h=0)
    assert trial.tick(valid=0) == Command.STOP
    assert trial.tick(override=Command.LEFT) == Command.LEFT
    assert trial.tick(north=math.nan) == Command.LEFT
    assert trial.tick(link_ok=0) == Command.STOP
    assert [anomaly for _, anomaly in trial.anomalies] == [Anomaly.INVALID_ESTIMATE, Anomaly.LOST_LINK]


@each
@pytest.mark.parametrize("mode", Mode)
def test_in_each_mode_a_lost_link_and_an_invalid_estimate_mean_stop(block: type[Block], mode: Mode) -> None:
    for name in ("link_ok", "valid"):
        trial = Trial(block)
        trial.model["now"] = mode
        assert trial.tick(h=120, **{name: 0}) == Command.STOP


@each
def test_after_an_interruption_it_begins_again_from_a_stop_that_is_held(block: type[Block]) -> None:
    # given an estimate that was invalid for a while
    trial = Trial(block)
    trial.tick(10, h=0)
    trial.tick(5, valid=0)
    # when it is valid again, then STOP is held for 1.5 s (38 ticks), and until the animal stands
    assert trial.tick(60, valid=1) == Command.STOP
    assert trial.mode == Mode.STOP_TO_TURN
    assert trial.tick(speed=0.29) == Command.FORWARD
    trial.tick(5, link_ok=0)
    assert trial.until(Command.FORWARD, link_ok=1) == 38


@each
def test_without_its_start_signal_a_trial_stops_and_makes_room_for_the_next(block: type[Block]) -> None:
    trial = Trial(block)
    trial.tick(10, h=0)
    statuses = []
    for ticks, start, command in ((1, 0, Command.STOP), (38, 0, Command.NONE), (1, 1, Command.FORWARD)):
        assert trial.tick(ticks, start=start) == command
        statuses.append(trial.status)
    assert statuses == [Status.STOPPED, Status.IDLE, Status.RUNNING]


@each
def test_a_mission_goes_by_its_waypoints_and_home(block: type[Block]) -> None:
    # given waypoints 100 and 200 m to the north, and d' = 7 m
    trial = Trial(block, route={"waypoint_count": 2, "waypoint_north[1]": 100.0, "waypoint_north[2]": 200.0})
    assert trial.tick(30, north=92.9, heading=0) == Command.FORWARD
    # when the animal comes to the first, it is stopped there, and goes on once it stands
    assert trial.tick(north=93.0) == Command.STOP
    assert trial.tick(50) == Command.STOP
    assert trial.tick(speed=0) == Command.FORWARD
    assert (trial.model["waypoint"], trial.model["distance"]) == (1, 107)
    # then the last one is followed by RECALL, up to home
    assert trial.tick(north=194, speed=2) == Command.STOP
    assert trial.until(Command.RECALL, speed=0) == 38
    assert (trial.model["waypoint"], trial.model["distance"]) == (2, 194)
    assert trial.tick(north=7.1) == Command.RECALL
    assert trial.tick(north=7.0) == Command.NONE
    assert trial.status == Status.SUCCESS


@each
def test_while_something_else_beats_the_table_it_does_not_decide(block: type[Block]) -> None:
    # given an animal that is called home
    trial = Trial(block)
    trial.tick(h=0)
    trial.tick(north=1000, speed=0)
    trial.until(Command.RECALL)
    # when it comes home while the estimate is invalid
    assert trial.tick(north=0, valid=0) == Command.STOP
    # then the trial is not over before the estimate is valid again
    assert trial.status == Status.RUNNING
    trial.tick(valid=1)
    assert trial.mode == Mode.SUCCESS


@each
def test_a_waypoint_that_is_reached_in_a_turn_begins_a_stop(block: type[Block]) -> None:
    for h, command in ((80, Command.RIGHT), (-80, Command.LEFT)):
        # given an animal that has been turned for some ticks
        trial = Trial(block)
        trial.tick(h=h, speed=0)
        trial.until(command)
        trial.tick(5)
        # when it is at its waypoint, then it is stopped for 1.5 s, and called home
        assert trial.tick(north=994) == Command.STOP
        assert trial.mode == Mode.STOP_AT_WAYPOINT
        assert trial.until(Command.RECALL) == 38


@each
def test_a_mission_is_latched_at_its_start(block: type[Block]) -> None:
    trial = Trial(block, home_north=-50.0)
    trial.tick(north=0, heading=0)
    trial.model["waypoint_north[1]"] = trial.model["home_north"] = 2000.0
    trial.tick()
    assert trial.model["distance"] == 1000
    trial.tick(north=1000, speed=0)
    trial.until(Command.RECALL)
    assert trial.model["distance"] == 1050


@each
def test_outputs_stay_in_their_ranges_whatever_comes_in(block: type[Block]) -> None:
    # given inputs from their ranges and from outside of them
    rng = np.random.default_rng(5)
    model = Model(block, {"waypoint_count": 2, "waypoint_north[1]": 20.0, "waypoint_east[2]": 30.0})
    model.initialize()
    model["start"] = 1
    modes = set()
    for _ in range(8000):
        wild = rng.random() < 0.004
        model["north"] = rng.choice([math.nan, math.inf, 1e300]) if wild else rng.uniform(-40, 40)
        model["heading"], model["speed"] = rng.uniform(-7.2, 7.2), rng.choice([0, 0, 0, 4])
        model["east"], model["override"] = rng.uniform(-5, 5), rng.choice([0] * 500 + [1, 7])
        model["start"], model["link_ok"] = rng.random() < 0.998, rng.random() < 0.998
        # when it ticks
        model.step()
        modes.add(Mode(int(model["mode"])))
        # then what it gives is finite, of its enumeration, in its range
        for output in block.group("output"):
            output.check(float(model[output.name]), output.name)
        assert abs(model["deviation"]) <= math.pi + 1e-9
    assert modes >= {Mode.FORWARD, Mode.LEFT, Mode.RIGHT, Mode.STOP_TO_TURN, Mode.STOP_AT_WAYPOINT}
