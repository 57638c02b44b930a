"""A recorded path: speed, course, heading and acceleration from its positions, against the path's own."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.kit.timing import TICK as TS
from models.recorded import Recorded

DEG = math.pi / 180
STILL = {"shaking": 0.0}
RADIUS, RATE = 4.0, 0.5  # m, rad/s: a circle at 2 m/s

Make = Callable[..., Any]
Columns = dict[str, np.ndarray[Any, Any]]


def follow(native: Make, north: Any, east: Any, **parameters: float) -> Columns:
    columns: Columns = native(Recorded, "double", STILL | parameters).run(
        path_north=np.asarray(north, float), path_east=np.asarray(east, float)
    )
    return columns


def circle(ticks: int) -> tuple[Any, Any]:
    """Clockwise, from the north pole of the circle, where it leads east."""
    angle = RATE * TS * np.arange(ticks)
    return 100 + RADIUS * np.cos(angle), -50 + RADIUS * np.sin(angle)


def test_a_circle_gives_its_speed_heading_and_turn_rate(native: Make) -> None:
    north, east = circle(500)
    out = follow(native, north, east)
    # then the animal is where the path was a tick ago, to the bit
    assert out["north"][1:].tobytes() == north[:-1].tobytes()
    assert out["east"][1:].tobytes() == east[:-1].tobytes()
    # and moves as the circle does; a central difference of it is short by sin(x)/x, x = 0.02 rad
    assert out["speed"][2:] == pytest.approx(2.0, rel=1e-4)
    heading = np.angle(np.exp(1j * (out["heading"][2:] - (90 * DEG + RATE * TS * np.arange(1, 499)))))
    assert heading == pytest.approx(0, abs=1e-9)
    assert out["yaw_rate"][3:] == pytest.approx(RATE)
    assert out["slip"] == pytest.approx(0, abs=1e-12)
    assert out["slip_acceleration"][3:] == pytest.approx(0, abs=0.05)


def test_acceleration_is_the_rate_of_the_speed(native: Make) -> None:
    # given a path to the north with 0.5 m/s2, from 1 m/s
    t = TS * np.arange(200)
    out = follow(native, t + 0.25 * t**2, 0 * t)
    assert out["acceleration"][3:] == pytest.approx(0.5)
    assert out["speed"][2:] == pytest.approx(1 + 0.5 * t[1:-1])


def test_the_path_begins_without_a_jerk(native: Make) -> None:
    # given a path that begins far away and in motion, to the west
    out = follow(native, np.full(50, 300.0), 200 - 3.0 * TS * np.arange(50), start_heading=0.3)
    # then the animal is put there, and moves and looks as the path does from the second position on
    assert out["north"][0] == 300
    assert list(out["speed"][:3]) == pytest.approx([0, 3, 3])
    assert out["heading"][1:] == pytest.approx(-90 * DEG)
    assert np.abs(out["acceleration"]).max() < 1e-9
    assert np.abs(out["yaw_rate"]).max() < 1e-9


def test_a_slow_animal_keeps_its_heading(native: Make) -> None:
    # given a path that leads north, and then drifts east at 0.1 m/s
    north = np.concatenate([TS * np.arange(50), np.full(100, 49 * TS)])
    east = np.concatenate([np.zeros(50), 0.1 * TS * np.arange(1, 101)])
    out = follow(native, north, east)
    assert out["heading"] == pytest.approx(0, abs=0.11)
    assert np.ptp(out["heading"][60:]) == 0
    assert out["speed"][-1] == pytest.approx(0.1)
    # and not if that speed is not slow
    assert follow(native, north, east, slow_speed=0.05)["heading"][-1] == pytest.approx(90 * DEG)


def test_the_body_turns_no_faster_than_its_rate_and_slips_meanwhile(native: Make) -> None:
    # given a path that turns back at once
    north = np.concatenate([np.arange(50), np.arange(49, -1, -1)]) * TS
    out = follow(native, north, np.zeros(100), largest_turn_rate=180 * DEG)
    assert np.abs(out["yaw_rate"]).max() == pytest.approx(180 * DEG)
    # then the turn takes a second, while course = heading + slip
    turning = np.flatnonzero(np.abs(out["yaw_rate"]) > 1e-6)
    assert len(turning) == pytest.approx(25, abs=1)
    course = np.angle(np.exp(1j * (out["heading"] + out["slip"])))
    assert np.abs(course[turning[1] :]) == pytest.approx(180 * DEG)


def test_the_accelerations_of_a_path_integrate_to_its_velocity(native: Make) -> None:
    # given a bent path, with slip that leads and wanders
    t = TS * np.arange(1500)
    north, east = 3 * np.sin(0.7 * t) + 0.5 * t, 4 * np.sin(0.4 * t)
    out = follow(native, north, east, slip_lead=0.43, slip_wander=0.1, slip_mean=0.1)
    # when forward and lateral acceleration are turned by the heading and summed, from the path's beginning
    right = out["slip_acceleration"] + out["speed"] * out["yaw_rate"]
    change = np.cumsum((out["acceleration"] + 1j * right) * np.exp(1j * out["heading"]))[1:] * TS
    velocity = out["speed"][1:] * np.exp(1j * (out["heading"] + out["slip"])[1:])
    # then they give the change of the velocity along the course
    assert np.abs(velocity - velocity[0] - (change - change[0])).max() < 1e-9
    # which is that of the path
    path = np.gradient(north, TS) + 1j * np.gradient(east, TS)
    moving = out["speed"][2:] > 0.3
    assert np.abs(velocity[1:] - path[1:-1])[moving].max() < 1e-9
    # and slip is what was asked for: 0.1 and the lead of the course
    assert out["slip"][100:].mean() == pytest.approx(0.1, abs=0.08)


def test_a_body_that_lags_behind_its_path_feels_it_without_any_slip_parameter(native: Make) -> None:
    # given a path to the north that turns east at once, at 1 m/s, and a body that turns by 180 deg/s
    way = np.concatenate([np.arange(50), np.full(50, 49)]) * TS
    out = follow(native, way, way[::-1].max() - way[::-1], largest_turn_rate=180 * DEG)
    # when forward and lateral acceleration are turned by the heading and summed
    right = out["slip_acceleration"] + out["speed"] * out["yaw_rate"]
    change = np.cumsum((out["acceleration"] + 1j * right) * np.exp(1j * out["heading"])) * TS
    # then they give the change from north to east
    assert change[-1] - change[2] == pytest.approx(-1 + 1j, abs=1e-9)


def test_slip_leads_the_course_of_a_path_without_ringing(native: Make) -> None:
    # given a path that goes straight and then round, and slip that leads by more than its own time
    north, east = circle(200)
    straight = -2 * TS * np.arange(50, 0, -1)
    out = follow(
        native, np.concatenate([np.full(50, north[0]), north]), np.concatenate([east[0] + straight, east]),
        slip_lead=0.5, slip_time=0.1,
    )  # fmt: skip
    # then it goes to lead times turn rate in one direction, while the body turns no faster than the path
    assert out["slip"][-1] == pytest.approx(0.5 * RATE, rel=1e-3)
    assert np.diff(out["slip"][3:]).min() > -1e-9
    assert out["yaw_rate"][-1] == pytest.approx(RATE)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf, 1.1e5])
def test_bad_positions_are_skipped_and_counted(bad: float) -> None:
    from models.kit.model import Model  # noqa: PLC0415

    model = Model(Recorded, STILL)
    model.initialize()
    for k in range(60):
        model["path_north"], model["path_east"] = TS * k, bad if k in (0, 20, 21) else 7.0
        model.step()
        assert np.isfinite(model.output).all()
    assert model["bad_points"] == 3
    assert [model["north"], model["east"]] == pytest.approx([58 * TS, 7])
    assert model["speed"] == pytest.approx(1)


def test_the_pack_shakes_on_the_path(native: Make) -> None:
    north, east = circle(500)
    out = follow(native, north, east, shaking=1.0, jerk_rate=0.0)
    assert np.ptp(out["acceleration"][100:]) == pytest.approx(15, abs=1)
    assert out["pitch"].mean() / DEG == pytest.approx(-8.5, abs=0.5)
