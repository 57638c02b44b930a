"""Rules 5 and 6 of SAFETY.md in every estimator: heading against course, silent sensors, what is counted."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from models.canine_ahrs import CanineAhrs
from models.given_heading import GivenHeading
from models.readings import ON_BOARD, READINGS
from models.system import ESTIMATORS
from tests.models.motions import Array, Columns, T, fix_ticks, motion, noisy

Make = Callable[..., Any]
EACH = pytest.mark.parametrize("name", ESTIMATORS)
GIVEN = pytest.mark.parametrize("name", [n for n, b in ESTIMATORS.items() if issubclass(b, GivenHeading)])
SECOND = 25  # ticks
DEG = math.pi / 180


def guarded(name: str) -> dict[str, float]:
    """An estimator's parameters in the reading for animals."""
    return {a.partition(".")[2]: v for a, v in READINGS[ON_BOARD].items() if a.startswith(f"{name}.")}


def alive(name: str) -> dict[str, float]:
    """The same, without limits of the deviations, which those of Table C.1 exceed between fixes."""
    return guarded(name) | {"max_position_sd": 1e9, "max_speed_sd": 1e9}


def lively(inputs: Columns, seed: int = 1) -> Columns:
    """With the noise of a unit that lives, in all that it gives."""
    rng = np.random.default_rng(seed)
    n = len(inputs["accel_x"])
    noise = {f"{kind}_{axis}": 0.02 for kind in ("accel", "gyro") for axis in "xyz"}
    noise |= {"pitch_meas": 0.002, "heading_meas": 0.002}
    return {**inputs, **{name: inputs[name] + rng.normal(0, sd, n) for name, sd in noise.items()}}


def straight(seconds: float, heading: float = 0.5, speed: float = 1.5) -> Columns:
    n = round(seconds * SECOND)
    return lively(motion(np.full(n, speed), np.full(n, heading)))


def off_by(inputs: Columns, error: Array | float) -> Columns:
    """With a heading that is wrong by so much."""
    return {**inputs, "heading_meas": inputs["heading_meas"] + error}


# Rule 6: heading against course


@GIVEN
@pytest.mark.parametrize("error", [50, 60, 90, 180, -120])
def test_rule_6_a_heading_that_courses_contradict_makes_the_estimate_invalid_within_seconds(
    native: Make, name: str, error: float
) -> None:
    # given a body that walks, whose heading is wrong from 5 s on
    inputs = straight(20)
    wrong = np.where(np.arange(500) >= 125, error * DEG, 0)
    # when
    out = native(ESTIMATORS[name], "float", guarded(name)).run(**off_by(inputs, wrong))
    # then 3 s after the last fix that agreed, at 4.76 s, it is invalid, and says why
    first = int(np.flatnonzero(~out["heading_ok"].astype(bool))[0])
    assert 3.0 <= first * T - 4.76 <= 3.3
    assert not out["heading_ok"][first:].any()
    assert not out["valid"][first:].any()
    assert out["valid"][25:125].all()


@GIVEN
def test_rule_6_a_heading_that_is_right_again_is_led_by_after_as_long(native: Make, name: str) -> None:
    wrong = np.where((np.arange(750) >= 125) & (np.arange(750) < 375), math.pi, 0)
    out = native(ESTIMATORS[name], "float", guarded(name)).run(**off_by(straight(30), wrong))
    (again, *_) = 375 + np.flatnonzero(out["heading_ok"][375:])
    assert 2.7 <= (again - 375) * T <= 3.3
    assert out["heading_ok"][again:].all()
    if name != "canine_tracker":  # it has learned a slip meanwhile, and doubts it for longer
        assert out["valid"][again:].all()


@GIVEN
@pytest.mark.parametrize("error", [20, 40])
def test_rule_6_a_smaller_error_of_the_heading_is_not_noticed(native: Make, name: str, error: float) -> None:
    """SAFETY.md says so."""
    out = native(ESTIMATORS[name], "float", guarded(name)).run(**off_by(straight(20), error * DEG))
    assert out["heading_ok"].all()


