"""The pack: its wander, shifts, jolts and slip, each against its declared rate, size and time."""

from __future__ import annotations

import math
from collections.abc import Callable
from itertools import pairwise
from typing import Any

import numpy as np
import pytest

from models.canine import Canine
from models.commands import Command
from models.kit.random import start_state
from models.kit.timing import TICK as TS

DEG = math.pi / 180
PITCH_MEAN = -8.5 * DEG
CALM = {
    "drift": 0.0, "drift_deviation": 0.0, "right_turn_rate_deviation": 0.0, "left_turn_rate_deviation": 0.0,
    "jerk_rate": 0.0, "cruise_speed": 1.5,
}  # fmt: skip
STANDING, WALKING = Command.NONE, Command.FORWARD
TICKS = 40_000

Make = Callable[..., Any]
Columns = dict[str, np.ndarray[Any, Any]]


def run(native: Make, command: Command, ticks: int = TICKS, **parameters: float) -> Columns:
    """Outputs and states after each tick of a dog without chance, told one command throughout."""
    columns: Columns = native(Canine, "double", CALM | parameters).run(command=np.full(ticks, command))
    return columns


# Strides


def test_strides_vary_in_frequency_and_swing_as_declared(native: Make) -> None:
    # given a walk of 2 strides a second, whose frequency varies by a tenth and whose swings vary by a fifth
    columns = run(native, WALKING, stride_deviation=0.1, swing_deviation=0.2)
    begins = np.flatnonzero(np.diff(columns["stride"][100:]) < 0) + 101
    # then each stride has draws of its own, right within 4 deviations (p = 6e-5)
    quickness, strength = columns["quickness"][begins], columns["strength"][begins]
    n = len(begins)
    assert n == pytest.approx(2 * TICKS * TS, rel=0.02)
    for drawn, deviation in ((quickness, 0.1), (strength, 0.2)):
        assert len(np.unique(drawn)) == n
        assert drawn.mean() == pytest.approx(1, abs=4 * deviation / math.sqrt(n))
        assert drawn.std() == pytest.approx(deviation, rel=4 / math.sqrt(2 * n))
    assert np.corrcoef(quickness, strength)[0, 1] == pytest.approx(0, abs=4 / math.sqrt(n))
    # and takes 1/frequency, to a tick at either end, and swings by 15 m/s2 times its strength
    length = np.diff(begins) * TS
    assert np.abs(length - 0.5 / quickness[:-1]).max() < 2 * TS
    largest = np.array([columns["acceleration"][a:b].max() for a, b in pairwise(begins)])
    assert largest == pytest.approx(7.5 * strength[:-1], rel=0.15)


# Pitch


def test_pitch_wanders_with_its_declared_deviation_and_correlation_time(native: Make) -> None:
    # given a standing dog whose pitch wanders by 4 deg in 2 s: a tick keeps 2/2.04 of it
    pitch = run(native, STANDING, pitch_wander=4 * DEG, pitch_wander_time=2.0)["pitch"] - PITCH_MEAN
    kept = 2 / 2.04
    # then its variance is right within 4 deviations of the estimate (p = 6e-5): 2/n, n of independent draws
    independent = TICKS * (1 - kept**2) / (1 + kept**2)
    assert np.mean(pitch**2) / (4 * DEG) ** 2 == pytest.approx(1, abs=4 * math.sqrt(2 / independent))
    # and so is the correlation between two ticks: (1 - kept^2)/n is the variance of an AR(1)'s estimate
    correlation = np.mean(pitch[1:] * pitch[:-1]) / np.mean(pitch**2)
    assert correlation == pytest.approx(kept, abs=4 * math.sqrt((1 - kept**2) / TICKS))


def test_pitch_is_drawn_at_the_start_as_it_might_be_at_any_time(native: Make) -> None:
    parameters = {"pitch_wander": 4 * DEG, "slip_wander": 0.1, "slip_mean": 0.2}
    dogs = [native(Canine, "double", parameters | {"seed": seed}) for seed in range(1, 401)]
    for name, mean, deviation in (("wandered_pitch", 0, 4 * DEG), ("side_slip", 0.2, 0.1)):
        drawn = np.array([dog[name] for dog in dogs])
        assert drawn.mean() == pytest.approx(mean, abs=4 * deviation / math.sqrt(400))
        assert drawn.std() == pytest.approx(deviation, rel=4 / math.sqrt(800))


