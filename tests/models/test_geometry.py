"""Angles wrapped into (-pi, pi], values clipped, conditions joined, members of an enumeration."""

from __future__ import annotations

import math
from enum import IntEnum
from typing import Any

import casadi as ca
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.errors import DeclarationError
from models.kit.geometry import all_of, any_of, clip, none_of, one_of, where, wrap

a, b, c = (ca.SX.sym(name) for name in "abc")
WRAP = ca.Function("wrap", [a], [wrap(a)])
CLIP = ca.Function("clip", [a, b, c], [clip(a, b, c)])
CHOICE = ca.Function("choice", [a, b, c], [where(all_of(a, b, c), 1, 2), where(any_of(a, b, c), 3, 4)])

PI = math.pi


@pytest.mark.parametrize(
    ("angle", "expected"),
    [
        (0.0, 0.0),
        (PI, PI),
        (-PI, PI),  # the interval is open below
        (1.5 * PI, -0.5 * PI),
        (-1.5 * PI, 0.5 * PI),
        (2 * PI, 0.0),
        (-2 * PI, 0.0),
        (3 * PI, PI),
        (-3 * PI, PI),
        (math.nextafter(PI, 0), math.nextafter(PI, 0)),
        (-PI + 1e-13, -PI + 1e-13),
        (PI + 1e-13, -PI + 1e-13),
        (PI + 1e-9, -PI + 1e-9),
        (-PI - 1e-9, PI - 1e-9),
        (1000 * PI + 0.5, 0.5),
    ],
)
def test_wrap_at_the_edges(angle: float, expected: float) -> None:
    assert float(WRAP(angle)) == pytest.approx(expected, abs=4 * math.ulp(max(abs(angle), PI)))


def test_wrap_changes_nothing_within() -> None:
    for angle in (3.0, -3.0, 0.1, -0.1, 1e-300, -1e-300):
        assert float(WRAP(angle)) == angle


@given(st.floats(-1e4, 1e4))
def test_wrap_is_the_same_direction_in_the_half_open_interval(angle: float) -> None:
    """The interval and the direction hold up to the rounding of the angle itself."""
    rounding = 4 * math.ulp(max(abs(angle), PI))
    wrapped = float(WRAP(angle))
    assert -PI - rounding < wrapped <= PI + rounding
    assert abs(math.remainder(wrapped - angle, 2 * PI)) <= rounding + 2e-16 * abs(angle)


@given(st.floats(-3.1415926, 3.1415926), st.integers(-1000, 1000))
def test_wrap_forgets_whole_turns(angle: float, turns: int) -> None:
    assert float(WRAP(angle + turns * 2 * PI)) == pytest.approx(angle, abs=1e-11)


@given(st.floats(-10, 10), st.floats(-5, 0), st.floats(0, 5))
def test_clip_is_the_nearest_value_in_the_range(value: float, low: float, high: float) -> None:
    assert float(CLIP(value, low, high)) == min(max(value, low), high)


def test_all_of_and_any_of_choose_by_three_conditions() -> None:
    answers = {bits: tuple(map(float, CHOICE(*bits))) for bits in ((1, 1, 1), (1, 0, 1), (0, 0, 0))}
    assert answers == {(1, 1, 1): (1, 3), (1, 0, 1): (2, 3), (0, 0, 0): (2, 4)}


class Gear(IntEnum):
    """An enumeration whose values are not those of its order."""

    REVERSE = -1
    NEUTRAL = 0
    FIRST = 3
    SECOND = 7


@pytest.mark.parametrize(
    "members",
    [
        {Gear.REVERSE},
        {Gear.REVERSE, Gear.NEUTRAL, Gear.FIRST},
        {Gear.SECOND},
        {Gear.FIRST, Gear.SECOND},
        set(Gear),
    ],
)
def test_membership_takes_one_comparison(members: set[Gear]) -> None:
    gear = ca.SX.sym("gear")
    for condition, holds in ((one_of(gear, members), True), (none_of(gear, members), False)):
        assert ca.n_nodes(condition) <= 4  # the comparison, its two sides, and the negation that gives >
        answer = ca.Function("answer", [gear], [condition])
        assert [bool(answer(value)) for value in Gear] == [(value in members) is holds for value in Gear]


@pytest.mark.parametrize("condition", [one_of, none_of])
@pytest.mark.parametrize("members", [{Gear.NEUTRAL, Gear.FIRST}, {Gear.REVERSE, Gear.SECOND}])
def test_members_amid_an_enumeration_are_refused(condition: Any, members: set[Gear]) -> None:
    with pytest.raises(DeclarationError, match=r"are neither the first nor the last of Gear"):
        condition(ca.SX.sym("gear"), members)