@GIVEN
def test_rule_6_a_course_that_leads_the_heading_of_a_turning_body_contradicts_nothing(
    native: Make, name: str
) -> None:
    """By 0.45 s of the yaw rate, as on the recorded walk; it turns by 180 deg, at up to 90 deg/s."""
    t = np.arange(2000) * T
    inputs = lively(motion(np.full(2000, 1.5), 1.57 * np.sin(t)))
    inputs["gps_course"] = 1.57 * np.sin(t) + 0.45 * 1.57 * np.cos(t)
    out = native(ESTIMATORS[name], "float", guarded(name)).run(**inputs)
    assert out["heading_ok"].all()
    # while a circle in which the course always leads by 50 deg does contradict it
    inputs["gps_course"] = inputs["heading_meas"] + 50 * DEG
    assert not native(ESTIMATORS[name], "float", guarded(name)).run(**inputs)["heading_ok"][-1]


@GIVEN
def test_rule_6_yaw_that_is_counted_the_wrong_way_is_noticed_unless_it_walks_along_a_meridian(
    native: Make, name: str
) -> None:
    """As of a wrong `z_up`: the heading is its opposite, which is the same to the north and to the south."""
    for heading, noticed in ((90, True), (45, True), (-60, True), (0, False), (180, False)):
        inputs = straight(20, heading * DEG)
        inputs["heading_meas"] = -inputs["heading_meas"]
        out = native(ESTIMATORS[name], "float", guarded(name)).run(**inputs)
        assert bool(out["heading_ok"][-1]) is not noticed


@GIVEN
def test_rule_6_a_heading_that_wanders_anywhere_is_noticed(native: Make, name: str) -> None:
    """Iron near the magnetometer: it agrees with the course on one fix of four."""
    rng = np.random.default_rng(2)
    wrong = np.repeat(rng.uniform(-math.pi, math.pi, 100), 25)  # another each second
    out = native(ESTIMATORS[name], "float", guarded(name)).run(**off_by(straight(100), wrong))
    assert out["heading_ok"][500:].mean() < 0.3


@GIVEN
@pytest.mark.parametrize(
    "wrong",
    [
        {"gps_speed": 0.45},  # slower than `course_speed`
        {"gps_s_acc": 0.6},  # a speed that is not sure: 1.5 m/s is less than three deviations
        {"gps_course": math.nan},
        {"gps_course": 7.1},
    ],
)
def test_rule_6_a_fix_that_shows_no_course_contradicts_nothing(
    native: Make, name: str, wrong: dict[str, float]
) -> None:
    inputs = straight(20) | {n: np.full(500, v) for n, v in wrong.items()}
    out = native(ESTIMATORS[name], "float", guarded(name)).run(**off_by(inputs, math.pi))
    assert out["heading_ok"].all()


@GIVEN
def test_rule_6_few_fixes_far_between_do_not_count_for_the_time_between_them(native: Make, name: str) -> None:
    """A fix every 2 s counts for a second: three of them, and not two, speak for 3 s."""
    inputs = straight(20)
    inputs["gps_fix"] = (np.arange(500) % 50) == 0
    out = native(ESTIMATORS[name], "float", guarded(name) | {"gate": 1e6}).run(**off_by(inputs, math.pi))
    (first, *_) = np.flatnonzero(~out["heading_ok"].astype(bool))
    assert first == 150  # the fixes of 2, 4 and 6 s; that of 0 s begins the filter


@GIVEN
def test_rule_6_a_fix_that_is_rejected_shows_its_course_too(native: Make, name: str) -> None:
    # given a heading the wrong way round, and a receiver of so few fixes that the gate rejects some
    inputs = straight(40, speed=5.0)
    inputs["gps_fix"] = fix_ticks(1000) & (np.arange(1000) % 25 == 0)
    inputs["gps_h_acc"] = np.full(1000, 0.02)
    parameters = guarded(name) | {"gate": 1.0}
    out = native(ESTIMATORS[name], "float", parameters).run(**off_by(inputs, math.pi))
    assert out["rejected_fixes"][-1] > 10
    assert not out["heading_ok"][200:].any()


