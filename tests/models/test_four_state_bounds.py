"""The estimator's ties, axes and counts, one by one: each test notices mutants that the longer ones miss."""

from __future__ import annotations

import math
from collections.abc import Mapping

import pytest

from models.errors import ParameterError
from models.four_state import FourState
from models.kit.model import Model


def started(**parameters: float) -> Model:
    """An estimator at the origin, at rest, that has had a fix on the tick before."""
    model = Model(FourState, parameters)
    model.initialize()
    model["started"] = 1
    for i in range(1, 5):
        model[f"covariance[{i}]"] = 1.0
    model["gps_h_acc"], model["gps_s_acc"] = 2.0, 0.5
    return model


@pytest.mark.parametrize(("speed", "sigma"), [(3.0, 16 / 15), (-3.0, 16 / 15), (5.0, 151.70), (-5.0, 151.70)])
def test_sigma_is_tuned_by_the_size_of_the_speed_at_exactly_3_m_s_too(speed: float, sigma: float) -> None:
    """Choice 6: 0.5 to 3.0 m/s -> 1.0667, 4 and above -> 151.70; not tuned it would be `sigma_constant`."""
    model = Model(FourState, {"sigma_constant": 0.1})
    model.initialize()
    model["x[1]"] = speed
    model.step()
    assert model["sigma"] == pytest.approx(sigma, abs=0.005)


@pytest.mark.parametrize("name", ["gps_north", "gps_east", "gps_speed"])
@pytest.mark.parametrize("side", [1, -1])
def test_the_gate_holds_north_east_and_speed_each(name: str, side: int) -> None:
    # given a nominal variance of 2 (h_acc / 2)^2 + (1.5 m/s age)^2, or 2 s_acc^2 + (4 m/s2 age)^2, a tick old
    if name == "gps_speed":
        width = 5 * math.sqrt(2 * 0.5**2 + (4 * 0.04) ** 2)
    else:
        width = 5 * math.sqrt(2 * 1.0**2 + (1.5 * 0.04) ** 2)
    for offset, accepted in ((0.999 * width, 1), (1.001 * width, 0)):
        model = started()
        model["x[1]"] = 0.0 if side > 0 or name != "gps_speed" else 20.0
        model["gps_fix"] = 1
        model["gps_speed"] = model["x[1]"]
        model[name] = model[name] + side * offset
        # the animal would move on in the tick: a fast one is where it was
        model["x[3]"] = -0.04 * model["x[1]"]
        # then a fix that is farther off along any of the three is not taken
        model.step()
        assert (name, model["accepted"]) == (name, accepted)


def fix(model: Model, values: Mapping[str, float], after: int = 1) -> None:
    """So many ticks after the one before, a fix with these inputs; the others stay as they are."""
    for _ in range(after - 1):
        model.step()
    for name, value in values.items():
        model[name] = value
    model["gps_fix"] = 1
    model.step()
    model["gps_fix"] = 0


FAR = {"gps_north": 1000.0, "gps_east": -2000.0}
HOME = {"gps_north": 0.0, "gps_east": 0.0}
BAD = {"gps_h_acc": 1e4}  # an accuracy that no receiver states


@pytest.mark.parametrize("name", ["gps_north", "gps_east", "gps_speed"])
def test_a_gate_of_no_width_takes_a_fix_that_is_not_off_at_all(name: str) -> None:
    for offset, accepted in ((0.0, 1), (1e-9, 0)):
        model = started(gate=0)
        fix(model, {name: offset})
        assert model["accepted"] == accepted


# Rule 6: heading against course


def contradicting(**values: float) -> float:
    """For how long [s] a course of 2 rad contradicts a heading of 0 after a fix with these inputs."""
    model = started(gate=1e6, heading_limit=0.5, course_speed=0.5)
    fix(model, {"gps_course": 2.0, "gps_speed": 5.0, **values})
    model.step()  # one without a fix, which says nothing
    return model["contradiction"]