def test_pitch_shifts_at_its_declared_rate_to_places_of_its_declared_deviation(native: Make) -> None:
    # given shifts that take no time, one in 2 s
    pitch = run(native, STANDING, pitch_shift=10 * DEG, pitch_shift_rate=0.5, pitch_shift_time=0.0)["pitch"]
    places = pitch[np.flatnonzero(np.diff(pitch)) + 1] - PITCH_MEAN
    # then 1,600 s have 800 of them, within 4 deviations (p = 6e-5)
    assert len(places) == pytest.approx(800, abs=4 * math.sqrt(800))
    assert places.mean() == pytest.approx(0, abs=4 * 10 * DEG / math.sqrt(800))
    assert places.std() == pytest.approx(10 * DEG, rel=4 / math.sqrt(1600))


def test_a_shift_of_the_pitch_takes_its_time(native: Make) -> None:
    # given shifts with a time constant of 0.2 s: of what is left a tick keeps 0.2/0.24
    columns = run(native, STANDING, 4000, pitch_shift_rate=0.05, pitch_shift_time=0.2)
    pitch, place = columns["pitch"] - PITCH_MEAN, columns["settling_pitch"]
    begin = int(np.flatnonzero(np.diff(place))[0]) + 1
    assert not np.any(pitch[:begin])
    left = (place[begin] - pitch[begin : begin + 10]) / place[begin]
    assert left == pytest.approx((0.2 / 0.24) ** np.arange(1, 11))


# Jolts