@EACH
def test_rule_6_the_heading_is_not_held_against_courses_in_the_readings_of_the_text(
    native: Make, name: str
) -> None:
    out = native(ESTIMATORS[name], "float").run(**off_by(straight(20), math.pi))
    assert out["heading_ok"].all()


@pytest.mark.parametrize("name", ["six_state", "seven_state"])
def test_rule_6_filters_that_take_their_heading_from_courses_notice_a_heading_that_does_not_follow_them(
    native: Make, name: str
) -> None:
    inputs = straight(20)
    estimator = native(ESTIMATORS[name], "float", guarded(name) | {"course_noise": 1e3, "gate": 1e6})
    estimator.run(**{n: v[:100] for n, v in inputs.items()})
    estimator["x[3]"] = 0.5 + math.pi  # the course is believed too little to turn it back
    out = estimator.run(**{n: v[100:] for n, v in inputs.items()})
    (first, *_) = np.flatnonzero(~out["heading_ok"].astype(bool))
    assert 2.7 <= first * T <= 3.3
    assert not out["valid"][first]
    # as tuned, the next courses turn it back within that time
    tuned = native(ESTIMATORS[name], "float", guarded(name))
    tuned.run(**{n: v[:100] for n, v in inputs.items()})
    tuned["x[3]"] = 0.5 + math.pi
    assert tuned.run(**{n: v[100:] for n, v in inputs.items()})["heading_ok"].all()


# Rule 6: frozen sensors are silent ones


def frozen(inputs: Columns, start: float, end: float) -> Columns:
    """With an inertial unit that repeats its sample."""
    since, until = round(start * SECOND), round(end * SECOND)
    unit = [n for n in inputs if not n.startswith("gps_")]
    held = {n: np.array(inputs[n]) for n in unit}
    for column in held.values():
        column[since:until] = column[since]
    return inputs | held


@EACH
@pytest.mark.parametrize("precision", ["double", "float"])
def test_rule_6_a_unit_that_repeats_its_sample_is_silent_after_ten(
    native: Make, name: str, precision: str
) -> None:
    # given a unit that repeats its sample from 8 s to 12 s
    inputs = frozen(straight(20), 8, 12)
    out = native(ESTIMATORS[name], precision, alive(name)).run(**inputs)
    # then from the eleventh repetition on its samples are bad and the estimate invalid, until it lives again
    bad = np.flatnonzero(np.diff(out["bad_samples"], prepend=0))
    assert bad.tolist() == list(range(211, 300))
    assert out["valid"][100:211].all()
    assert not out["valid"][211:300].any()
    assert out["valid"][301]


@EACH
def test_rule_6_repetitions_that_end_in_time_and_single_values_that_repeat_are_good(
    native: Make, name: str
) -> None:
    inputs = frozen(straight(20), 8, 8.44)  # ten repetitions of the sample at 8 s
    inputs["accel_x"][300:] = 0.25  # one axis alone
    out = native(ESTIMATORS[name], "float", alive(name)).run(**inputs)
    assert out["bad_samples"][-1] == 0
    assert out["valid"][100:].all()


@EACH
def test_rule_6_a_simulated_unit_without_noise_may_repeat_itself_where_nothing_is_set(
    native: Make, name: str
) -> None:
    still = motion(np.zeros(1500), np.zeros(1500))
    out = native(ESTIMATORS[name], "double").run(**still)
    assert out["bad_samples"][-1] == 0
    assert out["valid"].all()


@EACH
def test_rule_6_a_silent_unit_makes_the_estimate_invalid_although_fixes_come(native: Make, name: str) -> None:
    inputs = straight(20)
    inputs["accel_x"][200:300] = 1e9  # as the onboard program gives it where no sample came
    out = native(ESTIMATORS[name], "float", alive(name)).run(**inputs)
    assert not out["valid"][210:300].any()
    assert out["valid"][301:].all()