def above(value: float) -> float:
    return math.nextafter(value, math.inf)


@pytest.mark.parametrize(("speed", "accuracy"), [(1.5, 0.5), (0.5, 0.125)])
def test_rule_6_a_fix_shows_its_course_above_three_deviations_of_its_speed_and_above_course_speed(
    speed: float, accuracy: float
) -> None:
    assert contradicting(gps_speed=speed, gps_s_acc=accuracy) == 0
    assert contradicting(gps_speed=above(speed), gps_s_acc=accuracy) == pytest.approx(0.04)


@pytest.mark.parametrize("side", [1, -1])
def test_rule_6_a_course_as_far_from_the_heading_as_the_limit_contradicts_nothing(side: int) -> None:
    assert contradicting(gps_course=side * 0.5) == 0
    assert contradicting(gps_course=side * above(0.5)) == pytest.approx(0.04)


def test_rule_6_a_bad_fix_contradicts_nothing_although_its_course_is_good() -> None:
    assert contradicting(**BAD) == 0


def test_rule_6_a_course_speaks_for_the_ticks_since_the_good_fix_before_it() -> None:
    model = started(gate_position_growth=0)
    good = {"gps_h_acc": 2.0}
    # given fixes that are accepted, rejected, bad, rejected, accepted: ticks, values, ticks from the good one
    for after, values, gap in (
        (5, HOME, 5), (6, FAR, 6), (3, FAR, 3), (2, BAD, None), (2, good, 4), (7, HOME, 7), (8, HOME, 8),
    ):  # fmt: skip
        fix(model, values, after)
        assert gap in (None, model["fix_gap"])
    assert model["rejections"] == 3


# Jumps


@pytest.mark.parametrize(
    ("north", "east", "jumps"),
    [
        (6.99, 0, 0), (7.01, 0, 1), (-6.99, 0, 0), (-7.01, 0, 1),
        (0, 6.99, 0), (0, 7.01, 1), (0, -6.99, 0), (0, -7.01, 1),
        (4.9, 4.9, 0), (5.0, 5.0, 1), (-4.9, -4.9, 0), (-5.0, -5.0, 1),  # 6.93 m and 7.07 m
    ],
)  # fmt: skip
def test_rule_5_a_jump_is_a_way_of_more_than_7_m_in_any_direction(
    north: float, east: float, jumps: int
) -> None:
    # given an estimate far from the origin, and a fix that it follows wholly
    model = started(gate=1e6)
    model["x[3]"], model["x[4]"] = 100.0, -200.0
    fix(model, {"gps_north": 100.0 + north, "gps_east": -200.0 + east, "gps_h_acc": 1e-3})
    assert model["north"] - 100.0 == pytest.approx(north, abs=1e-4)
    assert model["jumps"] == jumps


def test_rule_5_a_correction_that_moves_nothing_is_no_jump_although_any_way_is_one() -> None:
    model = started(jump_distance=0)
    fix(model, {})
    assert (model["accepted"], model["jumps"]) == (1, 0)
    fix(model, {"gps_north": 0.1})
    assert (model["accepted"], model["jumps"]) == (1, 1)


# Fixes that are rejected in a row


@pytest.mark.parametrize("bearing", range(0, 360, 45))
def test_rule_5_rejected_fixes_agree_within_the_gate_and_the_way_of_a_body_between_them(bearing: int) -> None:
    """For 0.2 s at 50 m/s, and 3 nominal deviations: sqrt(10^2 + 3^2 * 2 * (3 m / 2)^2) = 11.853 m."""
    north, east = math.cos(math.radians(bearing)), math.sin(math.radians(bearing))
    for way, rejected in ((11.84, 2), (11.86, 1)):
        model = started(gate=3, gate_position_growth=0, recovery_speed=50)
        fix(model, FAR | {"gps_h_acc": 3.0}, after=10)
        fix(model, {"gps_north": 1000 + way * north, "gps_east": -2000 + way * east}, after=5)
        assert model["rejected"] == rejected


