"""The robot: distances, turn radius and rate by hand, slip of each wheel, and the way home."""

from __future__ import annotations

import math

import numpy as np
import pytest

from models.commands import Command
from models.differential_drive import MOST_SLIP, DifferentialDrive
from models.errors import ParameterError
from models.kit.model import Model
from models.kit.timing import TICK as TS

TRACK, OUTER, INNER = 0.5, 0.7, 0.25 * 0.7  # m, m/s: start values
NO_SLIP = {"wheel_slip": 0.0, "wheel_slip_deviation": 0.0}


def robot(**parameters: float) -> Model:
    model = Model(DifferentialDrive, NO_SLIP | parameters)
    model.initialize()
    return model


def tell(model: Model, command: float, ticks: int) -> None:
    model["command"] = command
    for _ in range(ticks):
        model.step()


def slipping(left: float, right: float, **parameters: float) -> Model:
    model = robot(**parameters)
    model["left_slip"], model["right_slip"] = left, right
    return model


def test_on_forward_it_speeds_up_and_on_stop_it_brakes() -> None:
    model = robot(wheel_acceleration=2.0)
    tell(model, Command.FORWARD, 1)
    assert model["speed"] == pytest.approx(2.0 * TS)
    assert model["acceleration"] == pytest.approx(2.0)
    tell(model, Command.FORWARD, 49)
    # 2 s: a ramp of 0.75 s makes 0.5625 m, 1.25 s at 1.5 m/s make 1.875 m; its last tick reaches 0.06 m/s
    assert model["speed"] == 1.5
    assert model["north"] == pytest.approx(0.5625 + 1.875, abs=1e-3)
    assert (model["east"], model["heading"], model["pitch"], model["roll"]) == (0, 0, 0, 0)
    for command in (Command.STOP, Command.NONE, 9.0, math.nan):
        tell(model, Command.FORWARD, 50)
        tell(model, command, 19)
        assert model["speed"] == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize("slip", [0.0, 0.2])
@pytest.mark.parametrize(("command", "sign"), [(Command.RIGHT, 1), (Command.LEFT, -1)])
def test_the_turn_radius_is_that_of_the_wheels_whatever_both_slip(
    command: Command, sign: int, slip: float
) -> None:
    # given R = track / 2 * (1 + 0.25) / (1 - 0.25) = 0.4167 m, at (0.7 - 0.175) / 0.5 = 1.05 rad/s less slip
    model = slipping(slip, slip)
    tell(model, command, 25)
    assert model["yaw_rate"] == pytest.approx(sign * 1.05 * (1 - slip))
    assert model["speed"] == pytest.approx(0.4375 * (1 - slip))
    # when it goes round by half a turn
    north, east, heading = model["north"], model["east"], model["heading"]
    ticks = round(math.pi / (1.05 * (1 - slip)) / TS)
    turned = ticks * 1.05 * (1 - slip) * TS
    tell(model, command, ticks)
    # then it has crossed the circle: the chord is 2 R sin(turned / 2), less what straight ticks lose
    chord = math.hypot(model["north"] - north, model["east"] - east)
    assert chord == pytest.approx(2 * 0.4167 * math.sin(turned / 2), rel=1e-3)
    turn = sign * (model["heading"] - heading) % (2 * math.pi)
    assert turn == pytest.approx(turned)


def test_a_wheel_that_slips_more_widens_its_turn() -> None:
    # given an outer wheel on RIGHT, the left one, that slips by 0.2: 0.56 and 0.175 m/s over the ground
    model = slipping(0.2, 0.0)
    tell(model, Command.RIGHT, 25)
    # then R = 0.25 * (0.56 + 0.175) / (0.56 - 0.175) = 0.477 m
    assert model["speed"] / model["yaw_rate"] == pytest.approx(0.25 * 0.735 / 0.385)


def test_unequal_slip_makes_it_drift_on_forward() -> None:
    # given 0.1 on the right alone: 1.5 and 1.35 m/s, so (1.5 - 1.35) / 0.5 = 0.3 rad/s to the right
    model = slipping(0.0, 0.1)
    tell(model, Command.FORWARD, 25)
    assert model["yaw_rate"] == pytest.approx(0.3)
    assert model["speed"] == pytest.approx(1.425)


@pytest.mark.parametrize(
    ("ratio", "speed", "rate"),
    [(-1, 0.0, 2.8), (0, 0.35, 1.4), (0.9, 0.665, 0.14)],  # (1 + ratio) * 0.35 m/s, (1 - ratio) * 1.4 rad/s
)
def test_the_inner_wheel_decides_about_what_it_turns(ratio: float, speed: float, rate: float) -> None:
    model = robot(inner_ratio=ratio)
    tell(model, Command.LEFT, 25)
    assert model["speed"] == pytest.approx(speed, abs=1e-12)
    assert model["yaw_rate"] == pytest.approx(-rate)