def test_rule_6_the_attitude_reference_does_not_turn_on_by_a_frozen_sample(native: Make) -> None:
    # given an AHRS that turns at 1 rad/s when its unit freezes
    n = 500
    t = np.arange(n) * T
    inputs = frozen(lively(motion(np.full(n, 1.5), t)), 8, 16)
    names = CanineAhrs.flat_names("input")
    parameters = {"frozen_samples": READINGS[ON_BOARD]["canine_ahrs.frozen_samples"]}
    believed, held = (
        native(CanineAhrs, "float", p).run(**{k: v for k, v in inputs.items() if k in names})
        for p in ({}, parameters)
    )
    # then its heading is held and soon called unknown, instead of turning on by more than a turn
    assert held["bad_samples"][-1] == 400 - 211
    assert np.ptp(np.unwrap(held["heading_meas"][215:395])) < 0.1
    assert held["heading_meas_sd"][260:395].min() > 100
    assert believed["heading_meas_sd"][260:395].max() < 1


# Rule 5: what a filter had to do to its estimate is counted


@EACH
def test_rule_5_rejected_fixes_jumps_and_recoveries_are_counted(native: Make, name: str) -> None:
    # given a body that stands, and a receiver that is 300 m off from 20 s on
    inputs = lively(motion(np.zeros(1500), np.zeros(1500)))
    away = np.arange(1500) >= 500
    inputs["gps_north"] = np.where(away, 300.0, 0.0)
    out = native(ESTIMATORS[name], "float", guarded(name) | {"gate": 5}).run(**inputs)
    # then all its fixes are rejected until the filter begins anew there, once
    (begun, *_) = np.flatnonzero(out["north"] > 200)
    late = inputs["gps_fix"] & away & (np.arange(1500) <= begun)
    assert out["rejected_fixes"][-1] == late.sum()
    assert out["rejected_fixes"][499] == 0
    assert out["recoveries"].tolist() == [0] * begun + [1] * (1500 - begun)
    assert out["jumps"][-1] == 0


@EACH
@pytest.mark.parametrize("far", [5.0, 9.0])
def test_rule_5_a_correction_that_moves_the_position_by_more_than_7_m_is_a_jump(
    native: Make, name: str, far: float
) -> None:
    # given a walk to the north, and a receiver that is off after an outage, and is believed at once
    inputs = lively(motion(np.full(1500, 1.5), np.zeros(1500)))
    back = np.arange(1500) >= 1000
    inputs["gps_north"] = inputs["gps_north"] + np.where(back, far, 0.0)
    inputs["gps_h_acc"] = np.where(back, 0.01, 3.5)
    inputs["gps_fix"] = inputs["gps_fix"] & ((np.arange(1500) < 750) | back)
    out = native(ESTIMATORS[name], "float", guarded(name) | {"gate": 1e6, "position_sd_floor": 0.0}).run(
        **inputs
    )
    # then it is counted if the position moves by more than 7 m on a tick
    assert out["jumps"][-1] == (np.hypot(np.diff(out["north"]), np.diff(out["east"])) > 7).sum()
    assert out["jumps"][-1] == (far > 7)
    assert out["rejected_fixes"][-1] == out["recoveries"][-1] == 0


@pytest.mark.parametrize("name", ["four_state", "two_bias"])
@pytest.mark.parametrize(("speed", "most"), [(1.5, 0.7), (4.0, 1.8)])
def test_rule_5_a_heading_that_is_somewhat_wrong_does_not_carry_the_position_away_from_the_fixes(
    native: Make, name: str, speed: float, most: float
) -> None:
    # given a heading that is wrong by 20 deg, by which the filter goes off sideways between two fixes
    inputs = noisy(off_by(straight(60, speed=speed), 20 * DEG), seed=3, position=0.0, speed=0.0)
    true = straight(60, speed=speed)
    errors = {}
    for reading, parameters in (("guarded", guarded(name)), ("text", {})):
        out = native(ESTIMATORS[name], "float", parameters).run(**inputs)
        off = np.hypot(out["north"] - true["gps_north"], out["east"] - true["gps_east"])
        errors[reading] = off[500:].max()
    # then it is carried off by little more than it states, instead of by many metres
    assert errors["guarded"] < most
    assert errors["text"] > 5
