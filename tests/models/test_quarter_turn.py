"""The prototype: turns of 90 degrees by time, and a course that is known in motion alone."""

from __future__ import annotations

import math

import pytest

from models.commands import Command, Status
from models.kit.model import Model
from models.modes import Anomaly, Mode
from models.pedestrian import Pedestrian
from models.quarter_turn import QuarterTurn
from tests.models.leading import DEG, Trial, led

STOP_TICKS = 38  # of stop_hold = 1.5 s: the first tick count whose time is beyond 1.496 s
TURN_TICKS = 38  # of turn_time = 1.5 s


def stopped(h: float, **parameters: float) -> Trial:
    """An animal that was stopped since it went with a deviation of h [deg], and stands."""
    trial = Trial(QuarterTurn, **parameters)
    trial.tick(h=0)
    assert trial.tick(h=h) == Command.STOP
    trial.tick(speed=0)
    return trial


@pytest.mark.parametrize(("h", "command"), [(90, Command.RIGHT), (-90, Command.LEFT), (180, Command.RIGHT)])
def test_a_turn_is_told_behind_a_stop_for_its_time(h: float, command: Command) -> None:
    # given an animal that was stopped; the first tick of its stop is past
    trial = stopped(h)
    # then it is turned for 1.5 s, whatever the heading does meanwhile
    assert trial.until(command) == STOP_TICKS - 1
    assert trial.tick(TURN_TICKS - 1, h=0) == command
    assert trial.tick(h=h) != command
    assert trial.model["directional_commands"] == 1


def test_a_turn_is_believed_until_the_animal_moves() -> None:
    # given a turn of 90 degrees that the animal did not make
    trial = stopped(90)
    trial.until(Command.RIGHT)
    assert trial.until(Command.FORWARD) == TURN_TICKS
    # then the deviation counts as gone while it stands
    trial.tick(20)
    assert trial.model["deviation"] == pytest.approx(0, abs=1e-12)
    assert trial.mode == Mode.FORWARD
    # and shows as soon as it moves
    assert trial.tick(speed=1.0) == Command.STOP
    assert trial.model["deviation"] == pytest.approx(90 * DEG)


@pytest.mark.parametrize(("side", "command"), [(1, Command.RIGHT), (-1, Command.LEFT)])
@pytest.mark.parametrize("speed", [0.5, 1.0, 5.0])
def test_a_turn_made_while_moving_counts_once(side: int, command: Command, speed: float) -> None:
    # given a turn of 90 degrees, which an animal that moves has made by 30 ticks
    trial = stopped(side * 90)
    trial.until(command)
    trial.tick(10, h=side * 60, speed=speed)
    trial.tick(20, h=0)
    # then it goes forward as the turn ends
    assert trial.until(Command.FORWARD) == TURN_TICKS - 30
    # and no deviation is left, whether it then stands or moves
    for then in (0, speed):
        assert trial.tick(speed=then) == Command.FORWARD
        assert trial.model["deviation"] == pytest.approx(0, abs=1e-12)
    assert trial.model["directional_commands"] == 1


@pytest.mark.parametrize("cut_short", [{"override": Command.STOP}, {"link_ok": 0}])
def test_a_turn_that_is_cut_short_leaves_the_last_course(cut_short: dict[str, float]) -> None:
    # given an animal that is interrupted 10 ticks into its turn by 90 degrees, and stands
    trial = stopped(90)
    trial.until(Command.RIGHT)
    trial.tick(10, h=60, speed=2)
    trial.tick(speed=0, **cut_short)
    # then the course is that from before the turn
    assert trial.model["deviation"] == pytest.approx(90 * DEG)
    # and the measured one as soon as it moves
    trial.tick(speed=2)
    assert trial.model["deviation"] == pytest.approx(60 * DEG)


def test_the_heading_of_a_slow_animal_is_not_known() -> None:
    trial = Trial(QuarterTurn)
    trial.tick(h=0, speed=5)
    assert trial.tick(h=120, speed=0.99) == Command.FORWARD
    assert trial.model["deviation"] == 0
    assert trial.tick(speed=1.0) == Command.STOP
    assert trial.model["deviation"] == pytest.approx(120 * DEG)


@pytest.mark.parametrize(
    ("name", "bad", "good"),
    [("valid", 0, 1), ("north", math.nan, 0), ("speed", 50.1, 0), ("speed", math.inf, 0)],
)
def test_a_course_of_a_bad_estimate_is_not_taken(name: str, bad: float, good: float) -> None:
    # given a heading that comes with something bad
    trial = Trial(QuarterTurn)
    trial.tick(h=0)
    trial.tick(5, h=120, **{name: bad})
    # when the estimate is good again, of an animal that stands
    trial.tick(**{name: good, "speed": 0})
    # then the course is that from before
    assert trial.model["deviation"] == 0


