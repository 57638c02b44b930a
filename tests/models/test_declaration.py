"""Declared variables: what follows from a declaration, and which declarations and values are refused."""

from __future__ import annotations

import math
from enum import IntEnum

import casadi as ca
import pytest

from models.errors import DeclarationError, ParameterError
from models.kit.block import Block
from models.kit.declaration import Boolean, Input, Integer, Output, Parameter, State, Stream, flatten
from models.kit.units import UNITS


class Gait(IntEnum):
    """Gaits of an animal."""

    STAND = 2
    WALK = 3
    RUN = 5


class Vest(Block):
    """Declarations of every sort."""

    pull = Input("m/s2", "pull at the leash", min=1, max=9)
    cold = Input("rad", "below zero", max=-0.5)
    gait = State(Gait, "how it moves", start=3)
    offset = Parameter("m", "where it sits", start=(0.1, 0.2, 0.3), size=3, min=-1, max=1)
    weight = Parameter("1", "weights", start=0.5, size=2)
    steps = Parameter(Integer, "steps", start=3, min=1, max=7)
    on = Parameter(Boolean, "switched on", start=1, latched=True)
    out = Output("m", "anything")


def test_a_vector_is_its_scalars_in_order() -> None:
    assert Vest.offset.flat_names == ("offset[1]", "offset[2]", "offset[3]")
    assert Vest.offset.start == (0.1, 0.2, 0.3)
    assert Vest.weight.start == (0.5, 0.5)
    assert Vest.flat_names("parameter") == [
        "offset[1]", "offset[2]", "offset[3]", "weight[1]", "weight[2]", "steps", "on",
    ]  # fmt: skip
    assert [(name, v.name) for name, v in flatten([Vest.weight, Vest.on])] == [
        ("weight[1]", "weight"),
        ("weight[2]", "weight"),
        ("on", "on"),
    ]


def test_without_a_start_value_a_variable_starts_at_the_value_nearest_to_zero() -> None:
    assert (Vest.pull.start, Vest.pull.has_start) == ((1.0,), False)
    assert Vest.cold.start == (-0.5,)
    assert Vest.out.start == (0.0,)


def test_an_enumeration_is_an_integer_from_its_lowest_to_its_highest_value() -> None:
    assert Vest.gait.type is Integer
    assert (Vest.gait.min, Vest.gait.max, Vest.gait.choices) == (2, 5, Gait)
    assert Vest.gait.expected() == "one of 2 (STAND), 3 (WALK), 5 (RUN)"


def test_a_parameter_is_latched_only_if_declared_so() -> None:
    parameters = Vest.variables(Parameter)
    latched = {name for name, v in parameters.items() if isinstance(v, Parameter) and v.latched}
    assert latched == {"on"}


@pytest.mark.parametrize(
    ("variable", "value", "message"),
    [
        ("steps", 8, "vest.steps is 8; expected a whole number from 1 up to 7"),
        ("steps", 2.5, "vest.steps is 2.5; expected a whole number from 1 up to 7"),
        ("offset", -1.5, "vest.offset is -1.5; expected a number from -1 up to 1 m"),
        ("offset", math.nan, "vest.offset is nan; expected a finite number"),
        ("offset", -math.inf, "vest.offset is -inf; expected a finite number"),
        ("on", 2, "vest.on is 2; expected true or false"),
        ("gait", 1, "vest.gait is 1; expected one of 2 (STAND), 3 (WALK), 5 (RUN)"),
        ("gait", 4, "vest.gait is 4; expected one of 2 (STAND), 3 (WALK), 5 (RUN)"),
    ],
)
def test_a_refusal_names_the_value_and_what_was_expected(variable: str, value: float, message: str) -> None:
    with pytest.raises(ParameterError) as error:
        Vest.variables()[variable].check(value, f"vest.{variable}")
    assert str(error.value) == message


@pytest.mark.parametrize(
    ("variable", "value"), [("steps", 1), ("steps", 7), ("offset", 1), ("on", 0), ("gait", 5)]
)
def test_the_ends_of_the_range_are_accepted(variable: str, value: float) -> None:
    Vest.variables()[variable].check(value, variable)  # raises nothing
    assert Vest.variables()[variable].contains(value)


def test_contains_is_false_for_nan_and_infinity() -> None:
    x = ca.SX.sym("x")
    bounded = ca.Function("bounded", [x], [Vest.offset.contains(x)])
    unbounded = ca.Function("unbounded", [x], [Vest.out.contains(x)])
    answers = {v: (bool(bounded(v)), bool(unbounded(v))) for v in (0.0, -1.0, 1.0, 1.1, -1.1)}
    assert answers == {
        0.0: (True, True), -1.0: (True, True), 1.0: (True, True), 1.1: (False, True), -1.1: (False, True),
    }  # fmt: skip
    for value in (math.nan, math.inf, -math.inf):
        assert not bounded(value)
        assert not unbounded(value)


def test_an_unknown_unit_is_named_with_the_known_ones() -> None:
    with pytest.raises(DeclarationError, match=r'"pace": unit "km/h" is unknown; .*m/s') as error:
        Input("km/h", "pace")
    assert all(unit in str(error.value) for unit in UNITS)


def test_a_start_value_out_of_range_is_named_with_block_and_range() -> None:
    with pytest.raises(DeclarationError) as error:
        type("Dog", (Block,), {"speed": State("m/s", "speed", start=9, min=0, max=5)})
    assert str(error.value) == "start of Dog.speed is 9; expected a number from 0 up to 5 m/s"


@pytest.mark.parametrize("start", [math.nan, math.inf])
def test_a_start_value_of_nan_or_infinity_is_refused(start: float) -> None:
    with pytest.raises(DeclarationError, match=r"start of Dog\.speed is (nan|inf); expected a finite number"):
        type("Dog", (Block,), {"speed": State("m/s", "speed", start=start)})


def test_a_wrong_number_of_start_values_is_refused() -> None:
    with pytest.raises(DeclarationError, match=r'"place": 2 start values for size 3'):
        State("m", "place", start=(1, 2), size=3)


def test_a_parameter_needs_a_start_value() -> None:
    with pytest.raises(DeclarationError, match='parameter "threshold" has no start value'):
        Parameter("rad", "threshold")


def test_a_stream_is_six_numbers() -> None:
    stream = Stream("anything", substream=4)
    assert (stream.width, stream.substream, stream.start) == (6, 4, (12345.0,) * 6)