def test_rule_5_rejected_fixes_at_the_very_same_place_agree_whatever_the_gate() -> None:
    model = started(gate=0, recovery_speed=0)
    fix(model, FAR)
    fix(model, FAR)
    assert model["rejected"] == 2


def test_rule_5_a_bad_fix_among_rejected_ones_is_not_held_against_the_next() -> None:
    model = started(recovery_speed=15)
    fix(model, FAR, after=5)
    fix(model, HOME | {"gps_speed": 51.0}, after=3)  # faster than any that is declared
    names = ("rejected", "rejected_north", "rejected_east", "rejected_age", "rejected_since", "rejections")
    assert [model[name] for name in names] == [1, 1000, -2000, 5, 5, 1]


def test_rule_5_rejected_fixes_count_anew_after_one_that_was_accepted() -> None:
    # given two that agree, one accepted, and two at the place of the first
    model = started(recovery_fixes=2, recovery_time=0.5)
    for after, values in ((5, FAR), (5, FAR), (5, HOME), (20, FAR), (5, FAR)):
        fix(model, values, after)
    # then the time of the last two alone counts, 0.2 s
    assert (model["rejected"], model["rejected_since"], model["recoveries"]) == (2, 20, 0)


@pytest.mark.parametrize(("time", "recoveries"), [(0.72, 1), (0.76, 0)])
def test_rule_5_the_filter_begins_anew_once_the_time_is_over_and_not_a_tick_before(
    time: float, recoveries: int
) -> None:
    model = started(recovery_time=time)
    for _ in range(4):
        fix(model, FAR, after=6)  # 3 * 6 ticks are 0.72 s
    assert model["recoveries"] == recoveries


def test_rule_5_the_filter_begins_anew_at_a_good_fix_alone() -> None:
    # given rejected fixes that agree, and a time that is over between two fixes
    model = started(recovery_time=1.0)
    for _ in range(5):
        fix(model, FAR, after=6)
    for _ in range(3):
        model.step()
    fix(model, BAD)
    assert (model["age"], model["recoveries"]) == (34, 0)
    assert model["north"] == pytest.approx(0, abs=1e-6)
    # when a good one comes
    fix(model, {"gps_h_acc": 2.0})
    assert (model["recoveries"], model["north"], model["east"]) == (1, 1000, -2000)
    assert [model[name] for name in ("age", "rejected", "started", "renewed")] == [0, 0, 1, 1]


def test_rule_5_a_thousand_rejected_fixes_are_as_many_as_are_counted() -> None:
    model = started(recovery_fixes=1000, recovery_time=1e4)
    fix(model, FAR)
    model["rejected"] = 998
    counts = []
    for _ in range(3):
        fix(model, {})
        counts.append(model["rejected"])
    assert counts == [999, 1000, 1000]
    with pytest.raises(ParameterError, match="recovery_fixes"):
        Model(FourState, {"recovery_fixes": 1001})


# Good enough to lead by


@pytest.mark.parametrize(
    ("number", "output", "limit"),
    [(1, "north_sd", "max_position_sd"), (2, "east_sd", "max_position_sd"), (3, "speed_sd", "max_speed_sd")],
)
def test_rule_5_a_deviation_as_large_as_its_limit_is_good_enough(
    number: int, output: str, limit: str
) -> None:
    def estimate(**parameters: float) -> Model:
        model = started(**parameters)
        model[f"covariance[{number}]"] = 9.0  # the others are 1
        model.step()
        return model

    deviation = estimate()[output]
    assert deviation == pytest.approx(3, rel=1e-3)
    assert estimate(**{limit: deviation})["valid"] == 1
    assert estimate(**{limit: math.nextafter(deviation, 0)})["valid"] == 0
