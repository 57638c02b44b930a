"""The proportional controller: the time of a turn, how the deviation shrinks, and when it does not."""

from __future__ import annotations

import pytest

from models.commands import Command, Status
from models.kit.model import Model
from models.modes import Anomaly
from models.pedestrian import Pedestrian
from models.proportional import Proportional
from tests.models.leading import DEG, Trial, led

FORWARD_TICKS = 25  # of forward_time = 1 s
BAND, LONGEST = 90.0, 1.0  # deg, s: the start values of the law


def turning(h: float) -> Trial:
    """An animal that goes, on the first tick of the turn for h [deg]."""
    trial = Trial(Proportional)
    trial.tick(h=h)
    assert trial.until(Command.RIGHT if h > 0 else Command.LEFT) == FORWARD_TICKS
    return trial


@pytest.mark.parametrize(
    ("h", "ticks"),
    [
        (19, 6),  # 0.211 s are 5.28 ticks
        (45, 13),  # 0.5 s are 12.5 ticks
        (-45, 13),
        (89.9, 25),
        (90, 25),  # 1 s
        (-150, 25),  # beyond the band: the longest
        (180, 25),
    ],
)
def test_a_turn_is_as_long_as_the_deviation_asks_for(h: float, ticks: int) -> None:
    # given a turn that begins
    trial = turning(h)
    # then it lasts |h| / 90 deg of 1 s, in whole ticks, and is not measured again
    command = trial.commands[-1]
    assert trial.tick(ticks - 1, h=5 * h / abs(h)) == command
    assert trial.tick() == Command.FORWARD
    assert trial.model["directional_commands"] == 1


@pytest.mark.parametrize("h", [-17.9, 0, 17.9])
def test_a_deviation_in_the_dead_zone_asks_for_no_turn(h: float) -> None:
    trial = Trial(Proportional)
    assert trial.tick(200, h=h) == Command.FORWARD
    assert trial.phases() == [("FORWARD", 200)]


def test_between_two_turns_the_animal_goes_forward() -> None:
    trial = turning(-60)
    trial.tick(60)
    # given 60 deg: 0.667 s are 16.7 ticks
    assert trial.phases()[1:4] == [("LEFT", 17), ("FORWARD", FORWARD_TICKS), ("LEFT", 17)]


def test_the_heading_error_of_a_person_shrinks_turn_by_turn() -> None:
    # given a person who walks 60 deg to the left of a far waypoint, and turns by 60 deg/s
    controller = Model(Proportional, {"waypoint_north[1]": 1e5})
    person = Model(Pedestrian, {"start_heading": -60 * DEG})
    for model in (controller, person):
        model.initialize()
    controller["start"] = 1
    # when the first turn (17 ticks of 2.4 deg) is over, then 60 - 40.8 are left
    led(controller, person, FORWARD_TICKS + 17)
    assert person["heading"] == pytest.approx(-19.2 * DEG, abs=1e-4)
    # and after the next, of 0.213 s or 6 ticks, 4.8, in the dead zone
    led(controller, person, FORWARD_TICKS + 6)
    assert person["heading"] == pytest.approx(-4.8 * DEG, abs=1e-4)
    led(controller, person, 500)
    assert person["heading"] == pytest.approx(-4.8 * DEG, abs=1e-4)
    assert controller["directional_commands"] == 2


@pytest.mark.parametrize("rate", [20, 60, 90, 120, 170])
@pytest.mark.parametrize("h", [-85, 40, 85])
def test_a_turn_leaves_the_part_that_the_law_says(rate: float, h: float) -> None:
    # given a body that turns at a rate [deg/s] while told to
    trial = turning(h)
    command = trial.commands[-1]
    ticks = 1
    while trial.tick() == command:
        ticks += 1
    left = abs(h) - ticks * rate * 0.04
    # then 1 - rate * 1 s / 90 deg of the deviation is left, but for a tick
    assert left == pytest.approx((1 - rate * LONGEST / BAND) * abs(h), abs=rate * 0.04)


def test_a_body_that_turns_too_fast_is_not_steered() -> None:
    # given 200 deg/s, so 1 - 200 / 90 = -1.2 of a deviation is left: 9 ticks of 8 deg behind 30 deg make -42
    controller = Model(Proportional, {"waypoint_north[1]": 1e5})
    person = Model(Pedestrian, {"start_heading": -30 * DEG, "turning_rate": 200 * DEG})
    for model in (controller, person):
        model.initialize()
    controller["start"] = 1
    led(controller, person, FORWARD_TICKS + 9)
    assert person["heading"] == pytest.approx(42 * DEG, abs=1e-4)


def test_from_a_waypoint_the_animal_turns_before_it_goes() -> None:
    # given waypoints in the north, then in the east
    route = {"waypoint_count": 2, "waypoint_north[1]": 100.0, "waypoint_north[2]": 100.0}
    trial = Trial(Proportional, route=route | {"waypoint_east[2]": 100.0})
    trial.tick(north=0, heading=0)
    trial.tick(north=100)
    assert trial.until(Command.RIGHT, speed=0) == 38  # of stop_hold
    assert trial.model["deviation"] == pytest.approx(90 * DEG)
    assert trial.until(Command.FORWARD) == 25


def test_a_turn_of_exactly_the_least_time_is_told() -> None:
    # given 45 deg of a band of 90 deg, so half a second, and no shorter turn than that
    trial = Trial(Proportional, least_turn=0.5)
    trial.tick(h=45, speed=0)
    assert trial.until(Command.RIGHT) == FORWARD_TICKS
    # then it is told from a stop too
    stopped = Trial(Proportional, least_turn=0.5)
    stopped.tick(h=45, speed=0, valid=0)
    stopped.tick(valid=1)
    stopped.tick(valid=0)
    assert stopped.until(Command.RIGHT, valid=1) == 38  # of stop_hold
    assert Command.FORWARD not in stopped.commands[-38:]


def test_maxturn_can_be_set() -> None:
    trial = Trial(Proportional, max_turns=2)
    trial.tick(h=60)
    trial.until(Command.RECALL)
    assert trial.status == Status.FAILED
    assert [name for name, _ in trial.phases()] == [
        "FORWARD", "RIGHT", "FORWARD", "RIGHT", "FORWARD", "RECALL"
    ]  # fmt: skip
    assert [anomaly for _, anomaly in trial.anomalies] == [Anomaly.TRIAL_FAILURE]