def test_jolts_have_their_declared_rate_and_size_and_one_sign(native: Make) -> None:
    # given a walk with jolts of up to 10 m/s2, 0.3 a second, and the same walk without
    jolting, calm = (run(native, WALKING, jolt_peak=10.0, jolt_rate=rate) for rate in (0.3, 0.0))
    jolts = (jolting["acceleration"] - calm["acceleration"])[TICKS // 100 :]
    sizes = jolts[np.abs(jolts) > 1e-9]
    # then 1,584 s have 475 of them within 4 deviations, uniform from 0 to 10: mean 5, deviation 10/sqrt(12)
    assert len(sizes) == pytest.approx(475, abs=4 * math.sqrt(475))
    assert sizes.min() > 0
    assert sizes.max() < 10
    assert sizes.mean() == pytest.approx(5, abs=4 * 10 / math.sqrt(12 * 475))
    assert sizes.std() == pytest.approx(10 / math.sqrt(12), rel=0.1)
    # and nothing else of the motion changes
    for name in ("pitch", "yaw_rate", "north", "speed", "heading"):
        assert jolting[name].tobytes() == calm[name].tobytes(), name


def test_jolts_of_a_negative_peak_point_backwards(native: Make) -> None:
    assert run(native, WALKING, 4000, jolt_peak=-10.0, jolt_rate=1.0)["jolt"].max() <= 0
    assert run(native, WALKING, 4000, jolt_peak=-10.0, jolt_rate=1.0)["jolt"].min() < -9


def test_a_jolt_fades_in_its_time(native: Make) -> None:
    # given jolts with a time constant of 0.08 s: a tick keeps 0.08/0.12
    jolt = run(native, WALKING, 4000, jolt_rate=0.1, jolt_time=0.08)["jolt"]
    begin = int(np.flatnonzero(jolt)[0])
    assert jolt[begin : begin + 8] / jolt[begin] == pytest.approx((2 / 3) ** np.arange(8))


def test_the_pack_of_a_standing_dog_does_not_jolt(native: Make) -> None:
    assert not run(native, STANDING, 4000, jolt_rate=10.0)["jolt"].any()


# Slip


def test_course_of_a_turning_dog_leads_its_heading_by_the_declared_time(native: Make) -> None:
    """A dog that turns on a circle, against the circle's own kinematics."""
    # given a walk at 1.5 m/s that turns by 30 deg/s, with a mean slip and 0.43 s of lead
    rate, speed, slip = 30 * DEG, 1.5, 0.1 + 0.43 * 30 * DEG
    turning = {"drift": rate, "slip_mean": 0.1, "slip_lead": 0.43, "shaking": 0.0}
    end = {name: column[-25:] for name, column in run(native, WALKING, 1000, **turning).items()}
    assert end["slip"] == pytest.approx(slip, abs=1e-9)
    # then it moves where heading and slip point
    moved = np.arctan2(np.diff(end["east"]), np.diff(end["north"])) - end["heading"][1:]
    assert np.angle(np.exp(1j * moved)) == pytest.approx(slip, abs=1e-9)
    # and the acceleration towards the centre, speed times rate, lies across the course of half a tick ago
    right = end["slip_acceleration"] + speed * end["yaw_rate"]
    middle = slip - rate * TS / 2
    assert end["acceleration"] == pytest.approx(-speed * rate * math.sin(middle), rel=1e-4)
    assert right == pytest.approx(speed * rate * math.cos(middle), rel=1e-4)


def test_accelerations_by_slip_integrate_to_the_velocity_of_the_path(native: Make) -> None:
    # given a dog that speeds up and turns while its slip wanders
    motion = run(
        native, WALKING, 250, drift=0.5, slip_lead=0.3, slip_wander=0.2, slip_time=1.0, shaking=0.0,
        cruise_speed=4.0,
    )  # fmt: skip
    assert np.ptp(motion["slip"]) > 0.3
    # when forward and lateral acceleration are turned by the heading and summed
    right = motion["slip_acceleration"] + motion["speed"] * motion["yaw_rate"]
    acceleration = (motion["acceleration"] + 1j * right) * np.exp(1j * motion["heading"])
    velocity = np.cumsum(acceleration) * TS
    # then the sum is the velocity along the course
    course = motion["heading"] + motion["slip"]
    assert np.abs(velocity - motion["speed"] * np.exp(1j * course)).max() < 1e-9
    assert np.abs(velocity - motion["speed"]).max() > 3


def test_slip_wanders_with_its_declared_deviation(native: Make) -> None:
    slip = run(native, WALKING, slip_mean=-0.1, slip_wander=0.05, slip_time=0.5)["slip"]
    kept = 0.5 / 0.54
    independent = TICKS * (1 - kept**2) / (1 + kept**2)
    assert slip.mean() == pytest.approx(-0.1, abs=4 * 0.05 * math.sqrt((1 + kept) / (1 - kept) / TICKS))
    assert np.var(slip) / 0.05**2 == pytest.approx(1, abs=4 * math.sqrt(2 / independent))


def test_slip_never_exceeds_sixty_degrees(native: Make) -> None:
    slip = run(native, WALKING, 4000, drift=3.0, slip_lead=1.0, slip_wander=0.5, slip_time=0.0)["slip"]
    assert slip.max() == 60 * DEG


def test_a_dog_that_slips_still_finds_its_way_home(native: Make) -> None:
    # given a dog 50 m away, recalled, whose course is 20 deg off its heading
    model = native(Canine, "double", CALM | {"slip_mean": 20 * DEG, "cruise_speed": 4.86})
    model["position_north"], model["position_east"] = 30.0, 40.0
    way = model.run(command=np.full(400, Command.RECALL))
    assert np.hypot(way["north"], way["east"]).min() < 1


# Off by default


def test_by_default_nothing_of_this_is_drawn(native: Make) -> None:
    # given the dog as declared, over 1,000 ticks of walking
    model = native(Canine, "double", {"seed": 3})
    columns = model.run(command=np.full(1000, WALKING))
    # then no stream has moved, and no state of these motions is other than 0
    for substream, name in ((5, "wander"), (6, "shift"), (7, "jolt"), (11, "stride")):
        assert tuple(model[f"{name}_stream[{i}]"] for i in range(1, 7)) == start_state(3, substream)
    for name in ("wandered_pitch", "shifted_pitch", "jolt", "slip", "slip_acceleration", "slip_brake"):
        assert not columns[name].any(), name


def test_each_of_these_motions_has_draws_of_its_own(native: Make) -> None:
    """Common random numbers: what is switched on changes nothing of the rest."""
    wander = {"pitch_wander": 4 * DEG, "slip_wander": 0.1}
    alone = run(native, WALKING, 2000, **wander)
    others = {"jolt_rate": 1.0, "pitch_shift_rate": 1.0, "stride_deviation": 0.1}
    all_on = run(native, WALKING, 2000, **wander, **others)
    for name in ("wandered_pitch", "slip", "trial_drift"):
        assert alone[name].tobytes() == all_on[name].tobytes(), name