def test_slip_is_drawn_for_each_wheel_once_a_trial() -> None:
    # given 400 trials with a slip of 0.3 +- 0.05
    drawn = []
    for seed in range(400):
        model = robot(seed=seed, wheel_slip=0.3, wheel_slip_deviation=0.05)
        drawn.append((model["left_slip"], model["right_slip"]))
        assert drawn[-1] == (model["left_slip"], model["right_slip"])
    left, right = np.array(drawn).T
    # then both have this mean and deviation (each within four standard errors), and are independent
    for slips in (left, right):
        assert slips.mean() == pytest.approx(0.3, abs=4 * 0.05 / 20)
        assert slips.std() == pytest.approx(0.05, abs=4 * 0.05 / math.sqrt(800))
    assert abs(np.corrcoef(left, right)[0, 1]) < 0.2
    # and a tick leaves them as they are
    again = robot(seed=399, wheel_slip=0.3, wheel_slip_deviation=0.05)
    tell(again, Command.FORWARD, 10)
    assert (again["left_slip"], again["right_slip"]) == drawn[-1]


def test_the_heading_at_the_start_is_drawn_about_that_of_the_scenario() -> None:
    headings = [
        robot(seed=seed, start_heading=0.5, start_heading_deviation=0.1)["body_heading"]
        for seed in range(400)
    ]
    assert np.mean(headings) == pytest.approx(0.5, abs=4 * 0.1 / 20)
    assert np.std(headings) == pytest.approx(0.1, abs=4 * 0.1 / math.sqrt(800))
    assert robot(start_heading=4.0)["body_heading"] == pytest.approx(4 - 2 * math.pi)


def test_slip_stays_a_share() -> None:
    slips = [
        model[name]
        for seed in range(20)
        for model in [robot(seed=seed, wheel_slip=0.5, wheel_slip_deviation=1.0)]
        for name in ("left_slip", "right_slip")
    ]
    assert min(slips) == 0
    assert max(slips) == MOST_SLIP


def test_on_recall_it_turns_round_and_drives_home() -> None:
    # given a robot that drove 14.6 m to the east of its start
    model = robot(start_east=3.0, start_heading=math.pi / 2)
    tell(model, Command.FORWARD, 250)
    tell(model, Command.STOP, 20)
    away = model["east"] - 3
    assert away == pytest.approx(15, abs=0.5)
    # when it is called, then it turns on its circle to 20 deg from the way home: 160 deg in 2.7 s
    tell(model, Command.RECALL, 60)
    assert abs(model["yaw_rate"]) == pytest.approx(1.05)
    tell(model, Command.RECALL, 20)
    assert model["yaw_rate"] == 0
    # and drives to the start
    distances = []
    for _ in range(round(away / 1.5 / TS)):
        tell(model, Command.RECALL, 1)
        distances.append(math.hypot(model["north"], model["east"] - 3))
    assert min(distances) < 0.5


@pytest.mark.parametrize(("start_heading", "sign"), [(100, 1), (-100, -1)])
def test_on_recall_it_turns_the_shorter_way(start_heading: float, sign: int) -> None:
    # given a start 10 m to the south of a robot that looks 100 deg to a side: 80 more to that side are left
    model = robot(start_heading=start_heading * math.pi / 180)
    model["position_north"] = 10.0
    tell(model, Command.RECALL, 10)
    assert model["yaw_rate"] * sign > 0.5


def test_motion_is_finite_at_the_ends_of_every_range() -> None:
    ends = {
        p.name: (p.min, p.max)
        for p in DifferentialDrive.group("parameter")
        if p.min is not None and p.max is not None
    }
    rng = np.random.default_rng(3)
    for _ in range(200):
        model = Model(DifferentialDrive, {name: pair[rng.integers(2)] for name, pair in ends.items()})
        model.initialize()
        for command in rng.integers(0, 6, 20):
            tell(model, float(command), 3)
            assert np.isfinite(model.output).all()
            assert abs(model["heading"]) <= math.pi + 1e-9


@pytest.mark.parametrize(
    ("name", "value"), [("wheel_slip", 0.96), ("track", 0.0), ("inner_ratio", 1.0), ("wheel_acceleration", 0)]
)
def test_a_parameter_out_of_its_range_is_refused(name: str, value: float) -> None:
    with pytest.raises(ParameterError, match=name):
        Model(DifferentialDrive, {name: value})