def test_the_heading_at_the_start_is_known() -> None:
    # given an animal that is pointed to the west of a waypoint in the north
    trial = Trial(QuarterTurn)
    # then it is stopped at once, and turned right
    assert trial.tick(h=90, speed=0) == Command.STOP
    assert trial.until(Command.RIGHT) == STOP_TICKS


@pytest.mark.parametrize(("h", "command"), [(59.99, Command.FORWARD), (60.01, Command.STOP)])
def test_the_animal_is_stopped_from_the_threshold_on(h: float, command: Command) -> None:
    for side in (-1, 1):
        trial = Trial(QuarterTurn)
        trial.tick(h=0)
        assert trial.tick(h=side * h) == command


def test_a_deviation_of_exactly_the_threshold_is_too_much() -> None:
    for side in (-1, 1):
        trial = Trial(QuarterTurn, turn_deviation=50 * DEG)
        trial.tick(h=0)
        assert trial.tick(h=side * 50) == Command.STOP
        # and so it is behind the stop
        assert trial.until(Command.RIGHT if side > 0 else Command.LEFT, speed=0) == STOP_TICKS


@pytest.mark.parametrize(("side", "command"), [(1, Command.RIGHT), (-1, Command.LEFT)])
def test_who_has_to_turn_back_is_turned_twice(side: int, command: Command) -> None:
    # given a deviation of 170 deg: after 90 of them 80 are left, above the threshold of 60
    trial = stopped(side * 170)
    trial.until(command)
    assert trial.until(Command.STOP) == TURN_TICKS
    assert trial.until(command) == STOP_TICKS
    # then after the second turn -10 are left
    assert trial.until(Command.FORWARD) == TURN_TICKS
    trial.tick()
    assert trial.model["deviation"] == pytest.approx(side * -10 * DEG)
    assert trial.model["directional_commands"] == 2


@pytest.mark.parametrize("threshold", [46, 60, 90, 171])
@pytest.mark.parametrize("h", [-180, -136, -91, -50, 46, 89, 135, 179])
def test_no_more_than_two_turns_bring_an_obedient_animal_below_any_threshold(
    threshold: float, h: float
) -> None:
    # given h - 90 is in [threshold - 90, 90], and after a second turn in [threshold - 180, 0]
    trial = Trial(QuarterTurn, turn_deviation=threshold * DEG)
    trial.tick(h=h, speed=0)
    for _ in range(400):
        trial.tick()
    # then it goes on, and no turn follows for ever
    assert trial.mode == Mode.FORWARD
    assert trial.model["directional_commands"] <= 2
    assert abs(trial.model["deviation"]) < threshold * DEG


def test_one_turn_more_than_maxturn_fails_the_trial() -> None:
    # given an animal that goes on to the west whatever it is told
    trial = Trial(QuarterTurn)
    trial.tick(h=0)
    for _ in range(2):
        trial.tick(h=90, speed=5)
        trial.tick(speed=0)
        trial.until(Command.RIGHT)
        trial.until(Command.FORWARD)
    trial.tick(speed=5)
    # when a third turn would be due, then it is recalled
    assert trial.until(Command.RECALL, speed=0) == STOP_TICKS
    assert trial.status == Status.FAILED
    assert [anomaly for _, anomaly in trial.anomalies] == [Anomaly.TRIAL_FAILURE]
    assert trial.tick(north=0) == Command.NONE
    assert trial.mode == Mode.FAILED


def test_a_person_who_faces_east_is_turned_to_the_north() -> None:
    # given a waypoint in the north, and a person who turns by 60 deg/s
    controller = Model(QuarterTurn, {"waypoint_north[1]": 50.0})
    person = Model(Pedestrian, {"start_heading": math.pi / 2})
    for model in (controller, person):
        model.initialize()
    controller["start"] = 1
    # when STOP (38 ticks) and LEFT (38 ticks) are over
    led(controller, person, STOP_TICKS + TURN_TICKS)
    # then 38 ticks of 2.4 deg have been turned
    assert person["heading"] == pytest.approx((90 - 38 * 2.4) * DEG)
    # and the waypoint is reached without another turn
    led(controller, person, 900)
    assert (controller["waypoint"], controller["directional_commands"]) == (1, 1)
